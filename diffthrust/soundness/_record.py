"""A log as its checks see it: unbroken series on an even grid, short enough to be quick.

Beside it what is done with such series: means, rates, lags and correlations.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from diffthrust._support.lag import lagged
from diffthrust._support.words import number
from diffthrust.logs._log import Log
from diffthrust.logs._written import ShownUnits, Size

_POINTS = 2048
"""Largest number of points on which relations are examined (means of longer logs)."""
_FEW = 40
"""Fewer samples tell nothing of how channels hang together."""
TURNS = {"rad": 2 * np.pi, "deg": 360.0, "shrunk": np.pi**2 / 90}
"""A full turn in stored numbers: of an angle in rad, in deg that was called rad, and in rad that
was called deg."""
ANGLES = ("heading", "wind_direction")
"""Channels that jump by a full turn."""


class Series(NamedTuple):
    """The finite samples of a channel of a log, ``(n,)``, and where they stand in it."""

    log: Log
    channel: str
    values: np.ndarray
    where: np.ndarray

    @classmethod
    def of(cls, log: Log, channel: str) -> Series:
        """Those of one channel."""
        samples = {**log.inputs, **log.measured}[channel]
        where = np.flatnonzero(np.isfinite(samples))
        return cls(log, channel, samples[where], where)

    def written(self, value: float) -> float:
        """A stored number in the unit in which the user wrote the channel."""
        units = ShownUnits([self.log.written])
        return float(units.values(self.channel, value, self.log.units[self.channel]))

    def shown(self, value: float) -> str:
        """A stored number as text, with the user's unit."""
        return f"{number(self.written(value), 4)} {self.width(0.0).unit}".rstrip()

    def width(self, width: float) -> Size:
        """A difference of two stored numbers in the user's unit."""
        units = ShownUnits([self.log.written])
        return units.size(self.channel, width, self.log.units[self.channel])

    def width_shown(self, width: float) -> str:
        """The same as text."""
        value, unit = self.width(width)
        return f"{number(value, 3)} {unit}".rstrip()


@dataclass(frozen=True)
class Record:
    """Channels of one log on an even grid of ``step`` [s], ``(n,)`` each; angles in rad, unwrapped.

    ``turns`` are the sizes of the jumps of angles, as words of ``TURNS``, and ``scales`` what
    columns were multiplied by.
    """

    step: float
    values: Mapping[str, np.ndarray]
    inputs: frozenset[str]
    unsigned: frozenset[str]
    turns: Mapping[str, str]
    scales: Mapping[str, float]

    @property
    def size(self) -> int:
        """Number of points."""
        return next(iter(self.values.values())).size

    def has(self, *channels: str) -> bool:
        """Whether all these channels are there, and move."""
        return all(c in self.values and np.ptp(self.values[c]) > 0 for c in channels)

    @property
    def half(self) -> int:
        """Half of the window, in points, over which rates are taken."""
        return max(1, self.size // 100)

    def mean(self, channel: str) -> np.ndarray:
        """Means of a channel over the windows of the rates, ``(n - 2 half,)``."""
        return mean_over(self.values[channel], self.half)

    def rate(self, channel: str) -> np.ndarray:
        """Rates of change of a channel over those windows [1/s]."""
        values = self.values[channel]
        span = 2 * self.half
        return (values[span:] - values[:-span]) / (span * self.step)

    def track(self) -> dict[str, np.ndarray]:
        """The speeds ahead and to starboard by the positions, turned by the heading."""
        north, east, heading = self.rate("north"), self.rate("east"), self.mean("heading")
        cos, sin = np.cos(heading), np.sin(heading)
        return {"surge": north * cos + east * sin, "sway": east * cos - north * sin}

    def signed_speed(self) -> np.ndarray | None:
        """The speed, with the sign of the command where its sensor gives none."""
        speed = self.values["speed"]
        if "speed" not in self.unsigned:
            return speed
        return np.abs(speed) * np.sign(self.values["command"]) if self.has("command") else None

    def under(self, sources: Mapping[str, tuple[str, float]]) -> Record:
        """The record where channels are read as the ``sources`` of a `Reading` say."""
        sources = dict(sources)
        _, clock = sources.pop("time", ("time", 1.0))
        values = {name: factor * self.values[source] for name, (source, factor) in sources.items()}
        return replace(self, step=clock * self.step, values={**self.values, **values})


def stretch(log: Log) -> Log:
    """The middle of a long log, every sample of it; a shorter log as it is."""
    spare = (len(log) - _POINTS) // 2
    if spare <= 0:
        return log
    return log.slice(log.time[spare] - log.time[0], log.time[-1 - spare] - log.time[0])


def record(log: Log) -> Record | None:
    """A log on an even grid; ``None`` where it is too short to tell anything."""
    count = min(len(log), _POINTS)
    if count < _FEW:
        return None
    grid = np.linspace(log.time[0], log.time[-1], count)
    values, turns = {}, {}
    for name, samples in {**log.inputs, **log.measured}.items():
        finite = np.isfinite(samples)
        if finite.sum() < _FEW:
            continue
        time, here = log.time[finite], samples[finite]
        if name in ANGLES:
            turn = jumps(here)
            if turn:
                turns[name] = turn
                # the jumps show a wrong unit, which is corrected for the checks that follow
                here = np.unwrap(here, period=TURNS[turn]) * (TURNS["rad"] / TURNS[turn])
        if time.size > 2 * _POINTS:  # means, not samples, so that noise falls as it should
            kept = time.size // (time.size // _POINTS) * (time.size // _POINTS)
            blocks = (-1, time.size // _POINTS)
            time, here = (x[:kept].reshape(blocks).mean(axis=1) for x in (time, here))
        values[name] = np.interp(grid, time, here)
    if not values:
        return None
    return Record(
        step=float(grid[1] - grid[0]),
        values=values,
        inputs=frozenset(log.inputs),
        unsigned=frozenset(log.unsigned),
        turns=turns,
        scales={name: way.scale for name, way in log.written.items()},
    )


def jumps(values: np.ndarray) -> str:
    """By which full turn an angle jumps, a word of ``TURNS``; empty where it does not."""
    if values.size < 3:
        return ""
    steps = np.abs(np.diff(values))
    most, usual, span = float(steps.max()), float(np.median(steps)), float(np.ptp(values))
    for word, turn in TURNS.items():
        if 0.8 * turn < most <= span < 1.03 * turn and most > 20 * usual:
            return word
    return ""


def mean_over(values: np.ndarray, half: int) -> np.ndarray:
    """Mean over windows of ``2 half`` steps (trapezoid), ``(n - 2 half,)``."""
    sums = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]))])
    return (sums[2 * half :] - sums[: -2 * half]) / (2 * half)


def correlation(first: np.ndarray, second: np.ndarray) -> float:
    """The correlation of two series, ``(n,)`` each; not a number where one does not move."""
    x, y = first - first.mean(), second - second.mean()
    power = float(x @ x) * float(y @ y)
    return float(x @ y) / power**0.5 if power > 0 else np.nan


def less(basis: np.ndarray, values: np.ndarray) -> np.ndarray:
    """What an orthonormal basis leaves of a series."""
    return values - basis @ (basis.T @ values)


def trailing(values: np.ndarray, lags: Iterable[float]) -> np.ndarray:
    """First-order lags of these numbers of points, settled at the first value, ``(k, n)``."""
    kept = [np.exp(-1.0 / lag) if lag > 0 else 0.0 for lag in lags]
    shares = (np.full(values.size - 1, share) for share in kept)
    return np.stack([lagged(values[:1], values[1:, None], share)[:, 0] for share in shares])
