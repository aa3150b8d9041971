"""Whole runs of logs that a fit has not seen, by leaving some of its own out.

A part of the logs is hidden: its measurements become missing values in numbers of the same shape,
so that nothing is compiled anew, and the fit is carried on from where it ended with all of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from diffthrust.estimation._arrange import rearranged
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._solver import Solved, solve
from diffthrust.logs._log import Log
from diffthrust.simulation._inputs import measured_start
from diffthrust.simulation._runs import Run, pooled_errors, runs_over

_FOLDS = 4
"""Logs are left out in so many groups."""
_BUDGET = 10
"""Steps of a fit to the rest, which begins near its end."""

Hidden = Mapping[int, tuple[float, float]]
"""By log, the time [s] from which to which its measurements are hidden."""


def parts_of(logs: Sequence[Log]) -> tuple[Hidden, ...]:
    """What to hide in turn: groups of logs, or either half of a log that is alone."""
    if len(logs) > 1:
        count = min(_FOLDS, len(logs))
        return tuple(
            dict.fromkeys(range(i, len(logs), count), (-math.inf, math.inf)) for i in range(count)
        )
    middle = 0.5 * float(logs[0].time[0] + logs[0].time[-1])
    return {0: (-math.inf, middle)}, {0: (middle, math.inf)}


def held_out_error(problem: Problem, end: Solved, logs: Sequence[Log]) -> float:
    """The error (NRMSE) of whole runs over what was hidden from the fit; infinite where it fails.

    Args:
        problem: at some horizon.
        end: its optimum.
        logs: as they were given.
    """
    runs: list[Run] = []
    for hidden in parts_of(logs):
        rest = without(problem, hidden)
        if not np.all(rest.numbers.counts > 0):  # a channel of these logs alone
            continue
        solved = solve(rest, end.z, budget=_BUDGET)
        if not np.isfinite(solved.quadratic.cost):
            return math.inf
        runs += _runs(rest, solved, hidden, logs)
    return pooled_errors(runs).nrmse if runs else math.inf


def without(problem: Problem, hidden: Hidden) -> Problem:
    """The same problem with some measurements missing."""
    batches = []
    for batch, indices in zip(problem.numbers.batches, problem.order, strict=True):
        measured = np.array(batch.measured)
        for row, index in enumerate(indices):
            if index in hidden:
                first, last = hidden[index]
                measured[row, :, (batch.time[row] >= first) & (batch.time[row] <= last)] = np.nan
        batches.append(replace(batch, measured=measured))
    return rearranged(problem, batches)


def _runs(problem: Problem, solved: Solved, hidden: Hidden, logs: Sequence[Log]) -> tuple[Run, ...]:
    """The model of a fit over whole logs, beside what was hidden from it."""
    model, substeps = problem.model_at(solved.z), problem.layout.grids[0].substeps
    seen, starts = [], []
    for index, (first, last) in hidden.items():
        log = logs[index]
        away = (log.time < first) | (log.time > last)
        parts = {name: np.where(away, np.nan, v) for name, v in log.measured.items()}
        if any(np.isfinite(v).any() for v in parts.values()):
            seen.append(log if not away.any() else log.replaced(measured=parts))
            starts.append(measured_start(model, log))
    return runs_over(model, seen, initial=starts, substeps=substeps) if seen else ()
