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

from diffthrust.soundness._record import Record, correlation, less, mean_over, trailing

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
