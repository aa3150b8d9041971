"""Logs that disagree with the others, by the size of their errors and by their parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diffthrust._support.tables import number
from diffthrust._support.words import joined, percent, spelt
from diffthrust.comparison._outstanding import beside_others, outstanding
from diffthrust.diagnosis._findings import OddLog
from diffthrust.diagnosis._log_slopes import Deviation, deviations, slopes
from diffthrust.diagnosis._trials import TrialFit, Trials
from diffthrust.estimation._observer import is_memory
from diffthrust.estimation._one_step import passes
from diffthrust.simulation._runs import Run

_FEWEST = 3
"""Of fewer logs none is the odd one."""
_MATTERS = 0.9
"""With parameters of its own, a log's squared error over the whole run must fall to this."""
_TOLD = 1.5
"""An error that is not so many times that of the median log is not told beside a parameter."""
_FAR = 3.0
"""How far a parameter is off is told in per cent up to this share of itself."""


def odd_logs(trials: Trials, trial: TrialFit, runs: Sequence[Run]) -> tuple[OddLog, ...]:
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
    for off in told_apart(trials, trial, len(runs)):
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


def told_apart(trials: Trials, trial: TrialFit, count: int) -> list[Deviation]:
    """The logs whose parameters differ from those of the others by what matters in whole runs."""
    by_log = slopes(trials, trial)
    if len(by_log) != count:
        return []
    return [one for one in deviations(by_log) if _fall(trials, trial, one) < _MATTERS]


def _fall(trials: Trials, trial: TrialFit, one: Deviation) -> float:
    """The squared whole-run error of a log with its own parameters, over that with the others'."""
    still = {n: 0.0 for n in trials.problem.nuisance if not is_memory(n)}
    pure = replace(trial, values={**trial.values, **still})
    problem, row = pure.there, one.log
    if row >= len(trials.logs):
        unseen = trials.ready(trial.effects).unseen
        assert unseen is not None
        row -= len(trials.logs)
        problem = trial.limit.on(unseen.focus(pure.names, pure.values))
    known = [i for i, n in enumerate(trial.names) if n not in trials.nuisance]
    low, high = problem.limits()
    sums = []
    for move in (one.others, one.own):
        z = problem.start()
        z[known] += move
        errors = passes(problem, np.clip(z, low, high))[row]
        size = np.nanvar(errors.measured, axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            sums.append(float(np.nansum(np.nanmean(errors.errors**2, axis=1) / size)))
    return sums[1] / sums[0] if 0 < sums[0] < np.inf else 1.0


def _error_words(channel: str, ratio: float) -> str:
    return f"its {spelt(channel)} error is {number(ratio, 2)} times that of the median log"


def _parameter_words(trials: Trials, trial: TrialFit, one: Deviation) -> str:
    known = [n for n in trial.names if n not in trials.nuisance]
    name = known[one.parameter]
    p, way = trials.problem.named[name], "higher" if one.size > 0 else "lower"
    there = trial.values[name]
    if p.transform == "log":
        part = np.exp(one.size) - 1
    else:
        part = one.size * p.scale / there if there else np.inf
    by = f"some {percent(abs(part))} " if abs(part) < _FAR else ""
    errors = number(abs(one.size) / one.error, 2)
    return f"it asks for {name} {by}{way} than the others ({errors} standard errors)"
