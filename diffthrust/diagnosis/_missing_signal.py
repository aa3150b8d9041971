"""Missing signals: what would have to act at a port, whatever its form, and what it depends on.

About the path of an observer the model is linear: a signal at a port pushes the state, the
deviation of the state decays and shows in the error, beside white and lasting noise of the sensor.
No form is assumed of the signal, but that it is random with a memory (Ornstein-Uhlenbeck). Its
size, its memory and the share of lasting noise are those of the largest likelihood on a grid. A
Kalman filter and the smoother of Rauch, Tung & Striebel (1965) then give it with its standard
error.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from diffthrust.diagnosis._candidates import DrivingPort, slopes_along, words_and_unit
from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit, with_values
from diffthrust.diagnosis._missing import Missing, SignalForm
from diffthrust.diagnosis._residual_structure import (
    candidate_signals,
    hat_bases,
    likelihood_ratio,
    observed_signals,
    scores_at_port,
)
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.models._base.model import Model

_SIGNAL_SIZES = 10.0 ** np.linspace(-3.0, 1.5, 10)
"""Numerics: sizes that are tried: what the signal does within a sample, over the noise."""
_SIGNAL_MEMORIES = (3.0, 15.0, 75.0)
"""Numerics: memories of the signal that are tried, in samples."""
_LASTING_SIZES = (0.0, 0.5, 2.0, 8.0)
"""Numerics: sizes of the lasting noise that are tried, over the white noise."""
_TUNING_SAMPLES = 500
"""Numerics: samples of each log that choose among these: the filter is a loop in Python over 120
points."""
_TIME_BLOCKS = 12
"""Numerics: blocks of time in a log for the jackknife: what the mean of a signal leaves lasts, but
for less than a block."""


class Dependence(NamedTuple):
    """The mean of a signal over another: share of its variance, and knots, means and errors."""

    share: float
    curve: tuple[np.ndarray, np.ndarray, np.ndarray]


NONE = Dependence(0.0, (np.empty(0), np.empty(0), np.empty(0)))


class LinearErrors(NamedTuple):
    """The errors of one log, linear about an observer's path; each ``(T,)``.

    Args:
        innovation: measured minus predicted; NaN where nothing was measured.
        decay: share of a deviation of the state that remains at the next sample.
        correction: what the observer has moved the state by, at the next sample.
        push: the deviation that a unit of the signal makes until the next sample.
        direct: what a unit of the signal adds to the measurement at once.
    """

    innovation: np.ndarray
    decay: np.ndarray
    correction: np.ndarray
    push: np.ndarray
    direct: np.ndarray


def missing_signals(fitter: CandidateFitter, trial: TrialFit) -> tuple[Missing, ...]:
    """The missing signal at each place, the one that explains most first.

    Of the signals on which the errors depend, by the score test, the one is reported that explains
    most of it.
    """
    observed = observed_signals(fitter, trial)
    signals = []
    for place in fitter.places:
        runs = _smoothed_runs(fitter, place, trial)
        smoothed = [signal for _, signal, _ in runs]
        tests = hat_bases(candidate_signals(fitter, place, observed))
        sets = [series for series, _ in tests.values()]
        answers = scores_at_port(place.port, trial, sets) if sets else []
        p_value = min((p for p, *_ in answers), default=1.0) * len(tests)
        signal, gain, dependence = None, 0.0, NONE
        for (form, (series, knots)), answer in zip(tests.items(), answers, strict=True):
            p, coefficients, covariance = answer
            if p * len(tests) < SETTINGS.structure.dependence_level:
                on_this = dependence_of(smoothed, series, knots)
                if on_this.share > max(dependence.share, SETTINGS.structure.least_dependence_share):
                    signal, dependence, p_value = form, on_this, p * len(tests)
                    gain = likelihood_ratio(coefficients, covariance)
        signals.append(
            Missing(
                port=place.port,
                unit=words_and_unit(fitter.model, place.port)[1],
                runs=tuple(runs),
                signal=signal,
                dependence_unit=_unit_of(fitter.model, signal) if signal else "",
                share=dependence.share,
                p_value=min(1.0, p_value),
                curve=dependence.curve,
                logs=tuple(record.name for record in fitter.records),
                gain=gain,
            )
        )
    return tuple(sorted(signals, key=lambda missing: (-missing.gain, missing.p_value)))


def dependence_of(
    signal: Sequence[np.ndarray], series: Sequence[np.ndarray], knots: np.ndarray
) -> Dependence:
    """The mean of a signal as a piecewise-linear function of another one.

    Args:
        signal: log by log ``(T,)``; NaN where it is not known.
        series: the basis of the function log by log, ``(K, T)``.
        knots: ``(K,)``.

    Returns:
        What the function explains. Its standard errors are those of a jackknife over blocks of time
        (Cameron & Miller 2015), which allows for correlation within them; where too few blocks
        reach a knot, its mean and error are NaN.
    """
    rows = np.concatenate([basis.T for basis in series])
    values = np.concatenate(signal)
    within = [np.arange(s.size) * _TIME_BLOCKS // s.size for s in signal]
    block = np.concatenate([i * _TIME_BLOCKS + each for i, each in enumerate(within)])
    finite = np.isfinite(values)
    rows, values, block = rows[finite], values[finite], block[finite]
    if values.size <= knots.size or not np.ptp(values) > 0:
        return NONE
    square, cross = rows.T @ rows, rows.T @ values
    means = np.linalg.pinv(square, 1e-9, hermitian=True) @ cross
    residual = values - rows @ means
    without = []
    for left_out in (block == index for index in np.unique(block)):
        x, y = rows[left_out], values[left_out]
        inverse = np.linalg.pinv(square - x.T @ x, 1e-9, hermitian=True)
        without.append(inverse @ (cross - x.T @ y))
    deviations = np.array(without) - np.mean(without, axis=0)
    errors = np.sqrt((1.0 - 1.0 / len(without)) * np.sum(deviations**2, axis=0))
    blocks_at = np.array([np.unique(block[weight > 0]).size for weight in rows.T])
    blind = blocks_at < SETTINGS.structure.fewest_blocks
    means, errors = np.where(blind, np.nan, means), np.where(blind, np.nan, errors)
    share = 1.0 - float(np.var(residual) / np.var(values))
    return Dependence(share, (knots, means, errors))


def _smoothed_runs(
    fitter: CandidateFitter, place: DrivingPort, trial: TrialFit
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Time, missing signal and its standard error of each log, in the unit of the port."""
    model, channel = with_values(fitter.model, trial.values), place.target
    runs = []
    for path, record in zip(trial.path, trial.problem.records, strict=True):
        measured = {**record.measured, **record.measured_states}
        step = np.diff(path["time"], append=2 * path["time"][-1] - path["time"][-2])
        rate, push = slopes_along(model, path, place)
        zero = np.zeros_like(step)
        if channel not in measured:
            runs.append(LinearErrors(np.full_like(step, np.nan), zero, zero, zero, zero))
            continue
        innovation = np.where(np.isnan(measured[channel]), np.nan, path[f"rest.{channel}"])
        if place.output:
            runs.append(LinearErrors(innovation, zero, zero, zero, push))
            continue
        # an unsigned sensor reads the other way round where the state is negative
        reversed_sign = (path[channel] < 0) & (channel in record.unsigned)
        innovation = np.where(reversed_sign, -innovation, innovation)
        # exact over a sample; expm1 keeps slow states, and the clip unstable ones, finite
        growth = np.expm1(np.clip(rate * step, -50.0, 1.0))
        integral = np.where(growth == 0, step, growth / np.where(rate == 0, 1.0, rate))
        decay = 1.0 + growth
        moved, pushed = (path.get(f"{kind}.{channel}", 0.0) for kind in ("moved", "pushed"))
        correction = decay * moved + integral * pushed
        runs.append(LinearErrors(innovation, decay, correction, integral * push, zero))
    step = fitter.records[0].log.step
    lasting = float(np.exp(-step / trial.values.get(f"noise.{channel}.correlation", step)))
    signals = smoothed_signals(runs, lasting)
    return [(path["time"], *smoothed) for path, smoothed in zip(trial.path, signals, strict=True)]


def smoothed_signals(
    runs: Sequence[LinearErrors], lasting: float
) -> list[tuple[np.ndarray, np.ndarray]]:
    """The signal and its standard error, ``(T,)`` each, for every log.

    Args:
        runs: the logs.
        lasting: correlation of the sensor's lasting noise from sample to sample.
    """
    innovations = np.concatenate([run.innovation for run in runs])
    response = np.concatenate([np.hypot(run.push, run.direct) for run in runs])
    valid = innovations[np.isfinite(innovations)]
    noise = float(np.sqrt(np.mean(valid**2))) if valid.size else 0.0
    unit = float(np.sqrt(np.mean(response**2)))
    if not noise > 0 or not unit > 0:
        sizes = (run.innovation.size for run in runs)
        return [(np.zeros(size), np.full(size, np.nan)) for size in sizes]
    # A signal that is added to the measurement itself is indistinguishable from lasting noise of
    # the sensor: only one that acts through a state is estimated beside such noise.
    through_state = all(np.all(run.direct == 0) for run in runs)
    lasting_sizes = _LASTING_SIZES if through_state else (0.0,)
    grid = np.array(list(product(_SIGNAL_SIZES / unit, _SIGNAL_MEMORIES, lasting_sizes)))
    scaled = [
        run._replace(innovation=run.innovation / noise, correction=run.correction / noise)
        for run in runs
    ]
    cost, squares, count = np.zeros(len(grid)), np.zeros(len(grid)), 0
    for run in scaled:
        measured = np.isfinite(run.innovation)
        enough = _TUNING_SAMPLES + int(np.argmax(measured))  # a sensor may have started late
        filtered = _filter(run, grid, lasting, enough)
        cost, squares = cost + filtered.logs, squares + filtered.squares
        count += int(measured[:enough].sum())
    best = int(np.argmin(cost + count * np.log(squares / count)))
    chosen = [_filter(run, grid[best : best + 1], lasting) for run in scaled]
    total = sum(float(filtered.squares[0]) for filtered in chosen)
    scale = noise * np.sqrt(total / valid.size)
    out = []
    for filtered in chosen:
        means, covariances = _smoother(filtered)
        error = scale * np.sqrt(np.maximum(covariances[:, 1, 1], 0.0))
        out.append((noise * means[:, 1], error))
    return out


class _Filtered(NamedTuple):
    """What the likelihood needs, at all points of a grid; at a single point every moment, too."""

    logs: np.ndarray
    squares: np.ndarray
    moments: list[tuple[np.ndarray, ...]]


def _filter(
    run: LinearErrors, grid: np.ndarray, lasting: float, samples: int | None = None
) -> _Filtered:
    """Kalman filter over (deviation, signal, lasting noise), at all points of a grid at once."""
    size, memory, share = grid.T
    remembers = np.exp(-1.0 / memory)
    points, no_state = len(grid), not run.push.any()
    x, p, q = np.zeros((points, 3)), np.zeros((points, 3, 3)), np.zeros((points, 3, 3))
    p[:, 0, 0], p[:, 1, 1], p[:, 2, 2] = 0.0 if no_state else 100.0, size**2, share**2
    q[:, 1, 1] = size**2 * (1.0 - remembers**2)
    q[:, 2, 2] = share**2 * (1.0 - lasting**2)
    logs, squares, moments = np.zeros(points), np.zeros(points), []
    for t in range(run.innovation[:samples].size):
        predicted = x, p
        if np.isfinite(run.innovation[t]):
            reads = np.array([1.0, run.direct[t], 1.0])
            covariance = p @ reads
            variance = covariance @ reads + 1.0
            error = run.innovation[t] - x @ reads
            x = x + covariance * (error / variance)[:, None]
            p = p - covariance[:, :, None] * (covariance / variance[:, None])[:, None, :]
            logs += np.log(variance)
            squares += error**2 / variance
        moves = np.zeros((points, 3, 3))
        moves[:, 0, 0], moves[:, 0, 1] = run.decay[t], run.push[t]
        moves[:, 1, 1], moves[:, 2, 2] = remembers, lasting
        if points == 1:
            moments.append((*(moment[0] for moment in (*predicted, x, p)), moves[0]))
        x = (moves @ x[:, :, None])[:, :, 0]
        x[:, 0] -= run.correction[t]
        p = moves @ p @ moves.transpose(0, 2, 1) + q
    return _Filtered(logs, squares, moments)


def _smoother(filtered: _Filtered) -> tuple[np.ndarray, np.ndarray]:
    """Means ``(T, 3)`` and covariances ``(T, 3, 3)``, given all samples."""
    predicted, spread, means, covariances, moves = map(
        np.array, zip(*filtered.moments, strict=True)
    )
    # singular where there is no state, or no lasting noise
    inverses = np.linalg.pinv(spread[1:], rcond=1e-12, hermitian=True)
    gains = covariances[:-1] @ moves[:-1].transpose(0, 2, 1) @ inverses
    for t in range(len(gains) - 1, -1, -1):
        gain = gains[t]
        means[t] += gain @ (means[t + 1] - predicted[t + 1])
        covariances[t] += gain @ (covariances[t + 1] - spread[t + 1]) @ gain.T
    return means, covariances


def _unit_of(model: Model, signal: SignalForm) -> str:
    """The unit of an input, state or output, or of its rate."""
    units = {**model.inputs, **model.optional_inputs, **model.all_states, "time": "s"}
    return f"{units[signal.name]}/s" if signal.rate else units.get(signal.name, "")
