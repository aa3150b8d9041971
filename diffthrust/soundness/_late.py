"""Channels whose readings come late by a varying time, by what a simulation leaves of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from diffthrust._support.words import humanize, number, percent
from diffthrust.simulation._runs import Run
from diffthrust.soundness._doubt import Doubt

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
