"""Sensors that repeat themselves: stuck, clipped, coarse, slower than the log, or dead."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from diffthrust._support.correlation import lag_one
from diffthrust._support.words import joined, number
from diffthrust.logs._log import Log
from diffthrust.logs._rails import Railed
from diffthrust.soundness._doubt import Doubt, moment
from diffthrust.soundness._record import Series

_LEAST = 20
"""Samples of one value from which on a sensor may be stuck or clipped."""
_SHARE = 0.03
"""That share of the log, too."""
_MOVED = 0.3
"""Others must have moved by this share of their range meanwhile (10th to 90th percentile)."""
_COARSE = 12
"""Fewer steps over its range than this make a sensor coarse."""
_BROAD = 0.03
"""Steps of this share of the range, and more, are so broad that a sensor rests on its last one."""
_REGULAR = 0.8
"""Share of the waits between two readings that must be equal (or differ by one sample)."""
_ANSWERS = ("speed", "thrust", "velocity", "surge", "position")
"""Channels that must answer to any drive."""
_SURROUNDINGS = ("inflow", "supply_voltage", "wind_speed", "wind_direction", "heading")
"""Inputs that drive nothing by themselves."""


class _Runs(NamedTuple):
    """Stretches of equal values: where they begin, how long they are, their value."""

    start: np.ndarray
    length: np.ndarray
    value: np.ndarray


class _Stuck(NamedTuple):
    """A stretch in which a channel stays at a value: from when on, and how many samples."""

    channel: str
    begin: float
    length: int
    value: str


def repeating(log: Log) -> Iterator[Doubt]:
    """Doubts on measured channels that hold their values. Inputs may hold theirs."""
    moving = {c: v for c, v in {**log.inputs, **log.measured}.items() if _moves(v)}
    drives = [c for c in moving if c in log.inputs and c not in _SURROUNDINGS]
    moved = f"while {joined(drives)} moved."
    stuck: list[_Stuck] = []
    for channel in log.measured:
        s = Series.of(log, channel)
        if s.values.size < 3 * _LEAST:
            continue
        doubt = None
        if channel not in moving:
            if drives:
                evidence = f"{channel} is {s.shown(s.values[0])} in every sample, {moved}"
                mend = f"look whether the sensor of {channel} was on, or take the channel out."
                yield Doubt(channel, "silent", evidence, mend)
            continue
        ends = log.railed.get(channel)
        if np.count_nonzero(s.values[1:] == s.values[:-1]) >= _LEAST - 1:
            start = np.flatnonzero(np.append(True, s.values[1:] != s.values[:-1]))
            runs = _Runs(start, np.diff(np.append(start, s.values.size)), s.values[start])
            doubt = _slow(s, runs) or _coarse(s) or _resting(s, runs)
            if doubt is None and ends is None and (stop := _stuck(s, runs, moving)):
                stuck.append(stop)
                continue
        if doubt is None and ends is not None and channel not in log.rails:
            doubt = _saturated(s, ends)
        if doubt:
            yield doubt
        elif channel in _ANSWERS and drives and _only_noise(log, drives, s.values):
            evidence = f"{channel} is white noise and nothing else, {moved}"
            mend = f"look at the wiring of {channel}, and whether it is the right column."
            yield Doubt(channel, "silent", evidence, mend)
    for stretch in dict.fromkeys((stop.begin, stop.length) for stop in stuck):
        yield _stopped(log, [stop for stop in stuck if (stop.begin, stop.length) == stretch])


def _moves(values: np.ndarray) -> bool:
    finite = values[np.isfinite(values)]
    return finite.size > 0 and np.ptp(finite) > 0


def _slow(s: Series, runs: _Runs) -> Doubt | None:
    """Readings at a lower rate than the log's, or at irregular times, held in between."""
    waits = runs.length[1:-1]
    hold = s.log.holds.get(s.channel)
    counted = "none is needed: fits count the readings alone."
    if hold is not None and not hold.regular:
        evidence = (
            f"{s.channel} repeats its last reading until the next arrives, after "
            f"{hold.seconds(s.log.time)}: {hold.readings} of {s.values.size} samples are readings."
        )
        mend = (
            f"{counted} If they are stamped on arrival, their age is unknown; the time at which "
            f"{s.channel} was measured tells more."
        )
        return Doubt(s.channel, "stuck", evidence, mend)
    usual = float(np.median(waits)) if waits.size >= 15 else 0.0
    if usual < 3 or np.mean(np.abs(waits - usual) <= 1) < _REGULAR:
        return None
    evidence = (
        f"{s.channel} changes every {usual:.0f} samples only ({number(usual * s.log.step, 3)} s) "
        "and is held in between: the sensor is slower than the log."
    )
    mend = f"{counted} A faster {s.channel} tells more."
    if hold is None:
        kept = f"keep the first sample of each reading of {s.channel}"
        mend = f"{kept} and leave the others empty (nan)."
    return Doubt(s.channel, "stuck", evidence, mend)


def _coarse(s: Series) -> Doubt | None:
    """Few levels, far apart, between which a signal climbs that has a memory."""
    levels = np.unique(s.values)
    if not 3 <= levels.size <= 2 * _COARSE:
        return None
    few = np.ptp(levels) <= _COARSE * np.diff(levels).min() * (1 + 1e-9)
    rests = few and lag_one([s.values]) >= 0.9 and np.mean(s.values[1:] == s.values[:-1]) >= 0.5
    return _stepped(s, levels) if rests else None


def _resting(s: Series, runs: _Runs) -> Doubt | None:
    """Stretches on the last of a few broad steps, which are not the end of a range."""
    levels = np.unique(s.values)
    if np.diff(levels).min() <= _BROAD * np.ptp(levels):
        return None
    for extreme in (levels[-1], levels[0]):
        count = int(np.count_nonzero(s.values == extreme))
        long = runs.length[(runs.value == extreme) & (runs.length >= 3)].sum()
        if extreme != 0 and long >= max(_LEAST, _SHARE * s.values.size, 0.6 * count):
            return _stepped(s, levels)
    return None


def _stepped(s: Series, levels: np.ndarray) -> Doubt:
    step, span = float(np.diff(levels).min()), float(np.ptp(levels))
    evidence = (
        f"{s.channel} has {levels.size} levels only, {s.width_shown(step)} apart over a range of "
        f"{s.width_shown(span)}: its steps are too coarse for a fit of its course."
    )
    mend = (
        f"log {s.channel} with more digits; or give its noise: [channels.{s.channel}] noise = "
        f"{number(s.width(step).value / 12**0.5, 2)}."
    )
    return Doubt(s.channel, "stuck", evidence, mend)


def _saturated(s: Series, ends: Railed) -> Doubt:
    """Samples at the end of the sensor's range."""
    shares = [
        f"{np.count_nonzero(ends.side == side)} samples of {s.channel} are saturated at its {word} "
        f"value, {s.shown(end)}"
        for side, end, word in ((1, ends.high, "largest"), (-1, ends.low, "smallest"))
        if np.isfinite(end)
    ]
    evidence = f"{', and '.join(shares)}."
    if s.channel in s.log.censored:
        mend = "none is needed; a larger range tells more."
        return Doubt(s.channel, "saturated", evidence, mend)
    limits = ", ".join(f"{s.written(end):g}" for end in (ends.low, ends.high))
    mend = (
        f"choose a larger range; or say where it ends and have them taken as 'at least': "
        f"[channels.{s.channel}] rails = [{limits}] and censored = true, or Column(..., rails="
        f"({limits}), censored=True). If it is no end of the range: rails = [-inf, inf]."
    )
    return Doubt(s.channel, "saturated", f"{evidence} They are ignored.", mend)


def _stuck(s: Series, runs: _Runs, moving: Mapping[str, np.ndarray]) -> _Stuck | None:
    """One stretch of one value, far longer than any other, while other channels move."""
    longest = int(np.argmax(runs.length))
    length = int(runs.length[longest])
    shorter = np.delete(runs.length, longest)
    if length < max(_LEAST, _SHARE * s.values.size) or shorter.size < 10:
        return None
    if length < 4 * np.quantile(shorter, 0.98):
        return None
    during = slice(int(runs.start[longest]), int(runs.start[longest]) + length)
    value = float(runs.value[longest])
    resting = abs(value) < 0.02 * np.quantile(np.abs(s.values), 0.95)
    others = (v[s.where] for c, v in moving.items() if c != s.channel)
    if not any(_moved(v, during) for v in others) or (resting and not _driven_hard(s, during)):
        return None
    begin = float(s.log.time[s.where[during.start]])
    return _Stuck(s.channel, begin, length, s.shown(value))


def _moved(values: np.ndarray, during: slice) -> bool:
    here = values[during]
    here = here[np.isfinite(here)]
    if here.size < 3:
        return False
    low, high = np.quantile(here, (0.1, 0.9))
    usual = np.ptp(np.quantile(values[np.isfinite(values)], (0.02, 0.98)))
    return bool(high - low > _MOVED * usual > 0)


def _driven_hard(s: Series, during: slice) -> bool:
    """Whether any input is at half of its size on average meanwhile."""
    return s.values.size == len(s.log) and any(
        np.mean(np.abs(v[during])) > 0.5 * np.quantile(np.abs(v), 0.98) > 0
        for v in s.log.inputs.values()
    )


def _stopped(log: Log, stuck: Sequence[_Stuck]) -> Doubt:
    """One doubt on all channels that stay in the same stretch: the recorder stood still."""
    channel, begin, length, _ = stuck[0]
    at = joined(f"{stop.channel} at {stop.value}" for stop in stuck)
    stay, they = ("stays", "it is") if len(stuck) == 1 else ("stay", "they are")
    evidence = (
        f"for {length} samples from {moment(log, begin)} on {at} {stay} as {they}, while inputs or "
        "other readings move."
    )
    mend = "leave these samples empty (nan), or cut the log there."
    return Doubt(channel, "stuck", evidence, mend, also=tuple(stop.channel for stop in stuck[1:]))


def _only_noise(log: Log, drives: list[str], values: np.ndarray) -> bool:
    """Neither neighbours nor stretches of the log differ by more than white noise would have them.

    Of white noise one log in a thousand has block means that vary by 2.3 times what is due; what
    answers to a drive, or rings, has stretches, or neighbours, that differ far more.
    """
    series = [log.inputs[name] for name in drives]
    if values.size < 100 or not any(_swings(v) and lag_one([v]) > 0.8 for v in series):
        return False
    x = values - values.mean()
    neighbours = float(x[1:] @ x[:-1]) / float(x @ x)
    length = values.size // 20
    means = x[: 20 * length].reshape(20, length).mean(axis=1)
    excess = float(np.var(means, ddof=1)) * length / float(np.var(x))
    return abs(neighbours) < 3 / np.sqrt(values.size) and excess < 2.3


def _swings(values: np.ndarray) -> bool:
    """Whether an input moves for a good part of the log, by a good part of its size."""
    low, high = np.quantile(values, (0.05, 0.95))
    return bool(high - low > 0.2 * np.abs(values).max())
