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
from diffthrust.estimation._laws import TAIL
from diffthrust.estimation._observer import is_memory
from diffthrust.estimation._one_step import Pass, passes
from diffthrust.simulation._runs import Run

_FEWEST = 3
"""Of fewer logs none is the odd one."""
_MATTERS = 0.9
"""With parameters of its own, a log's squared error over the whole run must fall to this."""
_TOLD = 1.5
"""An error that is not so many times that of the median log is not told beside a parameter."""
_SHARES = 0.1, 2.0
"""Of the step that slopes promise, how far a log's own value is looked for."""
_FAR = 3.0
"""How far a parameter is off is told in per cent up to this share of itself."""


def odd_logs(trials: CandidateFitter, trial: TrialFit, runs: Sequence[Run]) -> tuple[OddLog, ...]:
    """The logs that are unlike the others.

    Either the error over the whole run stands out, or the one-step errors ask for another value of
    a parameter than those of all other logs, and with it the error over the whole run falls.

    Args:
        trials: the fits.
        trial: the last model.
        runs: it over all logs, training logs first, then unseen ones, at its whole-run parameters.

    Returns:
        The odd logs, those that carry most of the error first.
    """
    if len(runs) < _FEWEST:
        return ()
    channels: dict[int, str] = {}
    told: dict[int, list[str]] = {}
    for one in sorted(outstanding(runs), key=lambda one: -one.ratio):
        channels.setdefault(one.place, one.channel)
    for off in deviating_logs(trials, trial, len(runs)):
        channels.setdefault(off.log, trials.channels[off.channel])
        told[off.log] = [_parameter_words(trials, trial, off)]
    found = []
    for k, channel in channels.items():
        one = next((one for one in beside_others(runs, channel) if one.place == k), None)
        if one is None:  # it does not measure what tells of it
            continue
        words = [_error_words(channel, one.ratio)] if one.ratio > _TOLD else []
        found.append(OddLog(one.run, channel, joined(words + told.get(k, [])), one.share))
    return tuple(sorted(found, key=lambda odd: -odd.share))


def no_longer_odd(odd: Sequence[OddLog], before: Sequence[Run], after: Sequence[Run]) -> bool:
    """Whether odd logs that err more than the others with one model no longer do with another."""

    def ratio(one: OddLog, runs: Sequence[Run]) -> float:
        every = beside_others(runs, one.channel)
        return next((found.ratio for found in every if found.run == one.log), np.nan)

    return all(ratio(one, before) > _TOLD >= ratio(one, after) for one in odd)


def deviating_logs(trials: CandidateFitter, trial: TrialFit, count: int) -> list[Deviation]:
    """The logs whose parameters differ from those of the others by what matters in whole runs."""
    by_log = slopes(trials, trial)
    if len(by_log) != count:
        return []
    sigma, found = np.asarray(trial.quadratic.sigma), []
    for one in deviations(by_log):
        one = _refitted(_passing(trials, trial, one.log), one, sigma)
        still = {n: 0.0 for n in trials.problem.nuisance if not is_memory(n)}
        pure = replace(trial, values={**trial.values, **still})
        if _fall(_passing(trials, pure, one.log), one) < _MATTERS:
            found.append(one)
    return found


def _passing(trials: CandidateFitter, trial: TrialFit, row: int) -> Callable[[np.ndarray], Pass]:
    """The pass over one log as a function of how far the parameters are moved, ``(P,)``."""
    problem = trial.at_values
    if row >= len(trials.records):
        unseen = trials.ready(trial.effects).unseen
        assert unseen is not None
        row -= len(trials.records)
        problem = trial.limit.on(unseen.focus(trial.names, trial.values))
    known = [i for i, n in enumerate(trial.names) if n not in trials.nuisance]
    low, high = problem.limits()

    def passed(move: np.ndarray) -> Pass:
        z = problem.start()
        z[known] += move
        return passes(problem, np.clip(z, low, high))[row]

    return passed


def _refitted(passed: Callable[[np.ndarray], Pass], one: Deviation, sigma: np.ndarray) -> Deviation:
    """The deviation that fits its log best, the other parameters being those of the other logs.

    What the slopes promise is one step of Gauss and Newton from where all logs agree: it may be
    twice as far as it is.
    """
    from scipy.optimize import minimize_scalar  # slow to import

    def cost(share: float) -> float:
        errors = passed(one.others + share * (one.own - one.others)).errors / sigma[:, None]
        return float(np.sum(np.log1p(errors[~np.isnan(errors)] ** 2 / TAIL)))

    found: Any = minimize_scalar(cost, bounds=_SHARES, method="bounded", options={"xatol": 0.01})
    share = float(found.x)
    return replace(one, size=share * one.size, error=share * one.error)


def _fall(passed: Callable[[np.ndarray], Pass], one: Deviation) -> float:
    """The squared whole-run error of a log with its own parameters, over that with the others'."""
    sums = []
    for move in (one.others, one.own):
        errors = passed(move)
        size = np.nanvar(errors.measured, axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            sums.append(float(np.nansum(np.nanmean(errors.errors**2, axis=1) / size)))
    return sums[1] / sums[0] if 0 < sums[0] < np.inf else 1.0


def _error_words(channel: str, ratio: float) -> str:
    return f"its {spelt(channel)} error is {number(ratio, 2)} times that of the median log"


def _parameter_words(trials: CandidateFitter, trial: TrialFit, one: Deviation) -> str:
    known = [n for n in trial.names if n not in trials.nuisance]
    name = known[one.parameter]
    p, way = trial.problem.named[name], "higher" if one.size > 0 else "lower"
    there = trial.values[name]
    if p.transform == "log":
        part = np.exp(one.size) - 1
    else:
        part = one.size * p.scale / there if there else np.inf
    by = f"some {percent(abs(part))} " if abs(part) < _FAR else ""
    errors = number(abs(one.size) / one.error, 2)
    return f"it asks for {name} {by}{way} than the others ({errors} standard errors)"
