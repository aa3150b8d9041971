"""What is measured: the jobs, their sizes, and how two answers are held against each other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ._problem import SAMPLES, STARTS


@dataclass(frozen=True)
class Job:
    """One kind of work.

    Args:
        name: in the table.
        unit: of its sizes.
        scale: from the command's sizes, in samples, to its own.
        apart: the largest difference of two answers.
        allowed: of that difference.
        count: units of work in an answer; times are divided by it.
    """

    name: str
    unit: str
    scale: Callable[[int], int]
    apart: Callable[[Any, Any], float]
    allowed: float
    count: Callable[[Any], float] = lambda answer: 1.0


def relative(ours: Any, theirs: Any) -> float:
    """Largest difference, number by number, over the size of each."""
    return float(np.max(np.abs(theirs - ours) / np.abs(ours)))


def over_scale(ours: Any, theirs: Any) -> float:
    """Largest difference over the largest number of its row."""
    scale = np.max(np.abs(ours), axis=-1, keepdims=True)
    return float(np.max(np.abs(theirs - ours) / scale))


def effective(draws: np.ndarray) -> np.ndarray:
    """Effective samples of each parameter by ArviZ's bulk estimate; draws are (chains, n, d)."""
    from diffthrust.uncertainty._sampling.arviz import arviz  # slow to import

    az = arviz()
    names = [str(i) for i in range(draws.shape[-1])]
    columns = {name: draws[..., i] for i, name in enumerate(names)}
    found = az.ess(az.from_dict(posterior=columns), method="bulk")
    return np.array([float(found[name]) for name in names])


def fewest(draws: np.ndarray) -> float:
    """Effective samples of the parameter that has the fewest."""
    return float(np.min(effective(draws)))


def monte_carlo_errors(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Largest difference of means and spreads, in its Monte Carlo standard errors."""
    (m, s, n), (mt, st, nt) = (
        (draws.mean(axis=(0, 1)), draws.std(axis=(0, 1)), effective(draws))
        for draws in (ours, theirs)
    )
    means = np.abs(m - mt) / np.sqrt(s**2 / n + st**2 / nt)
    spreads = np.abs(np.log(s / st)) / np.sqrt(0.5 / n + 0.5 / nt)
    return float(np.max([means, spreads]))


JOBS = {
    "simulation": Job("simulation", "samples", lambda n: n, over_scale, 1e-5),
    "fit": Job("fit, one start", "samples", lambda n: n, relative, 1e-4),
    "multi_start": Job(f"fit, {STARTS} starts", "samples", lambda n: n, relative, 1e-4),
    "posterior": Job(
        "posterior, an effective sample",
        "samples",
        lambda n: n,
        monte_carlo_errors,
        4.0,
        fewest,
    ),
    "describing_function": Job(
        "describing-function map", "points", lambda n: round(n**0.5 / 4) ** 2, relative, 1e-3
    ),
    "many_logs": Job(
        f"many logs of {SAMPLES} samples", "logs", lambda n: max(1, round(n / 64)), relative, 1e-4
    ),
}
