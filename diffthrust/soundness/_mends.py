"""Single mistakes, and what undoes them: a sign, an exchange, the unit of a channel or a clock."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from diffthrust.soundness._doubt import Reading
from diffthrust.soundness._record import Record

FACTORS: dict[str, tuple[tuple[str, float], ...]] = {
    "rad/s": (("deg/s", np.pi / 180), ("rpm", np.pi / 30), ("Hz or rev/s", 2 * np.pi)),
    "rev/s": (("rpm", 1 / 60), ("rad/s", 0.5 / np.pi)),
    "rad": (("deg", np.pi / 180),),
    "N": (("kgf", 9.80665), ("lbf", 4.4482216), ("kN", 1e3), ("gf", 9.80665e-3)),
    "V": (("mV", 1e-3),),
    "m/s": (("knot", 0.514444), ("km/h", 1 / 3.6), ("mm/s", 1e-3), ("cm/s", 1e-2)),
    "m": (("mm", 1e-3), ("cm", 1e-2), ("ft", 0.3048), ("km", 1e3)),
    "s": (("ms", 1e-3), ("min", 60.0)),
}
"""Units that are mistaken for the one a channel has, and what one of each is in it."""
UNITS = {
    "command": "V",
    "speed": "rad/s",
    "thrust": "N",
    "force": "N",
    "propeller_speed": "rev/s",
    "rudder_angle": "rad",
    "left_force": "N",
    "right_force": "N",
    "surge": "m/s",
    "sway": "m/s",
    "yaw_rate": "rad/s",
    "north": "m",
    "east": "m",
    "heading": "rad",
    "position": "m",
    "velocity": "m/s",
    "time": "s",
}
"""In which unit the checks take each channel."""
PAIRS = (
    ("left_force", "right_force"),
    ("north", "east"),
    ("surge", "sway"),
    ("position", "velocity"),
)
"""Channels that are exchanged by mistake."""
SIGNED = (
    *("rudder_angle", "yaw_rate", "thrust", "surge", "sway", "heading", "north", "east"),
    *("velocity", "position", "speed", "command", "force", "propeller_speed"),
)
"""Channels whose sign may be another convention's; where two would do, the first is named."""


Mend = tuple[str, Reading]
"""The kind of a mistake, and how its channels are read without it; the first of them is named."""


def signs(r: Record) -> Iterator[Mend]:
    """One channel with the other sign."""
    for channel in SIGNED:
        if r.has(channel) and channel not in r.unsigned:
            line = sign_line(channel, r.scales.get(channel, 1.0))
            words = f"the sign of {channel} reversed"
            yield "sign", Reading(words, line, {channel: (channel, -1.0)})


def exchanges(r: Record) -> Iterator[Mend]:
    """Two channels in each other's place."""
    for first, second in PAIRS:
        if first in r.values and second in r.values:
            words, line = f"{first} and {second} exchanged", exchange_line(first, second)
            places = {first: (second, 1.0), second: (first, 1.0)}
            yield "exchanged", Reading(words, line, places)


STEPS = (1e-4, 2.0)
"""Steps [s] beyond which logs of thrusters and vessels are not taken."""


def clocks(r: Record, ratio: float) -> Iterator[Mend]:
    """Time that runs ``ratio`` times too fast, where its true step is one of a log."""
    if not STEPS[0] <= r.step * ratio <= STEPS[1]:
        return
    for unit, scale in unit_factors("time").items():
        if abs(np.log(ratio / scale)) < 0.15:
            yield "time_base", unit_reading("time", unit, scale)
            return
    words = f"time {ratio:.4g} times as long"
    yield "time_base", Reading(words, clock_line(ratio), {"time": ("time", ratio)})


def rescaled(r: Record) -> Iterator[Mend]:
    """One channel in another unit; and the reverse, a unit given that it has not."""
    for channel in r.values:
        for unit, scale in unit_factors(channel).items():
            yield "unit", unit_reading(channel, unit, scale)


def unit_factors(channel: str) -> dict[str, float]:
    """The units that a channel may be in instead, and what one of each is in the present one.

    Where it has one of these by mistake, the unit is such as ``"rad, not deg"``.
    """
    present, factors = UNITS.get(channel, ""), {}
    for unit, factor in FACTORS.get(present, ()):
        factors |= {unit: factor, f"{present}, not {unit}": 1 / factor}
    return factors


def unit_reading(channel: str, unit: str, scale: float) -> Reading:
    """A channel in another unit, of which one is ``scale`` of the present one."""
    words = f"{channel} in {unit}"
    return Reading(words, unit_line(channel, unit), {channel: (channel, scale)})


def named_unit(channel: str, unit: str) -> tuple[Reading, ...]:
    """The reading of a channel in one of its `unit_factors`; none in any other unit."""
    scale = unit_factors(channel).get(unit)
    return () if scale is None else (unit_reading(channel, unit, scale),)


def clock_line(ratio: float) -> str:
    """What makes a clock run ``ratio`` times as long."""
    return f"Column(..., scale={ratio:.4g}) for the time, or the true rate of the samples."


def sign_line(channel: str, scale: float = 1.0) -> str:
    """What turns the sign of a channel round, whose column is scaled already."""
    return (
        f'[channels.{channel}] scale = {-scale:g}, or "{channel}": Column(..., scale={-scale:g}).'
    )


def exchange_line(first: str, second: str) -> str:
    """What puts two channels in their places."""
    return f"give {first} the column of {second}, and {second} that of {first}."


def unit_line(channel: str, unit: str) -> str:
    """What names another unit; ``"rad/s, not rpm"`` where it is the unit given that is wrong."""
    wanted, _, wrong = unit.partition(", not ")
    if " or " in wanted:
        wanted = wanted.split(" or ")[1]
    beside = f" (its numbers are not in {wrong})" if wrong else ""
    if channel == "time":
        spec = f'time = {{ column = ..., unit = "{wanted}" }}'
        return f'{spec}, or Column(..., unit="{wanted}"){beside}.'
    python = f'"{channel}": Column(..., unit="{wanted}")'
    return f'[channels.{channel}] unit = "{wanted}", or {python}{beside}.'
