"""Sensors that repeat themselves: stuck, clipped, coarse, slower than the log, or dead."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from diffthrust._support.correlation import lag_one
from diffthrust._support.words import joined, number
from diffthrust.logs._log import Log
from diffthrust.logs._rails import Railed
from diffthrust.logs._written import ShownUnits
from diffthrust.soundness._doubt import Doubt, moment

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


class _Stuck(NamedTuple):
    """A stretch in which a channel stays at a value: from when on, and how many samples."""

    channel: str
    begin: float
    length: int
    value: float


class _Runs(NamedTuple):
    """Stretches of equal values: where they begin, how long they are, their value."""

    start: np.ndarray
    length: np.ndarray
    value: np.ndarray


def repeating(log: Log) -> Iterator[Doubt]:
    """Doubts on measured channels that hold their values. Inputs may hold theirs."""
    moving = [c for c, v in {**log.inputs, **log.measured}.items() if _span(v) > 0]
    drives = [c for c in moving if c in log.inputs and c not in _SURROUNDINGS]
    stuck: list[_Stuck] = []
    for channel, samples in log.measured.items():
        values = samples[np.isfinite(samples)]
        if values.size < 3 * _LEAST:
            continue
        if not np.ptp(values) > 0:
            if drives:
                yield Doubt(
                    channel,
                    "silent",
                    f"{log.name}: {channel} is {value_shown(log, channel, values[0])} in every "
                    f"sample, while {joined(drives)} moved.",
                    f"look whether the sensor of {channel} was on, or take the channel out.",
                )
            continue
        doubt, ends = None, log.railed.get(channel)
        if np.count_nonzero(values[1:] == values[:-1]) >= _LEAST - 1:
            runs = _runs(values)
            inputs = [
                v[np.isfinite(samples)]
                for c, v in {**log.inputs, **log.measured}.items()
                if c != channel and c in moving
            ]
            doubt = (
                _slow(log, channel, values, runs)
                or _coarse(log, channel, values)
                or _resting(log, channel, values, runs)
            )
            if doubt is None and ends is None:
                doubt = _stuck(log, channel, values, runs, inputs)
        if doubt is None and ends is not None and channel not in log.rails:
            doubt = _saturated(log, channel, ends)
        if isinstance(doubt, _Stuck):
            stuck.append(doubt)
        elif doubt:
            yield doubt
        elif channel in _ANSWERS and drives and _only_noise(log, drives, values):
            yield Doubt(
                channel,
                "silent",
                f"{log.name}: {channel} is white noise and nothing else, while {joined(drives)} "
                "moved.",
                f"look at the wiring of {channel}, and whether it is the right column.",
            )
    for stretch in dict.fromkeys((s.begin, s.length) for s in stuck):
        yield _stopped(log, [s for s in stuck if (s.begin, s.length) == stretch])


_ANSWERS = ("speed", "thrust", "velocity", "surge", "position")
"""Channels that must answer to any drive."""
_SURROUNDINGS = ("inflow", "supply_voltage", "wind_speed", "wind_direction", "heading")
"""Inputs that drive nothing by themselves."""


def _runs(values: np.ndarray) -> _Runs:
    start = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
    return _Runs(start, np.diff(np.append(start, values.size)), values[start])


def _slow(log: Log, channel: str, values: np.ndarray, runs: _Runs) -> Doubt | None:
    """Readings at a lower rate than the log's, or at irregular times, held in between."""
    waits, hold = runs.length[1:-1], log.holds.get(channel)
    if hold is not None and not hold.regular:
        return Doubt(
            channel,
            "stuck",
            f"{log.name}: {channel} repeats its last reading until the next arrives, after "
            f"{hold.seconds(log.time)}: {hold.readings} of {values.size} samples are readings.",
            "none is needed: fits count the readings alone. If they are stamped on arrival, their "
            f"age is unknown; the time at which {channel} was measured tells more.",
        )
    if waits.size < 15 or np.median(waits) < 3:
        return None
    usual = float(np.median(waits))
    if np.mean(np.abs(waits - usual) <= 1) < _REGULAR:
        return None
    seconds = number(usual * log.step, 3)
    return Doubt(
        channel,
        "stuck",
        f"{log.name}: {channel} changes every {usual:.0f} samples only ({seconds} s) and is held "
        "in between: the sensor is slower than the log.",
        f"keep the first sample of each reading of {channel} and leave the others empty (nan)."
        if hold is None
        else f"none is needed: fits count the readings alone. A faster {channel} tells more.",
    )


def _coarse(log: Log, channel: str, values: np.ndarray) -> Doubt | None:
    """Few levels, far apart, between which a signal climbs that has a memory."""
    levels = np.unique(values)
    if not 3 <= levels.size <= 2 * _COARSE:
        return None
    step, span = float(np.diff(levels).min()), float(np.ptp(levels))
    if span > _COARSE * step * (1 + 1e-9) or lag_one([values]) < 0.9:
        return None
    if np.mean(values[1:] == values[:-1]) < 0.5:
        return None
    return _stepped(log, channel, levels)


def _stepped(log: Log, channel: str, levels: np.ndarray) -> Doubt:
    step, span = float(np.diff(levels).min()), float(np.ptp(levels))
    return Doubt(
        channel,
        "stuck",
        f"{log.name}: {channel} has {levels.size} levels only, {width_shown(log, channel, step)} "
        f"apart over a range of {width_shown(log, channel, span)}: its steps are too coarse for a "
        "fit of its course.",
        f"log {channel} with more digits; or give its noise: [channels.{channel}] noise = "
        f"{number(width_as_written(log, channel, step) / 12**0.5, 2)}.",
    )


def _resting(log: Log, channel: str, values: np.ndarray, runs: _Runs) -> Doubt | None:
    """Stretches on the last of a few broad steps, which are not the end of a range."""
    levels, span = np.unique(values), float(np.ptp(values))
    if np.diff(levels).min() <= _BROAD * span:
        return None
    for extreme in (values.max(), values.min()):
        count = int(np.count_nonzero(values == extreme))
        long = runs.length[(runs.value == extreme) & (runs.length >= 3)].sum()
        if extreme != 0 and long >= max(_LEAST, _SHARE * values.size, 0.6 * count):
            return _stepped(log, channel, levels)
    return None


def _saturated(log: Log, channel: str, ends: Railed) -> Doubt:
    """Samples at the end of the sensor's range."""
    shares = [
        f"{np.count_nonzero(ends.side == side)} samples of {channel} are saturated at its {word} "
        f"value, {value_shown(log, channel, end)}"
        for side, end, word in ((1, ends.high, "largest"), (-1, ends.low, "smallest"))
        if np.isfinite(end)
    ]
    evidence = f"{log.name}: {', and '.join(shares)}."
    if channel in log.censored:
        return Doubt(channel, "saturated", evidence, "none is needed; a larger range tells more.")
    limits = ", ".join(f"{as_written(log, channel, end):g}" for end in (ends.low, ends.high))
    return Doubt(
        channel,
        "saturated",
        f"{evidence} They are ignored.",
        f"choose a larger range; or say where it ends and have them taken as 'at least': "
        f"[channels.{channel}] rails = [{limits}] and censored = true, or Column(..., rails="
        f"({limits}), censored=True). If it is no end of the range: rails = [-inf, inf].",
    )


def _stuck(
    log: Log, channel: str, values: np.ndarray, runs: _Runs, companions: list[np.ndarray]
) -> _Stuck | None:
    """One stretch of one value, far longer than any other, while other channels move."""
    longest = int(np.argmax(runs.length))
    length = int(runs.length[longest])
    shorter = np.delete(runs.length, longest)
    if length < max(_LEAST, _SHARE * values.size) or shorter.size < 10:
        return None
    if length < 4 * np.quantile(shorter, 0.98):
        return None
    begin = int(runs.start[longest])
    during = np.zeros(values.size, bool)
    during[begin : begin + length] = True
    value = float(runs.value[longest])
    resting = abs(value) < 0.02 * np.quantile(np.abs(values), 0.95)
    if not _others_moved(companions, during) or (resting and not _driven_hard(log, during)):
        return None
    first = float(log.time[np.flatnonzero(np.isfinite(log.measured[channel]))[begin]])
    return _Stuck(channel, first, length, value)


def _stopped(log: Log, stuck: Sequence[_Stuck]) -> Doubt:
    """One doubt on all channels that stay in the same stretch: the recorder stood still."""
    channel, begin, length, _ = stuck[0]
    at = joined(f"{s.channel} at {value_shown(log, s.channel, s.value)}" for s in stuck)
    stay = "stays" if len(stuck) == 1 else "stay"
    return Doubt(
        channel,
        "stuck",
        f"{log.name}: for {length} samples from {moment(log, begin)} on {at} {stay} as "
        f"{'it is' if len(stuck) == 1 else 'they are'}, while inputs or other readings move.",
        "leave these samples empty (nan), or cut the log there.",
        also=tuple(s.channel for s in stuck[1:]),
    )


def _others_moved(companions: list[np.ndarray], during: np.ndarray) -> bool:
    for values in companions:
        here, finite = values[during], np.isfinite(values)
        here = here[np.isfinite(here)]
        if here.size < 3:
            continue
        low, high = np.quantile(here, (0.1, 0.9))
        if high - low > _MOVED * np.ptp(np.quantile(values[finite], (0.02, 0.98))) > 0:
            return True
    return False


def _driven_hard(log: Log, during: np.ndarray) -> bool:
    """Whether any input is at half of its size on average meanwhile."""
    same_length = {c: v for c, v in log.inputs.items() if v.size == during.size}
    return any(
        np.mean(np.abs(v[during])) > 0.5 * np.quantile(np.abs(v), 0.98) > 0
        for v in same_length.values()
    )


def _only_noise(log: Log, drives: list[str], values: np.ndarray) -> bool:
    """Neither neighbours nor stretches of the log differ by more than white noise would have them.

    Of white noise one log in a thousand has block means that vary by 2.3 times what is due; what
    answers to a drive, or rings, has stretches, or neighbours, that differ far more.
    """
    series = [log.inputs[name] for name in drives]
    smooth = [v for v in series if _swings(v) and lag_one([v]) > 0.8]
    if values.size < 100 or not smooth:
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


def _span(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return float(np.ptp(finite)) if finite.size else 0.0


def as_written(log: Log, channel: str, value: float) -> float:
    """A stored number in the unit in which the user wrote the channel."""
    return float(ShownUnits([log.written]).values(channel, value, log.units[channel]))


def width_as_written(log: Log, channel: str, width: float) -> float:
    """A difference of two stored numbers in that unit."""
    return ShownUnits([log.written]).size(channel, width, log.units[channel]).value


def value_shown(log: Log, channel: str, value: float) -> str:
    """A stored number as text, with the user's unit."""
    unit = ShownUnits([log.written]).unit(channel, log.units[channel])
    return f"{number(as_written(log, channel, value), 4)} {unit}".rstrip()


def width_shown(log: Log, channel: str, width: float) -> str:
    """A difference of two stored numbers as text, with the user's unit."""
    value, unit = ShownUnits([log.written]).size(channel, width, log.units[channel])
    return f"{number(value, 3)} {unit}".rstrip()
