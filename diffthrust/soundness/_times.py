"""Clocks and stamps: an odd step, another rate than in companions, channels that come late."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from diffthrust._support.correlation import covariance
from diffthrust._support.envelope import stretches
from diffthrust._support.words import number
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.soundness._doubt import Doubt, moment
from diffthrust.soundness._mends import STEPS, clock_line, unit_line
from diffthrust.soundness._record import Record, correlation, trailing
from diffthrust.soundness._ties import DRIVE, GEOMETRY, Tie

_GAP = 20.0
"""Times the median step from which on a step is a gap; of samples at random times one in 1e6 is."""


def misclocked(log: Log, model: Model | None) -> Iterator[Doubt]:
    """Doubts on the time stamps, and on stretches where a channel is missing."""
    if len(log) < 20:
        return
    steps = np.diff(log.time)
    yield from _base(log, model)
    gaps = np.flatnonzero(steps > _GAP * log.step)
    if gaps.size and gaps.size < 0.02 * steps.size + 1:
        longest = int(gaps[np.argmax(steps[gaps])])
        evidence = (
            f"{gaps.size} {'gap' if gaps.size == 1 else 'gaps'} in time, the longest of "
            f"{number(float(steps[longest]), 3)} s after {moment(log, float(log.time[longest]))}, "
            f"where samples are otherwise {number(log.step, 3)} s apart."
        )
        mend = "cut the log there (log.slice, or start and stop under [logs]) and give both parts."
        yield Doubt("time", "gap", evidence, mend)
    left_out = np.zeros(len(log), bool)
    for first, last in log.left_out:
        left_out |= (log.time >= first) & (log.time <= last)
    for channel, values in log.measured.items():
        begins, ends = stretches(~np.isfinite(values) & ~left_out).T
        lengths = ends - begins
        inside = lengths[(begins > 0) & (ends < values.size)]
        usual = float(np.median(lengths)) if lengths.size > 4 else 1.0
        if inside.size and inside.max() > max(20, 10 * usual, 0.03 * values.size):
            evidence = f"{channel} is missing for {int(inside.max())} samples in a row."
            yield Doubt(channel, "gap", evidence, f"cut the log there, or do without {channel}.")


def _base(log: Log, model: Model | None) -> Iterator[Doubt]:
    """Milliseconds called seconds, or the reverse."""
    if model is not None and all(name in log.inputs for name in model.states):
        return  # nothing is integrated, so any rate will do
    fastest, slowest = model.time_scales if model else (0.0, np.inf)
    shortest, longest = (fastest / 50, slowest / 4) if model else STEPS
    if log.step >= longest:
        unit, limit = "ms", f"at most {number(longest, 2)} s"
    elif log.step < shortest or log.duration < fastest:
        unit, limit = "s", f"at least {number(shortest, 2)} s"
    else:
        return
    system = f"a '{model.name}'" if model else "a thruster or a vessel"
    evidence = (
        f"samples are {number(log.step, 3)} s apart over {number(log.duration, 3)} s, where "
        f"{system} is logged with {limit}."
    )
    yield Doubt("time", "time_base", evidence, unit_line("time", unit))


_OTHER = 1.5
"""Ratio of a log's step to that of its companions from which on its rate is another one."""
_SAME = 0.03
"""How far their own steps may differ (as a logarithm) to be one rate."""
_FIRM = 0.8
"""Correlation of a channel with its drive that a time constant is taken from."""
_NEAR = 0.3
"""A log's response must be slower by the ratio of the steps, within this share of its logarithm,
and the companions' own must agree so well."""
_DENSE = np.geomspace(0.7, 300.0, 48)
"""Time constants that are tried, in points."""


def misrated(
    steps: Mapping[int, float], records: Mapping[int, Record], tied: Mapping[int, Sequence[Tie]]
) -> Iterator[tuple[int, Doubt]]:
    """Doubts on single clocks of three logs and more, by place, each with that of its log.

    A log may well be taken at another rate. But then what is driven answers in as many seconds;
    if it answers in as many samples as in the other logs, the clock is wrong.
    """
    if len(records) < 3:
        return
    for i, step in steps.items():
        others = np.log([s for j, s in steps.items() if j != i])
        ratio = float(np.exp(np.log(step) - np.median(others)))
        if max(ratio, 1 / ratio) < _OTHER or np.ptp(others) > _SAME:
            continue
        for tie in tied[i]:
            took = _took(records[i], tie)
            peers = [(j, t) for j, of in tied.items() for t in of if j != i and t.key == tie.key]
            answers = [_took(records[j], peer) for j, peer in peers]
            finite = np.log([answer for answer in answers if np.isfinite(answer)])
            if finite.size < 2 or not np.isfinite(took):
                continue
            margin, middle = _NEAR * abs(np.log(ratio)), float(np.median(finite))
            off = np.log(took) - middle - np.log(ratio)
            if abs(off) < margin and np.abs(finite - middle).max() < margin:
                evidence = (
                    f"samples are {number(step, 3)} s apart, in the other logs "
                    f"{number(step / ratio, 3)} s, and {tie.channel} answers {tie.words} with a "
                    f"time constant of {number(took, 2)} s, in the others of "
                    f"{number(float(np.exp(middle)), 2)} s: as many samples."
                )
                yield i, Doubt("time", "time_base", evidence, clock_line(1 / ratio))
                break


def _took(r: Record, tie: Tie) -> float:
    """Time constant [s] with which a channel follows its drive; not a number if none shows."""
    if tie.kind != DRIVE or not tie.together > _FIRM:
        return np.nan
    lags = _DENSE[tie.seen.size / 6 > _DENSE]
    fits = np.array([correlation(due, tie.seen) for due in trailing(tie.drive, lags)])
    fits[np.isnan(fits)] = -1.0
    best = int(np.argmax(fits))
    if not 0 < best < fits.size - 1 or not fits[best] > _FIRM:
        return np.nan
    lower, middle, upper = fits[best - 1 : best + 2]
    offset = 0.5 * (lower - upper) / (lower - 2 * middle + upper)
    return float(lags[best] * (lags[1] / lags[0]) ** offset * r.step)


_OPEN = 0.03
"""Share that two channels must leave open of each other before a lag between them is looked for."""
_HALVED = 0.5
"""Largest share of the unexplained variance that may remain: missing physics leaves more."""
_CLEAR = 0.9
"""Correlation that the two must reach once the lag is taken out."""
_LEAST = 6
"""Samples; the measured logs have lags of up to 5 between sensors, by filters and alignment."""


def lagging(r: Record, tied: Sequence[Tie]) -> Iterator[Doubt]:
    """Doubts on the clock of a channel, where a shift halves what two channels leave open."""
    late: dict[str, list[tuple[Tie, int, float]]] = {}
    shifts = [(tie, *_shift(tie)) for tie in tied]
    for tie, shift, after in shifts:
        if shift > 0 and tie.kind != DRIVE:  # what is driven follows: that alone is no lag
            late.setdefault(tie.channel, []).append((tie, shift, after))
        elif shift < 0:
            for driver in tie.others:
                late.setdefault(driver, []).append((tie, -shift, after))
    if not late:
        return
    timely = [c for tie, shift, _ in shifts if not shift for c in (tie.channel, *tie.others)]
    channel = max(late, key=lambda c: (len(late[c]), -timely.count(c)))
    tie, samples, after = late[channel][0]
    seconds = number(samples * r.step, 2)
    # what is driven lags by itself, which hides a part of a late drive
    least = "at least " if tie.kind == DRIVE else ""
    against = tie.words if channel == tie.channel else tie.channel
    evidence = (
        f"{channel} comes {least}{seconds} s after {against}, with which it must move (correlation "
        f"{tie.together:.2f}, without the lag {after:.2f}): its clock is behind, or a filter "
        "delays it."
    )
    mend = (
        f"shift {channel} by -{seconds} s{' or more' if least else ''} before the log is made, or "
        "take the stamps of one clock."
    )
    yield Doubt(channel, "lag", evidence, mend)


def _shift(tie: Tie) -> tuple[int, float]:
    """By how many samples the channel follows what is due, and the correlation then; 0 if none."""
    explained = tie.together**2
    if tie.together < (0.2 if tie.kind == DRIVE else -0.5) or 1 - explained < _OPEN:
        return 0, tie.together
    reach = min(tie.seen.size // 6, 400)
    crossed = covariance([tie.seen], [tie.due], reach)
    shift = int(np.argmax(crossed)) - reach
    if abs(shift) < _LEAST or abs(shift) == reach:
        return 0, tie.together
    late, early = max(shift, 0), max(-shift, 0)
    measured, due = tie.seen[late : tie.seen.size - early], tie.due[early : tie.due.size - late]
    after, baseline = correlation(measured, due), correlation(tie.seen, tie.due)
    clear = after > (_CLEAR if tie.kind != GEOMETRY else 0.95)
    halved = 1 - after**2 < _HALVED * (1 - max(baseline, tie.together) ** 2)
    return (shift, after) if clear and halved else (0, tie.together)
