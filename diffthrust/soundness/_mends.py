"""Single mistakes, and what undoes them: a sign, an exchange, the unit of a channel or a clock."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from diffthrust.logs._units import CHANNEL_UNITS
from diffthrust.soundness._doubt import Doubt, Reading
from diffthrust.soundness._record import ANGLES, Record

_FACTORS: dict[str, tuple[tuple[str, float], ...]] = {
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
_PAIRS = (
    ("left_force", "right_force"),
    ("north", "east"),
    ("surge", "sway"),
    ("position", "velocity"),
)
"""Channels that are exchanged by mistake."""
_SIGNED = (
    *("rudder_angle", "yaw_rate", "thrust", "surge", "sway", "heading", "north", "east"),
    *("velocity", "position", "speed", "command", "force", "propeller_speed"),
)
"""Channels whose sign may be another convention's; where two would do, the first is named."""
UNITS = {
    **{
        name: CHANNEL_UNITS.get(name, "N")
        for name in (*_SIGNED, *ANGLES, "left_force", "right_force")
    },
    "time": "s",
}
"""In which unit the checks take each channel."""
STEPS = (1e-4, 2.0)
"""Steps [s] beyond which logs of thrusters and vessels are not taken."""

Mend = tuple[str, Reading]
"""The kind of a mistake, and how its channels are read without it; the first of them is named."""


def signs(r: Record) -> Iterator[Mend]:
    """One channel with the other sign."""
    for channel in _SIGNED:
        if r.has(channel) and channel not in r.unsigned:
            line = sign_line(channel, r.scales.get(channel, 1.0))
            words = f"the sign of {channel} reversed"
            yield "sign", Reading(words, line, {channel: (channel, -1.0)})


def exchanges(r: Record) -> Iterator[Mend]:
    """Two channels in each other's place."""
    for first, second in _PAIRS:
        if first in r.values and second in r.values:
            words, line = f"{first} and {second} exchanged", exchange_line(first, second)
            places = {first: (second, 1.0), second: (first, 1.0)}
            yield "exchanged", Reading(words, line, places)


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
    for unit, factor in _FACTORS.get(present, ()):
        factors |= {unit: factor, f"{present}, not {unit}": 1 / factor}
    return factors


def unit_reading(channel: str, unit: str, scale: float) -> Reading:
    """A channel in another unit, of which one is ``scale`` of the present one."""
    line = unit_line(channel, unit)
    return Reading(f"{channel} in {unit}", line, {channel: (channel, scale)})


def unit_doubt(channel: str, evidence: str, unit: str) -> Doubt:
    """A doubt on a unit, with a reading where the other one is of the `unit_factors`."""
    scale = unit_factors(channel).get(unit)
    readings = () if scale is None else (unit_reading(channel, unit, scale),)
    return Doubt(channel, "unit", evidence, unit_line(channel, unit), readings)


def clock_line(ratio: float) -> str:
    """What makes a clock run ``ratio`` times as long."""
    return f"Column(..., scale={ratio:.4g}) for the time, or the true rate of the samples."


def sign_line(channel: str, scale: float) -> str:
    """What turns the sign of a channel round, whose column is scaled already."""
    python = f'"{channel}": Column(..., scale={-scale:g})'
    return f"[channels.{channel}] scale = {-scale:g}, or {python}."


def exchange_line(first: str, second: str) -> str:
    """What puts two channels in their places."""
    return f"give {first} the column of {second}, and {second} that of {first}."


def unit_line(channel: str, unit: str) -> str:
    """What names another unit; ``"rad/s, not rpm"`` where it is the unit given that is wrong."""
    wanted, _, wrong = unit.partition(", not ")
    wanted = wanted.rpartition(" or ")[2]
    beside = f" (its numbers are not in {wrong})" if wrong else ""
    if channel == "time":
        spec, key = f'time = {{ column = ..., unit = "{wanted}" }}', ""
    else:
        spec, key = f'[channels.{channel}] unit = "{wanted}"', f'"{channel}": '
    return f'{spec}, or {key}Column(..., unit="{wanted}"){beside}.'
