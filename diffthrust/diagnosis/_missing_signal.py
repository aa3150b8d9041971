"""The signal that is missing at a port, smoothed from all errors before and after each sample.

About the path that an observer has gone, the model is linear: a signal at a port pushes the state,
the state's deviation decays and shows in the error, beside white and lasting noise of the sensor.
The signal is a random one with a memory (Ornstein-Uhlenbeck), so that no form is assumed; its size,
its memory and the share of lasting noise are those of the greatest likelihood on a grid. A Kalman
filter and the smoother of Rauch, Tung & Striebel (1965) then give it with its standard error.

Missing signals: what would have to act at a port, whatever its form, and what it depends on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
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
from diffthrust.diagnosis._residual_structure import (
    candidate_signals,
    hat_bases,
    likelihood_ratio,
    observed_signals,
    score_at_port,
)
from diffthrust.models._base.model import Model

_SIGNAL_SIZES = 10.0 ** np.linspace(-3.0, 1.5, 10)
"""What the signal does within a sample, over the noise."""
_SIGNAL_MEMORIES = (3.0, 15.0, 75.0)
"""Samples for which the signal is remembered."""
_LASTING_SIZES = (0.0, 0.5, 2.0, 8.0)
"""Standard deviation of the lasting noise, over that of the white."""
_TUNING_SAMPLES = 500
"""Samples of each log that choose among these."""


@dataclass(frozen=True)
class LinearErrors:
    """The errors of one log, linear about an observer's path; each ``(T,)``.

    Args:
        seen: measured minus predicted; NaN where nothing was measured.
        kept: how much of a deviation of the state is left at the next sample.
        undone: what the observer moved the state by until the next sample.
        pushed: the deviation that a unit of the signal makes until the next sample.
        direct: what a unit of the signal adds to the measurement at once.
    """

    seen: np.ndarray
    kept: np.ndarray
    undone: np.ndarray
    pushed: np.ndarray
    direct: np.ndarray


def smoothed_signals(
    runs: Sequence[LinearErrors], lasting: float
) -> list[tuple[np.ndarray, np.ndarray]]:
    """The signal and its standard error, ``(T,)`` each, for every log.

    Args:
        runs: the logs.
        lasting: correlation of the sensor's lasting noise from sample to sample.
    """
    joined = np.concatenate([run.seen for run in runs])
    moved = np.concatenate([np.hypot(run.pushed, run.direct) for run in runs])
    valid = joined[np.isfinite(joined)]
    noise = float(np.sqrt(np.mean(valid**2))) if valid.size else 0.0
    unit = float(np.sqrt(np.mean(moved**2)))
    if not noise > 0 or not unit > 0:
        return [(np.zeros(run.seen.size), np.full(run.seen.size, np.nan)) for run in runs]
    steady = all(np.all(run.direct == 0) for run in runs)  # else nothing tells it from the signal
    grid = np.array(
        list(product(_SIGNAL_SIZES / unit, _SIGNAL_MEMORIES, _LASTING_SIZES if steady else (0.0,)))
    )
    scaled = [LinearErrors(run.seen / noise, run.kept, run.undone / noise, run.pushed, run.direct)
              for run in runs]  # fmt: skip
    cost, squares, count = np.zeros(len(grid)), np.zeros(len(grid)), 0
    for run in scaled:
        filtered = _filter(run, grid, lasting, _TUNING_SAMPLES)
        cost, squares = cost + filtered.logs, squares + filtered.squares
        count += int(np.isfinite(run.seen[:_TUNING_SAMPLES]).sum())
    best = int(np.argmin(cost + count * np.log(squares / count)))
    chosen = [_filter(run, grid[best : best + 1], lasting) for run in scaled]
    total = sum(float(filtered_run.squares[0]) for filtered_run in chosen)
    scale = noise * np.sqrt(total / valid.size)
    out = []
    for filtered_run in chosen:
        means, covariances = _smoother(filtered_run)
        spread = scale * np.sqrt(np.maximum(covariances[:, 1, 1], 0.0))
        out.append((noise * means[:, 1], spread))
    return out


class _Filtered:
    """What the likelihood needs, for all points of a grid; of a single point every moment, too."""

    def __init__(self, points: int) -> None:
        self.logs, self.squares = np.zeros(points), np.zeros(points)
        self.moments: list[tuple[np.ndarray, ...]] = []


def _filter(
    run: LinearErrors, grid: np.ndarray, lasting: float, most: int | None = None
) -> _Filtered:
    """Kalman filter over (deviation, signal, lasting noise), for all points of a grid at once."""
    size, memory, share = grid.T
    forgets = np.exp(-1.0 / memory)
    many, unmoved = len(grid), not run.pushed.any()
    x, p, q = np.zeros((many, 3)), np.zeros((many, 3, 3)), np.zeros((many, 3, 3))
    p[:, 0, 0], p[:, 1, 1], p[:, 2, 2] = 0.0 if unmoved else 100.0, size**2, share**2
    q[:, 1, 1] = size**2 * (1.0 - forgets**2)
    q[:, 2, 2] = share**2 * (1.0 - lasting**2)
    filtered = _Filtered(many)
    for t in range(run.seen[:most].size):
        ahead = x, p
        if np.isfinite(run.seen[t]):
            reads = np.array([1.0, run.direct[t], 1.0])
            gained = p @ reads
            spread = gained @ reads + 1.0
            error = run.seen[t] - x @ reads
            x = x + gained * (error / spread)[:, None]
            p = p - gained[:, :, None] * (gained / spread[:, None])[:, None, :]
            filtered.logs += np.log(spread)
            filtered.squares += error**2 / spread
        moves = np.zeros((many, 3, 3))
        moves[:, 0, 0], moves[:, 0, 1] = run.kept[t], run.pushed[t]
        moves[:, 1, 1], moves[:, 2, 2] = forgets, lasting
        if many == 1:
            filtered.moments.append((*(moment[0] for moment in (*ahead, x, p)), moves[0]))
        x = (moves @ x[:, :, None])[:, :, 0]
        x[:, 0] -= run.undone[t]
        p = moves @ p @ moves.transpose(0, 2, 1) + q
    return filtered


def _smoother(filtered: _Filtered) -> tuple[np.ndarray, np.ndarray]:
    """Means ``(T, 3)`` and covariances ``(T, 3, 3)``, given all samples."""
    ahead, spread, means, covariances, moves = map(np.array, zip(*filtered.moments, strict=True))
    undone = np.linalg.pinv(spread[1:], rcond=1e-12, hermitian=True)
    backs = covariances[:-1] @ moves[:-1].transpose(0, 2, 1) @ undone
    for t in range(len(backs) - 1, -1, -1):
        back = backs[t]
        means[t] += back @ (means[t + 1] - ahead[t + 1])
        covariances[t] += back @ (covariances[t + 1] - spread[t + 1]) @ back.T
    return means, covariances


_TIME_BLOCKS = 12
"""Blocks of time in a log: what the mean of a signal leaves lasts, but for less than a block."""
_LEAST_BLOCKS = 3
"""With fewer, nothing tells how sure a mean is."""
_DEPENDENCE_LEVEL = 0.05
"""False alarms of a dependence, over all signals at a place together."""
_LEAST_DEPENDENCE = 0.01
"""A dependence that explains less of the missing signal's variance is not told."""

ErrorCurve = tuple[np.ndarray, np.ndarray, np.ndarray]


def missing_signals(trials: CandidateFitter, trial: TrialFit) -> tuple[Missing, ...]:
    """The missing signal at each place, the one that explains most first.

    Of the signals on which the errors depend (score test) the one is told that explains most of it.
    """
    logs = observed_signals(trials, trial)
    signals = []
    for place in trials.places:
        runs = _smoothed_runs(trials, place, trial)
        tests = hat_bases(candidate_signals(trials, place, logs))

        def tested(
            series: list[np.ndarray], port: str = place.port
        ) -> tuple[float, np.ndarray, np.ndarray]:
            return score_at_port(trials, port, trial, series)

        answers = side_by_side(tested, [series for series, _ in tests.values()])
        least = min((p for p, *_ in answers), default=1.0) * len(tests)
        depends, gain, dependence = None, 0.0, NONE
        for (form, (series, knots)), answer in zip(tests.items(), answers, strict=True):
            p, coefficients, covariance = answer
            if p * len(tests) < _DEPENDENCE_LEVEL:
                on_this = dependence_of([signal for _, signal, _ in runs], series, knots)
                if on_this.share > max(dependence.share, _LEAST_DEPENDENCE):
                    depends, dependence, least = form, on_this, p * len(tests)
                    gain = likelihood_ratio(coefficients, covariance)
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
        [i * _TIME_BLOCKS + _block_indices(log_values.size) for i, log_values in enumerate(signal)]
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


def _block_indices(samples: int) -> np.ndarray:
    return np.arange(samples) * _TIME_BLOCKS // samples


def _smoothed_runs(
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
