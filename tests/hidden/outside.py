"""Effects that no term of the catalogue expresses, for the reference simulator's tables.

Each row says at which ports of the model its signal may rightly be placed: torques on the shaft
add up, so the net port ``shaft`` is right for all of them, and the port of the torque concerned;
likewise the forces on a hull and its accelerations.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from reference.hidden import THRUSTER, Effect
from reference.vessel_hidden import VESSEL


class Outside(NamedTuple):
    """An effect outside the catalogue, the ports that are right, and what it depends on."""

    effect: Effect
    ports: frozenset[str]
    depends_on: frozenset[str]


def _hump(value: float, middle: float, width: float) -> float:
    """One about ``middle``, minus one about its opposite: smooth, and zero at rest."""
    ahead, astern = (value - middle) / width, (value + middle) / width
    return math.exp(-(ahead**2)) - math.exp(-(astern**2))


def command_play(times, values, *, play=0.0):
    """Backlash: the command moves the amplifier only after ``play`` [V] has been taken up."""
    out = np.array(values, float)
    out[0] = 0.0
    for k in range(1, len(out)):
        out[k] = min(max(out[k - 1], values[k] - play), values[k] + play)
    return times, out


def motor_heating(drive, s, own, *, loss=0.0, warm=1.0, time_constant=15.0):
    """The drive falls by the fraction ``loss`` of the heat: the mean of (drive / ``warm``)^2."""
    given = drive * (1.0 - loss * own)
    return given, ((drive / warm) ** 2 - own) / time_constant


def load_hump(load, s, *, height=0.0, middle=30.0, width=6.0):
    """The load torque has a hump of ``height`` [rad/s^2] about a ``middle`` speed (resonance)."""
    return load + height * _hump(s.speed, middle, width)


def load_memory(load, s, own, *, relief=0.0, time_constant=2.0):
    """The duct's water follows the speed and relieves the load by ``relief`` |W| times it."""
    return load - relief * abs(s.speed) * own, (s.speed - own) / time_constant


def brush_loss(load, s, *, loss=0.0, rest=1.0):
    """The brushes rub by ``loss`` [rad/(V s^2)] of the command, in full past the speed ``rest``."""
    return load + loss * abs(s.command) * math.tanh(s.speed / rest)


def thrust_hollow(thrust, s, *, depth=0.0, middle=30.0, width=6.0):
    """The fraction ``depth`` of the thrust is missing about a ``middle`` speed (stall)."""
    return thrust * (1.0 - depth * math.exp(-(((abs(s.speed) - middle) / width) ** 2)))


def reverse_stall(thrust, s, *, depth=0.0, middle=30.0, width=3.0):
    """Running backwards, the blades stall past a ``middle`` speed: ``depth`` of the thrust goes."""
    return thrust * (1.0 - depth / (1.0 + math.exp((s.speed + middle) / width)))


def resistance_hump(forces, s, *, height=0.0, middle=0.5, width=0.12):
    """Wave resistance has a hump of ``height`` about the hull's critical speed."""
    x, y, n = forces
    return x - height * _hump(s.surge, middle, width), y, n


def bow_wave_turning(forces, s, *, moment=0.0, middle=0.5, width=0.12):
    """About the critical speed the bow wave, never quite even, turns the hull with ``moment``."""
    x, y, n = forces
    return x, y, n + moment * math.exp(-(((s.surge - middle) / width) ** 2))


def heading_ripple(forces, s, *, moment=0.0, waves=4.0):
    """A turntable's gear turns the hull to and fro with ``moment``, ``waves`` times per turn."""
    x, y, n = forces
    return x, y, n + moment * math.sin(waves * s.heading)


def _ports(*names: str) -> frozenset[str]:
    return frozenset(names)


OUTSIDE: dict[str, Outside] = {
    "command_play": Outside(
        Effect("schedule", command_play), _ports("command", "drive", "shaft"), _ports("command")
    ),
    "motor_heating": Outside(
        Effect("drive", motor_heating, state=True),
        _ports("drive", "shaft"),
        _ports("command", "time"),
    ),
    "load_hump": Outside(Effect("load", load_hump), _ports("load", "shaft"), _ports("speed")),
    "load_memory": Outside(
        Effect("load", load_memory, state=True),
        _ports("load", "shaft"),
        _ports("speed", "acceleration"),
    ),
    "brush_loss": Outside(
        Effect("load", brush_loss), _ports("load", "shaft"), _ports("speed", "command")
    ),
    "thrust_hollow": Outside(
        Effect("thrust", thrust_hollow), _ports("propeller", "thrust"), _ports("speed")
    ),
    "reverse_stall": Outside(
        Effect("thrust", reverse_stall), _ports("propeller", "thrust"), _ports("speed")
    ),
}
VESSEL_OUTSIDE: dict[str, Outside] = {
    "resistance_hump": Outside(
        Effect("hull", resistance_hump),
        _ports("surge_force", "surge_acceleration"),
        _ports("surge"),
    ),
    "bow_wave_turning": Outside(
        Effect("hull", bow_wave_turning), _ports("yaw_moment", "yaw_acceleration"), _ports("surge")
    ),
    "heading_ripple": Outside(
        Effect("hull", heading_ripple), _ports("yaw_moment", "yaw_acceleration"), _ports("heading")
    ),
}

#: The simulator's tables with these effects added.
THRUSTER_TABLE = {**THRUSTER, **{name: row.effect for name, row in OUTSIDE.items()}}
VESSEL_TABLE = {**VESSEL, **{name: row.effect for name, row in VESSEL_OUTSIDE.items()}}
