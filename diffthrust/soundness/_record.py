"""A log as its checks see it: unbroken series on an even grid, short enough to be quick.

Beside it what is done with such series (means, rates, lags and correlations), and what hangs
together in them whatever the vehicle. A *tie* holds a channel against a series that follows from
others of the same log. Geometry: the heading turns at the yaw rate and positions move at the
speeds, so the two are the same numbers. Physics without its constants: thrust goes with the square
of the speed of rotation, and speeds follow what drives them, through some lag, in the same
direction.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
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
GEOMETRY, PHYSICS, DRIVE = "geometry", "physics", "drive"
OPPOSED = -0.6
"""Correlation of a channel with what it must follow from which on it is taken to oppose it. Of 67
sound logs, measured ones, the lowest was -0.2; of 53 whose heading stood for the yaw rate -0.26."""
FIRM = 0.8
"""Correlation from which on the two are taken to agree, and their ratio to mean something."""
LOOSE = 0.5
"""Correlation below which what must be the same numbers is taken not to be."""
_INFORMED = 0.3
"""A drive of two parts says something where it swings by this share of what its parts swing."""
_ONE_SIDED = 0.05
"""A series has one sign that goes beyond zero by no more than this share of its largest value."""
_LAGS = (0.0, 2.0, 6.0, 20.0, 60.0, 200.0, 600.0)
"""Time constants that are tried, in points; those above a third of the log are left out."""


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


# -- what hangs together ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Tie:
    """A channel held against what follows from other channels.

    ``powers`` has by which power the gain grows with the scale of each channel, and of the time;
    ``seen`` is the channel and ``due`` what follows from the others, ``(m,)``; ``drive`` is what
    drives it, before any lag. ``together`` is their correlation, of a driven channel after the best
    lag, and ``gain`` the channel over what follows, which must be one where they are ``equal``.
    Kinds are geometry, physics (they move at once) and drive (one follows the other).
    """

    channel: str
    words: str
    powers: Mapping[str, int]
    kind: str
    seen: np.ndarray
    due: np.ndarray
    together: float
    gain: float
    equal: bool = False
    drive: np.ndarray = field(default_factory=lambda: np.empty(0))

    @property
    def others(self) -> tuple[str, ...]:
        """Those that the channel is held against."""
        return tuple(name for name in self.powers if name not in (self.channel, "time"))

    @property
    def key(self) -> tuple[str, str]:
        """By which the same tie is found in other logs."""
        return self.channel, self.words


def ties(r: Record) -> tuple[Tie, ...]:
    """Every tie that the channels of a record allow and that moves enough to tell something."""
    tied = (*_at_once(r), *(_driven(*drive) for drive in _drives(r)))
    return tuple(tie for tie in tied if np.isfinite(tie.together))


def _at_once(r: Record) -> Iterator[Tie]:
    """Geometry, and the physics of what follows without a lag."""
    for channel, position in (("yaw_rate", "heading"), ("velocity", "position")):
        if r.has(position, channel):
            powers = {channel: 1, position: -1, "time": 1}
            words = f"the rate of the {position}"
            seen, due = r.mean(channel), r.rate(position)
            yield _tie(words, powers, seen, due, GEOMETRY, equal=True)
    if r.has("north", "east", "heading", "surge"):
        for channel, due in r.track().items():
            if r.has(channel):
                powers = {channel: 1, "north": -1, "east": -1, "heading": 0, "time": 1}
                words = "the track, turned by the heading"
                seen = r.mean(channel)
                # sway depends on where along the hull it is taken: its size proves nothing
                yield _tie(words, powers, seen, due, GEOMETRY, equal=channel == "surge")
    speed = r.signed_speed() if r.has("speed", "thrust") else None
    if speed is not None and np.ptp(swept := speed * np.abs(speed)) > 0:
        powers = {"thrust": 1, "speed": -2}
        yield _tie("the square of the speed", powers, r.values["thrust"], swept, PHYSICS)


_Drive = tuple[str, Mapping[str, int], np.ndarray, np.ndarray]
"""Words and powers, the first of the channel that is driven; the channel, and what drives it."""


def _drives(r: Record) -> Iterator[_Drive]:
    """What drives what, and in which direction, whatever the constants are."""
    v = r.values
    if "command" in r.inputs and r.has("command", "thrust"):
        yield "the command", {"thrust": 1, "command": -1}, v["thrust"], v["command"]
    if "command" in r.inputs and r.has("command", "speed"):
        command = np.abs(v["command"]) if "speed" in r.unsigned else v["command"]
        swept = v["speed"] * np.abs(v["speed"])
        yield "the command", {"speed": 2, "command": -1}, swept, command
    for force in ("thrust", "force"):
        if force in r.inputs and r.has(force, "velocity"):
            yield f"the {force}", {"velocity": 1, force: -1}, v["velocity"], v[force]
    turning = "heading" if r.has("heading") and "yaw_rate" not in v else "yaw_rate"
    if r.has("left_force", "right_force"):
        left, right = v["left_force"], v["right_force"]
        least = _INFORMED * (float(np.ptp(left)) + float(np.ptp(right)))
        for channel, words, drive in (
            ("surge", "the sum of both forces", left + right),
            (turning, "the left force less the right one", left - right),
        ):
            if r.has(channel) and np.ptp(drive) > least:
                powers = {channel: 1, "left_force": -1, "right_force": -1}
                yield words, powers, *_moving(r, channel, drive)
    if r.has("propeller_speed", "surge"):
        swept = v["propeller_speed"] * np.abs(v["propeller_speed"])
        powers = {"surge": 1, "propeller_speed": -2}
        yield "the square of the propeller's speed", powers, v["surge"], swept
    if "propeller_speed" in v and r.has("rudder_angle", turning):
        drive = -v["rudder_angle"] * (v["propeller_speed"] > 0)
        words = "the rudder, which turns to port where positive"
        yield words, {turning: 1, "rudder_angle": -1}, *_moving(r, turning, drive)


def _moving(r: Record, channel: str, drive: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What a drive moves, and the drive: of a heading its rate, which says what a yaw rate would.

    Of a Kingfisher only the heading was logged, and its two sides were exchanged.
    """
    if channel != "heading":
        return r.values[channel], drive
    return r.rate(channel), mean_over(drive, r.half)


def _tie(
    words: str,
    powers: Mapping[str, int],
    seen: np.ndarray,
    due: np.ndarray,
    kind: str,
    equal: bool = False,
) -> Tie:
    together = correlation(due, seen)
    # neither side is without noise: the ratio of what they swing, not a regression
    gain = float(np.sign(together) * seen.std() / due.std()) if np.isfinite(together) else np.nan
    return Tie(next(iter(powers)), words, powers, kind, seen, due, together, gain, equal)


def _driven(words: str, powers: Mapping[str, int], seen: np.ndarray, drive: np.ndarray) -> Tie:
    """The best of several first-order lags, each beside a start that decays and an offset.

    A vessel that still runs out when the log begins, or drifts, says nothing of its drive; so what
    an offset and a decay explain is taken away from both before they are held together.
    """
    nothing = best = (np.nan, np.nan, drive)
    power = float(np.sum((seen - seen.mean()) ** 2))
    moved = float(np.sum((drive - drive.mean()) ** 2))
    lags = [lag for lag in _LAGS if lag <= seen.size / 3 and power > 0 and moved > 0]
    for lag in lags:
        (due,) = trailing(drive, [lag])
        decay = _decay(seen.size, lag)
        x, y = less(decay, due), less(decay, seen)
        xx = float(x @ x)
        if xx < 1e-3 * moved:
            continue
        together = float(x @ y) / np.sqrt(xx * power)
        if not abs(best[0]) >= abs(together):
            best = (together, float(x @ y) / xx, due)
    if best[0] < 0 and _side(seen) * _side(drive) > 0:
        # Revolutions and surge that never change sign agree in it, whatever moves them besides: a
        # ship that slows down in a turn at higher revolutions has no wrong sign.
        best = nothing
    together, gain, due = best
    channel = next(iter(powers))
    return Tie(channel, words, powers, DRIVE, seen, due, together, gain, drive=drive)


def _side(values: np.ndarray) -> int:
    """The sign that a series never leaves, but for noise about zero; 0 where it takes both."""
    low, high = float(values.min()), float(values.max())
    most = _ONE_SIDED * max(abs(low), abs(high))
    return int(low > -most) - int(high < most)


@lru_cache(maxsize=32)
def _decay(count: int, lag: float) -> np.ndarray:
    """An orthonormal basis of an offset and a decaying start, ``(count, 1 or 2)``."""
    columns = [np.ones(count)]
    if lag > 0:
        columns.append(np.exp(-np.arange(count) / lag))
    return np.linalg.qr(np.stack(columns, axis=1))[0]
