"""A doubt about a channel of a log, and the single mistakes that may be undone.

A sign, an exchange, the unit of a channel or a clock: how channels are read without it, and what to
write for that.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.words import number
from diffthrust.logs._log import Log
from diffthrust.logs._units import CHANNEL_UNITS
from diffthrust.soundness._record import ANGLES, Record

DOUBT_KINDS = (
    *("sign", "exchanged", "frame", "unit", "time_base", "lag", "stuck", "saturated", "sentinel"),
    *("outliers", "gap", "odd_log", "silent", "runaway"),
)
"""What may be wrong with a channel, the graver mistakes first; "runaway" is of a parameter."""
_LONGEST_STAMP = 1e5
"""Display: of stamps of a clock that counts since 1970 the first four digits say nothing: an
Otter's compass stood still "from t = 1.714e+09 s on"."""


@dataclass(frozen=True)
class Reading:
    """How channels are read where one mistake is undone.

    Args:
        words: what is done, such as "left_force and right_force exchanged".
        line: what to write in a spec file and in Python.
        sources: for each channel that changes (or ``"time"``), the channel that its numbers come
            from, and what they are multiplied by.

    Example:
        >>> turned = dft.soundness.Reading("turned", "scale = -1", {"thrust": ("thrust", -1)})
        >>> bool((turned.log(log).measured["thrust"] == -log.measured["thrust"]).all())
        True
    """

    words: str
    line: str
    sources: Mapping[str, tuple[str, float]] = field(default_factory=dict)

    def log(self, log: Log) -> Log:
        """A log as it would be without the mistake; itself where it lacks a channel of it."""
        values = {"time": log.time, **log.inputs, **log.measured}
        if not {source for source, _ in self.sources.values()} <= set(values):
            return log
        new = {name: factor * values[source] for name, (source, factor) in self.sources.items()}
        # the ends of a range and the noise of a sensor go with its numbers
        origins = {name: self.sources.get(name, (name, 1.0)) for name in values}
        return log.replaced(
            time=new.get("time", log.time),
            inputs={name: new.get(name, x) for name, x in log.inputs.items()},
            measured={name: new.get(name, x) for name, x in log.measured.items()},
            rails={
                name: tuple(sorted(factor * end for end in log.rails[source]))
                for name, (source, factor) in origins.items()
                if source in log.rails
            },
            noise={
                name: abs(factor) * log.noise[source]
                for name, (source, factor) in origins.items()
                if source in log.noise
            },
        )


@dataclass(frozen=True)
class Doubt:
    """Something in a log that is probably not what its name, unit or clock says.

    Args:
        channel: the channel that is doubted, or ``"time"``; of a fit also a parameter.
        kind: one of ``sign``, ``exchanged``, ``unit``, ``time_base``, ``lag``, ``stuck``,
            ``saturated``, ``sentinel``, ``outliers``, ``gap``, ``odd_log``, ``silent``,
            ``runaway``.
        evidence: what was seen, with its figures; names the log.
        mend: a line to copy, or what to look at.
        readings: how channels are read where the mistake is undone, the likeliest first; several
            where these logs cannot tell which it was, none where no other reading undoes it.
        logs: names of the logs that it concerns; empty for all of them.
        also: other channels of which the same is true.

    Example:
        >>> reversed_sign = dft.Log(
        ...     log.time, log.inputs, {**log.measured, "thrust": -log.measured["thrust"]}
        ... )
        >>> doubt = dft.soundness.doubts(reversed_sign, dft.Thruster())[0]
        >>> doubt.channel, doubt.kind, doubt.contrary, doubt.harmless, list(doubt.to_json())
        ('thrust', 'sign', True, False, ['channel', 'kind', 'evidence', 'mend'])
        >>> (mended,) = doubt.mended([reversed_sign])
        >>> bool((mended.measured["thrust"] == log.measured["thrust"]).all())
        True
    """

    channel: str
    kind: str
    evidence: str
    mend: str
    readings: tuple[Reading, ...] = ()
    logs: tuple[str, ...] = ()
    also: tuple[str, ...] = ()

    @property
    def contrary(self) -> bool:
        """Whether the channel moves against the others: its sign is doubted, or its column."""
        return self.kind in ("sign", "exchanged")

    @property
    def harmless(self) -> bool:
        """Whether fits allow for it already, so that nothing is to be mended."""
        return self.mend.startswith("none is needed")

    def mended(self, logs: Iterable[Log], reading: int = 0) -> tuple[Log, ...]:
        """The logs as they would be without the mistake.

        Args:
            logs: of the call that raised the doubt; those that it does not concern stay.
            reading: which of ``readings``.

        Raises:
            InputError: the doubt has no such reading.
        """
        if not 0 <= reading < len(self.readings):
            raise InputError(
                f"This doubt on {self.channel} has {len(self.readings)} readings that undo it, "
                f"found number {reading}.",
                f"Look at its mend: {self.mend}",
            )
        return tuple(
            self.readings[reading].log(log) if not self.logs or log.name in self.logs else log
            for log in logs
        )

    def __str__(self) -> str:
        return f"{self.channel} ({self.kind}): {self.evidence} Mend: {self.mend}"

    def to_json(self) -> dict[str, str]:
        """Plain data."""
        return {name: getattr(self, name) for name in ("channel", "kind", "evidence", "mend")}


def moment(log: Log, time: float) -> str:
    """A time stamp in words; since the log's start where four digits do not show it."""
    if abs(time) < _LONGEST_STAMP:
        return f"t = {number(time)} s"
    return f"{number(time - float(log.time[0]))} s after its start"


# -- single mistakes, and what undoes them ---------------------------------------------------------

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
