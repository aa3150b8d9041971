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
from diffthrust.simulation._record import Record
from diffthrust.simulation._runs import Run, pooled_errors, runs_over

_FOLDS = 4
"""Logs are left out in so many groups."""
_BUDGET = 10
"""Steps of a fit to the rest, which begins near its end."""

Hidden = Mapping[int, tuple[float, float]]
"""By log, the time [s] from which to which its measurements are hidden."""


def folds(records: Sequence[Record]) -> tuple[Hidden, ...]:
    """What to hide in turn: groups of logs, or either half of a single log."""
    if len(records) > 1:
        count = min(_FOLDS, len(records))
        return tuple(
            dict.fromkeys(range(i, len(records), count), (-math.inf, math.inf))
            for i in range(count)
        )
    middle = 0.5 * float(records[0].time[0] + records[0].time[-1])
    return {0: (-math.inf, middle)}, {0: (middle, math.inf)}


def held_out_error(problem: Problem, end: Solved) -> float:
    """The error (NRMSE) of whole runs over what was hidden from the fit; infinite where it fails.

    Args:
        problem: at some horizon.
        end: its optimum.
    """
    runs: list[Run] = []
    for hidden in folds(problem.records):
        remaining = without(problem, hidden)
        if not np.all(remaining.numbers.counts > 0):  # only hidden logs measure some channel
            continue
        solved = solve(remaining, end.z, budget=_BUDGET)
        if not np.isfinite(solved.quadratic.cost):
            return math.inf
        runs += _runs(remaining, solved, hidden)
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


def _runs(problem: Problem, solved: Solved, hidden: Hidden) -> tuple[Run, ...]:
    """The model of a fit over whole records, beside what was hidden from it."""
    model, substeps = problem.model_at(solved.z), problem.layout.grids[0].substeps
    held_out = []
    for index, (first, last) in hidden.items():
        record = problem.records[index]
        outside = (record.time < first) | (record.time > last)
        measured = {n: np.where(outside, np.nan, v) for n, v in record.measured.items()}
        if any(np.isfinite(values).any() for values in measured.values()):
            held_out.append(replace(record, measured=measured) if outside.any() else record)
    return runs_over(model, held_out, substeps=substeps) if held_out else ()
