"""What hangs together in a log whatever the vehicle: rates of positions, and what follows a drive.

A *tie* holds a channel against a series that follows from others of the same log. Geometry: the
heading turns at the yaw rate and positions move at the speeds, so the two are the same numbers.
Physics without its constants: thrust goes with the square of the speed of rotation, and speeds
follow what drives them, through some lag, in the same direction.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from diffthrust.soundness._record import Record

GEOMETRY, PHYSICS, DRIVE = "geometry", "physics", "drive"
_INFORMED = 0.3
"""A drive of two parts says something where it swings by this share of what its parts swing."""


_ONE_SIDED = 0.05
"""A series has one sign that goes beyond zero by no more than this share of its largest value."""


@dataclass(frozen=True)
class Tie:
    """A channel held against what follows from other channels.

    Args:
        channel: the channel.
        others: those that it is held against.
        words: what those say, for people.
        kind: ``geometry``, ``physics`` (they move at once) or ``drive`` (one follows the other).
        together: correlation of the two, -1 to 1; of a driven channel after the best lag.
        gain: the channel over what follows from the others.
        powers: by which power the gain grows with the scale of each channel, and of the time.
        seen: the channel, as compared, ``(m,)``.
        due: what follows from the others, ``(m,)``.
        equal: the gain must be one.
        drive: what drives it, before any lag, ``(m,)``; empty without a drive.
    """

    channel: str
    others: tuple[str, ...]
    words: str
    kind: str
    together: float
    gain: float
    powers: Mapping[str, int]
    seen: np.ndarray
    due: np.ndarray
    equal: bool = False
    drive: np.ndarray = field(default_factory=lambda: np.empty(0))


def ties(r: Record) -> tuple[Tie, ...]:
    """Every tie that the channels of a record allow and that moves enough to tell something."""
    tied = (*_geometry(r), *_physics(r), *(_driven(*drive) for drive in _drives(r)))
    return tuple(tie for tie in tied if np.isfinite(tie.together))


def _geometry(r: Record) -> Iterator[Tie]:
    v, half = r.values, max(1, r.size // 100)
    for channel, position in (("yaw_rate", "heading"), ("velocity", "position")):
        if r.has(position, channel):
            due = rate_over(v[position], half, r.step)
            powers = {channel: 1, position: -1, "time": 1}
            words = f"the rate of the {position}"
            yield _tie(channel, (position,), words, powers, mean_over(v[channel], half), due, True)
    if not r.has("north", "east", "heading", "surge"):
        return
    north, east = (rate_over(v[name], half, r.step) for name in ("north", "east"))
    heading = mean_over(v["heading"], half)
    cos, sin = np.cos(heading), np.sin(heading)
    for channel, due in (("surge", north * cos + east * sin), ("sway", east * cos - north * sin)):
        if r.has(channel):
            sources = ("north", "east", "heading")
            powers = {channel: 1, "north": -1, "east": -1, "time": 1}
            words = "the track, turned by the heading"
            measured = mean_over(v[channel], half)
            # sway depends on where along the hull it is taken: its size proves nothing
            yield _tie(channel, sources, words, powers, measured, due, channel == "surge")


def _physics(r: Record) -> Iterator[Tie]:
    swept = swept_speed(r) if r.has("speed", "thrust") else None
    if swept is not None and np.ptp(swept) > 0:
        powers = {"thrust": 1, "speed": -2}
        words = "the square of the speed"
        thrust = r.values["thrust"]
        yield _tie("thrust", ("speed",), words, powers, thrust, swept, False, PHYSICS)


_Drive = tuple[str, tuple[str, ...], str, Mapping[str, int], np.ndarray, np.ndarray]


def _drives(r: Record) -> Iterator[_Drive]:
    """What drives what, and in which direction, whatever the constants are."""
    v = r.values
    if "command" in r.inputs and r.has("command", "thrust"):
        powers = {"thrust": 1, "command": -1}
        yield "thrust", ("command",), "the command", powers, v["thrust"], v["command"]
    if "command" in r.inputs and r.has("command", "speed"):
        powers = {"speed": 2, "command": -1}
        speed, command = v["speed"], v["command"]
        if "speed" in r.unsigned:
            command = np.abs(command)
        yield "speed", ("command",), "the command", powers, speed * np.abs(speed), command
    for force in ("thrust", "force"):
        if force in r.inputs and r.has(force, "velocity"):
            powers = {"velocity": 1, force: -1}
            yield "velocity", (force,), f"the {force}", powers, v["velocity"], v[force]
    turning = "heading" if r.has("heading") and "yaw_rate" not in v else "yaw_rate"
    if r.has("left_force", "right_force"):
        sides = ("left_force", "right_force")
        least = _INFORMED * sum(float(np.ptp(v[side])) for side in sides)
        for channel, words, drive in (
            ("surge", "the sum of both forces", v[sides[0]] + v[sides[1]]),
            (turning, "the left force less the right one", v[sides[0]] - v[sides[1]]),
        ):
            if r.has(channel) and np.ptp(drive) > least:
                powers = {channel: 1, **dict.fromkeys(sides, -1)}
                yield channel, sides, words, powers, *_moving(r, channel, drive)
    if r.has("propeller_speed", "surge"):
        powers = {"surge": 1, "propeller_speed": -2}
        swept = v["propeller_speed"] * np.abs(v["propeller_speed"])
        drivers, words = ("propeller_speed",), "the square of the propeller's speed"
        yield "surge", drivers, words, powers, v["surge"], swept
    if "propeller_speed" in v and r.has("rudder_angle", turning):
        powers = {turning: 1, "rudder_angle": -1}
        drive = -v["rudder_angle"] * (v["propeller_speed"] > 0)
        drivers, words = ("rudder_angle",), "the rudder, which turns to port where positive"
        yield turning, drivers, words, powers, *_moving(r, turning, drive)


def _moving(r: Record, channel: str, drive: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What a drive moves, and the drive: of a heading its rate, which says what a yaw rate would.

    Of a Kingfisher only the heading was logged, and its two sides were exchanged.
    """
    if channel != "heading":
        return r.values[channel], drive
    half = max(1, r.size // 100)
    return rate_over(r.values[channel], half, r.step), mean_over(drive, half)


def swept_speed(r: Record) -> np.ndarray | None:
    """Speed |speed|, with the sign of the command where the sensor gives none."""
    speed = r.values["speed"]
    if "speed" not in r.unsigned:
        return speed * np.abs(speed)
    return speed**2 * np.sign(r.values["command"]) if r.has("command") else None


def mean_over(values: np.ndarray, half: int) -> np.ndarray:
    """Mean over windows of ``2 half`` steps (trapezoid), ``(n - 2 half,)``."""
    sums = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]))])
    return (sums[2 * half :] - sums[: -2 * half]) / (2 * half)


def rate_over(values: np.ndarray, half: int, step: float) -> np.ndarray:
    """Rate of change over the same windows."""
    return (values[2 * half :] - values[: -2 * half]) / (2 * half * step)


def _tie(
    channel: str,
    others: tuple[str, ...],
    words: str,
    powers: Mapping[str, int],
    seen: np.ndarray,
    due: np.ndarray,
    equal: bool,
    kind: str = GEOMETRY,
) -> Tie:
    together = correlation(due, seen)
    # neither side is without noise: the ratio of what they swing, not a regression
    gain = float(np.sign(together) * seen.std() / due.std()) if np.isfinite(together) else np.nan
    return Tie(channel, others, words, kind, together, gain, powers, seen, due, equal)


def correlation(first: np.ndarray, second: np.ndarray) -> float:
    """The correlation of two series, ``(n,)`` each; not a number where one does not move."""
    x, y = first - first.mean(), second - second.mean()
    power = float(x @ x) * float(y @ y)
    return float(x @ y) / power**0.5 if power > 0 else np.nan


LAGS = (0.0, 2.0, 6.0, 20.0, 60.0, 200.0, 600.0)
"""Time constants that are tried, in points; those above a third of the log are left out."""


def _driven(
    channel: str,
    others: tuple[str, ...],
    words: str,
    powers: Mapping[str, int],
    seen: np.ndarray,
    drive: np.ndarray,
) -> Tie:
    """The best of several first-order lags, each beside a start that decays and an offset.

    A vessel that still runs out when the log begins, or drifts, says nothing of its drive; so what
    an offset and a decay explain is taken away from both before they are held together.
    """
    best = (np.nan, np.nan, drive)
    same_side = _side(seen) * _side(drive) > 0
    power = float(np.sum((seen - seen.mean()) ** 2))
    moved = float(np.sum((drive - drive.mean()) ** 2))
    lags = tuple(lag for lag in LAGS if lag <= seen.size / 3)
    for lag, due in zip(lags, trailing(drive, lags), strict=True):
        if not power > 0 or not moved > 0:
            break
        decay = _decay(seen.size, lag)
        x, y = less(decay, due), less(decay, seen)
        xx = float(x @ x)
        if xx < 1e-3 * moved:
            continue
        together = float(x @ y) / np.sqrt(xx * power)
        if not abs(best[0]) >= abs(together):
            best = (together, float(x @ y) / xx, due)
    if same_side and best[0] < 0:
        # Revolutions and surge that never change sign agree in it, whatever moves them besides: a
        # ship that slows down in a turn at higher revolutions has no wrong sign.
        best = (np.nan, np.nan, drive)
    return Tie(channel, others, words, DRIVE, best[0], best[1], powers, seen, best[2], drive=drive)


def _side(values: np.ndarray) -> int:
    """The sign that a series never leaves, but for noise about zero; 0 where it takes both."""
    low, high = float(values.min()), float(values.max())
    most = _ONE_SIDED * max(abs(low), abs(high))
    return int(low > -most) - int(high < most)


def trailing(values: np.ndarray, lags: tuple[float, ...]) -> np.ndarray:
    """First-order lags of these numbers of points, settled at the first value, ``(k, n)``."""
    kernels, size = _kernels(lags, values.size)
    changes = np.fft.rfft(values - values[0], size)
    return values[0] + np.fft.irfft(kernels * changes, size, axis=1)[:, : values.size]


@lru_cache(maxsize=8)
def _kernels(lags: tuple[float, ...], count: int) -> tuple[np.ndarray, int]:
    """Transforms of the lags' answers to a blow, and their length."""
    size = 2 ** (2 * count - 1).bit_length()
    kept = np.array([np.exp(-1.0 / lag) if lag > 0 else 0.0 for lag in lags])[:, None]
    return np.fft.rfft((1.0 - kept) * kept ** np.arange(count), size, axis=1), size


@lru_cache(maxsize=32)
def _decay(count: int, lag: float) -> np.ndarray:
    """An orthonormal basis of an offset and a decaying start, ``(count, 1 or 2)``."""
    columns = [np.ones(count)]
    if lag > 0:
        columns.append(np.exp(-np.arange(count) / lag))
    return np.linalg.qr(np.stack(columns, axis=1))[0]


def less(basis: np.ndarray, values: np.ndarray) -> np.ndarray:
    """What a basis leaves of a series."""
    return values - basis @ (basis.T @ values)
