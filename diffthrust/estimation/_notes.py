"""What a fit notes of errors correlated in time, where its standard errors say too little."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from diffthrust._support.correlation import lag_one
from diffthrust.estimation._innovations import one_step_errors
from diffthrust.estimation._likelihood import errors_at
from diffthrust.estimation._problem import Problem
from diffthrust.simulation._runs import Run, are_tables

CORRELATED = 0.5
"""Residuals with a larger lag-one correlation are reported as coloured."""
WHITE = 0.1
"""The same for errors that have no reason to be correlated at all."""


def correlation_notes(problem: Problem, z: np.ndarray, runs: Sequence[Run]) -> list[str]:
    """A sentence where errors are correlated that the likelihood takes as white.

    Args:
        problem: the problem of the fit.
        z: its optimum.
        runs: the fit over its training logs.
    """
    if problem.layout.observer is not None:
        told = _told(one_step_errors(problem, z), WHITE)
        words = "One-step errors are correlated from sample to sample ({}): something is missing "
        words += "from the model. The standard errors assume that nothing is and are too small."
    elif problem.layout.lasting:
        told = _told(errors_at(problem, z), WHITE)
        words = "What is new in the noise at each sample is still correlated with the sample "
        words += "before ({}): the noise is of another kind, or something is missing from the "
        words += "model. The standard errors assume an autoregression and are too small."
    else:
        residuals = [{n: t.residual for n, t in run.channels.items()} for run in runs]
        told = _told(residuals, CORRELATED)
        words = "Residuals are correlated from sample to sample ({}): something is missing from "
        words += "the model, or the noise is coloured. The standard errors assume white noise and "
        words += "are too small" + (
            "." if are_tables(problem.model, runs) else "; see Comparison.noise_advice."
        )
    return [words.format(told)] if told else []


def _told(runs: Sequence[Mapping[str, np.ndarray]], limit: float) -> str:
    """Channels with a lag-one correlation beyond a limit and beyond chance, with its value."""
    found = {}
    for name in dict.fromkeys(name for run in runs for name in run):
        lag = lag_one([run[name] for run in runs if name in run])
        if lag > limit:
            found[name] = lag
    return ", ".join(f"{name} {lag:.2f}" for name, lag in found.items())
