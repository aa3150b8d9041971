"""Missing signals: what would have to act at a port, whatever its form, and what it depends on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from diffthrust.diagnosis._findings import Missing, SignalForm
from diffthrust.diagnosis._innovations_fit import (
    CandidateFitter,
    TrialFit,
    side_by_side,
    with_values,
)
from diffthrust.diagnosis._ports import DrivingPort, slopes_along, words_and_unit
from diffthrust.diagnosis._smoother import LinearErrors, smoothed_signals
from diffthrust.diagnosis._structure import bases, observed, ratio_of, signals_at, unknown
from diffthrust.models._base.model import Model

_BLOCKS = 12
"""Blocks of time in a log: what the mean of a signal leaves lasts, but for less than a block."""
_LEAST_BLOCKS = 3
"""With fewer, nothing tells how sure a mean is."""
_SURE = 0.05
"""False alarms of a dependence, over all signals at a place together."""
_TOLD = 0.01
"""A dependence that explains less of the missing signal's variance is not told."""

ErrorCurve = tuple[np.ndarray, np.ndarray, np.ndarray]


def missing_signals(trials: CandidateFitter, trial: TrialFit) -> tuple[Missing, ...]:
    """The missing signal at each place, the one that explains most first.

    Of the signals on which the errors depend (score test) the one is told that explains most of it.
    """
    logs = observed(trials, trial)
    signals = []
    for place in trials.places:
        runs = _runs(trials, place, trial)
        tests = bases(signals_at(trials, place, logs))

        def tested(
            series: list[np.ndarray], port: str = place.port
        ) -> tuple[float, np.ndarray, np.ndarray]:
            return unknown(trials, port, trial, series)

        answers = side_by_side(tested, [series for series, _ in tests.values()])
        least = min((p for p, *_ in answers), default=1.0) * len(tests)
        depends, gain, dependence = None, 0.0, NONE
        for (form, (series, knots)), answer in zip(tests.items(), answers, strict=True):
            p, coefficients, covariance = answer
            if p * len(tests) < _SURE:
                on_this = dependence_of([signal for _, signal, _ in runs], series, knots)
                if on_this.share > max(dependence.share, _TOLD):
                    depends, dependence, least = form, on_this, p * len(tests)
                    gain = ratio_of(coefficients, covariance)
        signals.append(
            Missing(
                port=place.port,
                unit=words_and_unit(trials.model, place.port)[1],
                runs=tuple(runs),
                signal=depends,
                dependence_unit=_unit_of(trials.model, depends) if depends else "",
                share=dependence.share,
                p_value=min(1.0, least),
                curve=dependence.curve,
                logs=tuple(log.name for log in trials.logs),
                gain=gain,
            )
        )
    return tuple(sorted(signals, key=lambda m: (-m.gain, m.p_value)))


class Dependence(NamedTuple):
    """The mean of a signal over another: share of its variance, and knots, means and errors."""

    share: float
    curve: ErrorCurve


NONE = Dependence(0.0, (np.empty(0), np.empty(0), np.empty(0)))


def dependence_of(
    signal: Sequence[np.ndarray], series: Sequence[np.ndarray], knots: np.ndarray
) -> Dependence:
    """The mean of a signal as a function, straight between knots, of another one.

    Args:
        signal: log by log ``(T,)``; NaN where it is not known.
        series: the basis of the function log by log, ``(K, T)``.
        knots: ``(K,)``.

    Returns:
        What the function explains. Its standard errors are those of a jackknife over blocks of time
        (Cameron & Miller 2015), which allows for correlation within them; where fewer than
        `_LEAST_BLOCKS` of them tell of a knot, its mean and error are NaN.
    """
    rows = np.concatenate([log_values.T for log_values in series])
    values = np.concatenate(signal)
    block = np.concatenate(
        [i * _BLOCKS + _blocks(log_values.size) for i, log_values in enumerate(signal)]
    )
    finite = np.isfinite(values)
    rows, values, block = rows[finite], values[finite], block[finite]
    if values.size <= knots.size or not np.ptp(values) > 0:
        return NONE
    square, cross = rows.T @ rows, rows.T @ values
    means = np.linalg.pinv(square, 1e-9, hermitian=True) @ cross
    residual = values - rows @ means
    without = []
    for log_values in np.unique(block):
        block_rows, block_values = rows[block == log_values], values[block == log_values]
        inverse = np.linalg.pinv(square - block_rows.T @ block_rows, 1e-9, hermitian=True)
        without.append(inverse @ (cross - block_rows.T @ block_values))
    apart = np.array(without) - np.mean(without, axis=0)
    errors = np.sqrt((1.0 - 1.0 / len(without)) * np.sum(apart**2, axis=0))
    blind = np.array([np.unique(block[row > 0]).size < _LEAST_BLOCKS for row in rows.T])
    means, errors = np.where(blind, np.nan, means), np.where(blind, np.nan, errors)
    share = 1.0 - float(np.var(residual) / np.var(values))
    return Dependence(share, (knots, means, errors))


def _blocks(samples: int) -> np.ndarray:
    return np.arange(samples) * _BLOCKS // samples


def _runs(
    trials: CandidateFitter, place: DrivingPort, trial: TrialFit
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Time, missing signal and its standard error of each log, in the unit of the port."""
    model = with_values(trials.model, trial.values)
    channel = place.target
    runs = []
    for path, log in zip(trial.path, trial.problem.logs, strict=True):
        step = np.diff(path["time"], append=2 * path["time"][-1] - path["time"][-2])
        decay, push = slopes_along(model, path, place)
        still = np.zeros_like(step)
        if channel not in log.measured:
            runs.append(LinearErrors(np.full_like(step, np.nan), still, still, still, still))
            continue
        residual = np.where(np.isnan(log.measured[channel]), np.nan, path[f"rest.{channel}"])
        if place.output:
            runs.append(LinearErrors(residual, still, still, still, push))
            continue
        turned = (path[channel] < 0) & (channel in log.unsigned)
        grown = np.expm1(np.clip(decay * step, -50.0, 1.0))
        within = np.where(grown == 0, step, grown / np.where(decay == 0, 1.0, decay))
        kept, residual = 1.0 + grown, np.where(turned, -residual, residual)
        undone = kept * path.get(f"moved.{channel}", 0.0) + within * path.get(
            f"pushed.{channel}", 0.0
        )
        runs.append(LinearErrors(residual, kept, undone, within * push, still))
    step = trials.logs[0].step
    lasting = float(np.exp(-step / trial.values.get(f"noise.{channel}.correlation", step)))
    signals = smoothed_signals(runs, lasting)
    return [(path["time"], *smoothed) for path, smoothed in zip(trial.path, signals, strict=True)]


def _unit_of(model: Model, signal: SignalForm) -> str:
    """The unit of an input, state or output, or of its rate."""
    units = {**model.inputs, **model.optional_inputs, **model.all_states, "time": "s"}
    return f"{units[signal.name]}/s" if signal.rate else units.get(signal.name, "")
