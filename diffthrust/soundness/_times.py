"""Clocks and stamps: an odd step, another rate than in companions, channels that come late.

Of channels of a log, by how they move together; and by what a simulation leaves of a channel, whose
readings come late by a varying time.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from diffthrust._support.correlation import covariance
from diffthrust._support.envelope import stretches
from diffthrust._support.words import humanize, number, percent
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._runs import Run
from diffthrust.soundness._doubt import STEPS, Doubt, clock_line, moment, unit_line
from diffthrust.soundness._record import DRIVE, GEOMETRY, Record, Tie, correlation, trailing

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


# -- readings that come late by a varying time -----------------------------------------------------

_FEWEST = 60
"""Readings from which the scatter of their times is looked for."""
_SURE = 4.0
"""Standard errors by which the scatter must lie above none. Of 800 sets of white, correlated or
heavy-tailed errors, or with a dead band missing, none is doubted."""
_SHARE = 0.5
"""Least share of the unpredictable error that the scatter explains. A lag that the model lacks, as
long as the time between readings, looks like 0.4, and in one set of eight like more."""
_PERSISTENT = 0.3
"""Largest correlation of one reading's lateness with the next one's: missing physics gives errors
that go with the slope as well, and last; a late reading says nothing of the next."""
_UNEXPLAINED = 0.5
"""Largest share of the signal's variance that the model may leave: its slopes are those of the
signal only where it follows it."""
_LONGEST, _COARSE, _FINE = 20.0, 2.0, 0.5
"""Numerics: samples of the longest constant delay, which is taken out before the scatter shows, and
of the steps in which it is looked for: slope and bend of the signal stand for what is between."""
_MODELLED = 3
"""Numerics: which of the `_signals` is the model's own."""
_ROUNDS = 8
"""Numerics: reweightings of the regression; it settles in four."""


class Lateness(NamedTuple):
    """By how much readings come late, beyond what the model has.

    The standard ``error`` is that of the scatter's square, as a share of it; ``share`` that of the
    unpredictable variance which the scatter explains; ``persistence`` the correlation of the
    lateness of one reading with that of the next.
    """

    mean: float
    scatter: float
    error: float
    share: float
    persistence: float

    @property
    def sure(self) -> bool:
        """Whether it scatters surely, as no missing physics does, and makes most of the error."""
        clear = self.error < 1 / _SURE and self.share > _SHARE
        return clear and self.persistence < _PERSISTENT


class Readings(NamedTuple):
    """A channel of one log at every sample, ``(n,)`` each: ``measured`` is NaN between readings."""

    time: np.ndarray
    modelled: np.ndarray
    measured: np.ndarray

    def delayed(self, seconds: float) -> Readings:
        """The same, beside a model that comes later."""
        return self._replace(modelled=np.interp(self.time - seconds, self.time, self.modelled))


def late_readings(runs: Sequence[Run]) -> Iterator[Doubt]:
    """Doubts on channels whose readings come late by a varying time, in a fit's training runs."""
    for channel in dict.fromkeys(name for run in runs for name in run.channels):
        traces = [(run.time, run.channels[channel]) for run in runs if channel in run.channels]
        late = lateness([Readings(time, t.modelled, t.measured) for time, t in traces])
        if late is None or not late.sure:
            continue
        evidence = (
            f"its readings come late by a varying time, {number(late.mean, 2)} s in the mean "
            f"(scatter {number(late.scatter, 2)} s): the errors grow with how fast the "
            f"{humanize(channel)} changes, and those of one reading say nothing of the next. This "
            f"makes {percent(late.share)} of the error that no model predicts."
        )
        mend = (
            f"log when the sensor measured {channel}, not when the reading arrived. Until then "
            "time constants and delays are less sure than their standard errors say, and slower "
            "inputs tell more."
        )
        yield Doubt(channel, "lag", evidence, mend)


def lateness(logs: Sequence[Readings]) -> Lateness | None:
    """The scatter of the times of readings, from errors that grow with the slope of the signal.

    A reading that is late by t misses a signal of slope s by -t s. Where t is another each time,
    the errors are as unpredictable as noise, and their variance grows with the square of the slope.
    Second differences of the errors leave that and remove what lasts, such as missing physics.
    ``None`` where the lateness does not scatter, or too few readings tell.
    """
    rows, residual = map(np.concatenate, zip(*map(_read, logs), strict=True))
    if residual.size < _FEWEST or not np.var(residual) < _UNEXPLAINED * np.var(rows[:, _MODELLED]):
        return None
    delay = _constant_delay(logs)
    parts = [_read(log.delayed(delay)) for log in logs]
    coefficients = _least_squares(*map(np.concatenate, zip(*parts, strict=True)))
    errors = [values - filtered @ coefficients for filtered, values in parts]
    slopes = [filtered[:, 0] for filtered, _ in parts]
    squares = np.concatenate([np.diff(e, 2) ** 2 / 6.0 for e in errors])
    steep = np.concatenate([s[1:-1] ** 2 + np.diff(s**2, 2) / 6.0 for s in slopes])
    fitted = _variances(squares, steep)
    if fitted is None:
        return None
    floor, growth, error = fitted
    mean = delay + float(coefficients[0])
    scatter = float(np.sqrt(growth))
    share = float(growth * steep.mean() / (floor + growth * steep.mean()))
    return Lateness(mean, scatter, error / growth, share, _persistence(errors, slopes))


def _constant_delay(logs: Sequence[Readings]) -> float:
    """The delay [s] of the model beside which least is left of the readings, in half samples."""
    step = float(np.median(np.concatenate([np.diff(log.time) for log in logs])))
    signals = [_signals(log) for log in logs]

    def left(samples: float) -> float:
        """The squares that the best small delay or filter beside this one leaves."""
        products = np.zeros((len(signals[0]) + 1,) * 2)
        for log, rows in zip(logs, signals, strict=True):
            read = np.isfinite(log.measured) & np.isfinite(rows[0])
            earlier = log.time[read] - step * samples
            late = np.stack([np.interp(earlier, log.time, row) for row in rows])
            late = np.concatenate([late, (late[_MODELLED] - log.measured[read])[None]])
            products += late @ late.T
        seen = products[:-1, -1]
        return float(products[-1, -1] - seen @ _least_squares(products[:-1, :-1], seen))

    coarse = min(np.arange(0.0, _LONGEST + 0.1, _COARSE), key=left)
    near = coarse + np.arange(-_COARSE + _FINE, _COARSE, _FINE)
    return step * float(min(near[(near >= 0) & (near <= _LONGEST)], key=left))


def _least_squares(rows: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(rows, values, rcond=None)[0]


def _read(log: Readings) -> tuple[np.ndarray, np.ndarray]:
    """At the readings of a log its `_signals`, and the model's value less the reading."""
    signals, residual = _signals(log), log.modelled - log.measured
    read = np.isfinite(residual) & np.isfinite(signals[0])
    return signals.T[read], residual[read]


def _signals(log: Readings) -> np.ndarray:
    """What a small delay or a filter adds to a signal, it itself, and a constant, ``(5, n)``."""
    slope = np.gradient(log.modelled, log.time)
    bend = np.gradient(slope, log.time)
    third = np.gradient(bend, log.time)
    return np.stack([slope, bend, third, log.modelled, np.ones_like(slope)])


def _persistence(errors: Sequence[np.ndarray], slopes: Sequence[np.ndarray]) -> float:
    """The correlation of successive readings' lateness, where the signal is steep at both."""
    least = np.sqrt(np.mean(np.concatenate(slopes) ** 2))
    pairs = []
    for error, slope in zip(errors, slopes, strict=True):
        steep = np.abs(slope) > least
        late = error / np.where(steep, slope, 1.0)
        both = np.flatnonzero(steep[1:] & steep[:-1])
        pairs.append(np.stack([late[both], late[both + 1]]))
    first, second = np.concatenate(pairs, axis=1)
    size = float(np.sqrt((first @ first) * (second @ second)))
    return float(first @ second) / size if size > 0 else 0.0


def _variances(squares: np.ndarray, steep: np.ndarray) -> tuple[float, float, float] | None:
    """Least squares of ``squares = floor + growth * steep``, by weights of the fitted variance.

    The standard error of the growth allows for neighbours that share errors.
    """
    rows = np.stack([np.ones_like(steep), steep / steep.mean()], axis=1)
    variance, coefficients = np.full_like(squares, squares.mean()), np.zeros(2)
    for _ in range(_ROUNDS):
        coefficients = _least_squares(rows / variance[:, None], squares / variance)
        variance = np.maximum(rows @ coefficients, 0.05 * squares.mean())
    scaled = rows / variance[:, None]
    inverse = np.linalg.inv(scaled.T @ scaled)
    scores = scaled * ((squares - rows @ coefficients) / variance)[:, None]
    meat = scores.T @ scores
    for shift in (1, 2):  # a reading takes part in three second differences
        crossed = scores[shift:].T @ scores[:-shift]
        meat += (1 - shift / 3) * (crossed + crossed.T)
    error = float(np.sqrt((inverse @ meat @ inverse)[1, 1])) / steep.mean()
    growth = float(coefficients[1]) / steep.mean()
    return (max(float(coefficients[0]), 0.0), growth, error) if growth > 0 else None
