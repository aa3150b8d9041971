"""Logs that disagree with the others, by the size of their errors and by their parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from diffthrust._support.words import joined, number, percent, spelt
from diffthrust.comparison._outstanding import beside_others, outstanding
from diffthrust.diagnosis._findings import OddLog
from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit
from diffthrust.diagnosis._log_slopes import Deviation, deviations, slopes
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.estimation._laws import TAIL
from diffthrust.estimation._one_step import Pass, passes
from diffthrust.simulation._runs import Run

_SHARES = 0.1, 2.0
"""Numerics: range, in steps that slopes promise, within which a log's value is searched."""
_FAR = 3.0
"""Display: a parameter that is off by more of itself is not given in per cent."""


def odd_logs(fitter: CandidateFitter, trial: TrialFit, runs: Sequence[Run]) -> tuple[OddLog, ...]:
    """The logs that are unlike the others.

    Either the error over the whole run stands out, or the one-step errors ask for another value of
    a parameter than those of all other logs, and with it the error over the whole run falls.

    Args:
        fitter: the fits.
        trial: the last model.
        runs: it over all logs, training logs first, then unseen ones, at its whole-run parameters.

    Returns:
        The odd logs, those that carry most of the error first.
    """
    if len(runs) < SETTINGS.outlier_logs.fewest_logs:
        return ()
    channels: dict[int, str] = {}
    words_of: dict[int, list[str]] = {}
    for outlier in sorted(outstanding(runs), key=lambda outlier: -outlier.ratio):
        channels.setdefault(outlier.place, outlier.channel)
    for off in deviating_logs(fitter, trial, len(runs)):
        channels.setdefault(off.log, fitter.channels[off.channel])
        words_of[off.log] = [_parameter_words(fitter, trial, off)]
    odd = []
    for k, channel in channels.items():
        outlier = next(
            (outlier for outlier in beside_others(runs, channel) if outlier.place == k), None
        )
        if outlier is None:  # it does not measure this channel
            continue
        words = (
            [_error_words(channel, outlier.ratio)]
            if outlier.ratio > SETTINGS.outlier_logs.least_error_ratio
            else []
        )
        odd.append(OddLog(outlier.run, channel, joined(words + words_of.get(k, [])), outlier.share))
    return tuple(sorted(odd, key=lambda log: -log.share))


def no_longer_odd(odd: Sequence[OddLog], baseline: Sequence[Run], updated: Sequence[Run]) -> bool:
    """Whether odd logs that err more than the others with one model no longer do with another."""

    def ratio(log: OddLog, runs: Sequence[Run]) -> float:
        every = beside_others(runs, log.channel)
        return next((entry.ratio for entry in every if entry.run == log.log), np.nan)

    return all(
        ratio(log, baseline) > SETTINGS.outlier_logs.least_error_ratio >= ratio(log, updated)
        for log in odd
    )


def deviating_logs(fitter: CandidateFitter, trial: TrialFit, count: int) -> list[Deviation]:
    """The logs whose parameters differ from those of the others by what matters in whole runs."""
    by_log = slopes(fitter, trial)
    if len(by_log) != count:
        return []
    sigma, deviating = np.asarray(trial.quadratic.sigma), []
    for deviation in deviations(by_log):
        deviation = _refitted(_passing(fitter, trial, deviation.log), deviation, sigma)
        simulation = replace(trial, values={**trial.values, **fitter.programs.uncorrected})
        if (
            _fall(_passing(fitter, simulation, deviation.log), deviation)
            < SETTINGS.outlier_logs.most_error_left
        ):
            deviating.append(deviation)
    return deviating


def _passing(fitter: CandidateFitter, trial: TrialFit, row: int) -> Callable[[np.ndarray], Pass]:
    """The pass over one log as a function of how far the parameters are moved, ``(P,)``."""
    problem = trial.at_values
    if row >= len(fitter.records):
        assert trial.unseen is not None
        row, problem = row - len(fitter.records), trial.unseen
    places = [i for i, n in enumerate(trial.names) if n not in fitter.nuisance]
    low, high = problem.limits()

    def passed(move: np.ndarray) -> Pass:
        z = problem.start()
        z[places] += move
        return passes(problem, np.clip(z, low, high))[row]

    return passed


def _refitted(
    passed: Callable[[np.ndarray], Pass], deviation: Deviation, sigma: np.ndarray
) -> Deviation:
    """The deviation that fits its log best, the other parameters being those of the other logs.

    What the slopes promise is one step of Gauss and Newton from where all logs agree: it may be
    twice as far as it is.
    """
    from scipy.optimize import minimize_scalar  # slow to import

    def cost(share: float) -> float:
        errors = (
            passed(deviation.others + share * (deviation.own - deviation.others)).errors
            / sigma[:, None]
        )
        return float(np.sum(np.log1p(errors[~np.isnan(errors)] ** 2 / TAIL)))

    optimum: Any = minimize_scalar(cost, bounds=_SHARES, method="bounded", options={"xatol": 0.01})
    share = float(optimum.x)
    return replace(deviation, size=share * deviation.size, error=share * deviation.error)


def _fall(passed: Callable[[np.ndarray], Pass], deviation: Deviation) -> float:
    """The squared whole-run error of a log with its own parameters, over that with the others'."""
    sums = []
    for move in (deviation.others, deviation.own):
        errors = passed(move)
        size = np.nanvar(errors.measured, axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            sums.append(float(np.nansum(np.nanmean(errors.errors**2, axis=1) / size)))
    return sums[1] / sums[0] if 0 < sums[0] < np.inf else 1.0


def _error_words(channel: str, ratio: float) -> str:
    return f"its {spelt(channel)} error is {number(ratio, 2)} times that of the median log"


def _parameter_words(fitter: CandidateFitter, trial: TrialFit, deviation: Deviation) -> str:
    names = [n for n in trial.names if n not in fitter.nuisance]
    name = names[deviation.parameter]
    p, way = trial.problem.named[name], "higher" if deviation.size > 0 else "lower"
    value = trial.values[name]
    if p.transform == "log":
        share = np.exp(deviation.size) - 1
    else:
        share = deviation.size * p.scale / value if value else np.inf
    by = f"some {percent(abs(share))} " if abs(share) < _FAR else ""
    errors = number(abs(deviation.size) / deviation.error, 2)
    return f"it asks for {name} {by}{way} than the others ({errors} standard errors)"
