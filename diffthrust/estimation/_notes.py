"""What a fit notes of errors correlated in time, where its standard errors say too little."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from diffthrust._support.correlation import lag_one
from diffthrust.estimation._likelihood import errors_at
from diffthrust.estimation._problem import Problem
from diffthrust.simulation._runs import Run, are_tables


def correlation_notes(problem: Problem, z: np.ndarray, runs: Sequence[Run]) -> tuple[str, ...]:
    """A sentence where errors are correlated that the likelihood takes as white.

    Args:
        problem: the problem of the fit.
        z: its optimum.
        runs: the fit over its training logs.
    """
    white = problem.layout.likelihood.whiteness(are_tables(problem.model, runs))
    if white.whole_runs:
        errors = [{n: t.residual for n, t in run.channels.items()} for run in runs]
    else:
        errors = errors_at(problem, z)
    lags = _correlated(errors, white.limit)
    return (white.sentence.format(lags),) if lags else ()


def _correlated(runs: Sequence[Mapping[str, np.ndarray]], limit: float) -> str:
    """Channels with a lag-one correlation beyond a limit and beyond chance, with its value."""
    lags = {}
    for name in dict.fromkeys(name for run in runs for name in run):
        lag = lag_one([run[name] for run in runs if name in run])
        if lag > limit:
            lags[name] = lag
    return ", ".join(f"{name} {lag:.2f}" for name, lag in lags.items())
