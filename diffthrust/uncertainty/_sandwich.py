"""The sandwich covariance: standard errors valid for residuals correlated in time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import NormalDist
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.results import Brief
from diffthrust.estimation._insensitive import vanished
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._rebuild import problem_of
from diffthrust.estimation._result import Fit
from diffthrust.estimation._solver import solve
from diffthrust.estimation._status import RANK_LIMIT, Status, marginal_spread
from diffthrust.logs._log import Log
from diffthrust.uncertainty._scores import Scores, sample_scores, summed


@dataclass(frozen=True, eq=False, repr=False)
class Sandwich(Brief):
    """Uncertainty of a fit without the assumption that its residuals are white.

    Args:
        covariance: of the parameters in ``free``, ``(k, k)``, in their units; NaN where undefined,
            as in the fit's.
        free: names of its rows.
        std_errors: by name; ``None`` where undefined.
        inflation: by name, the standard error over that of the fit; near 1 where the residuals
            are white. ``None`` where either is undefined.
        block: length of the overlapping blocks of time, in samples, after prewhitening.
        block_seconds: the same [s], by the median step of the logs; NaN for static logs.
        memory: by name, number of successive samples that count as one.
        degrees: by name, degrees of freedom of the standard error, for the quantile of Student's t:
            a variance estimated from few independent blocks is itself uncertain.
        values: the estimates, by name.

    Example:
        >>> found = dft.uncertainty.sandwich(fit, log)
        >>> found.covariance.shape, found.free
        ((3, 3), ('alpha', 'beta', 'ct'))
        >>> low, high = found.interval("alpha", 0.95)
        >>> low < fit.parameters["alpha"].value < high, list(found.to_json())[:2]
        (True, ['schema', 'free'])
    """

    covariance: np.ndarray = field(repr=False)
    free: tuple[str, ...]
    std_errors: Mapping[str, float | None]
    inflation: Mapping[str, float | None]
    block: float
    block_seconds: float
    memory: Mapping[str, float]
    degrees: Mapping[str, float]
    values: Mapping[str, float]

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float] | None:
        """Confidence interval of a parameter in its unit; ``None`` if it has no error."""
        error = self.std_errors[name]
        if error is None:
            return None
        reach = quantile(level, self.degrees[name]) * error
        return self.values[name] - reach, self.values[name] + reach

    def to_json(self) -> dict[str, Any]:
        """Plain data; the covariance by rows, ``None`` where undefined."""
        rows = [[float(c) if math.isfinite(c) else None for c in row] for row in self.covariance]
        return {
            "schema": 1,
            "free": list(self.free),
            "covariance": rows,
            "std_errors": dict(self.std_errors),
            "inflation": dict(self.inflation),
            "block": {
                "samples": self.block,
                "seconds": self.block_seconds if math.isfinite(self.block_seconds) else None,
            },
            "memory": dict(self.memory),
            "degrees": dict(self.degrees),
        }


def sandwich(fit: Fit, logs: Log | Sequence[Log]) -> Sandwich:
    """Covariance that remains valid if residuals are correlated in time.

    The inverse curvature on both sides of the covariance of the scores (Huber 1967; White 1980).
    The latter is summed over overlapping blocks of time within each log, with linearly falling
    weights (Newey & West 1987), never across logs. Block lengths follow from the scores'
    correlation (Andrews 1991, first-order plug-in), after prewhitening by a first-order
    autoregression of each parameter's scores (Andrews & Monahan 1992): without it, intervals from
    some hundred samples cover too little. The coverage is measured in
    tests/uncertainty/test_coverage.py.

    It is valid for noise that is correlated, has another law than assumed, or grows with the
    signal. It cannot correct the bias from a missing effect.

    Args:
        fit: a fit that converged; of any likelihood, loss and noise model.
        logs: its training logs, in their order.

    Returns:
        A `Sandwich`.

    Raises:
        InputError: the fit failed or did not converge, or the logs are not its own.

    Source: Andrews 1991, Econometrica 59, 817; Andrews & Monahan 1992, Econometrica 60, 953.

    Example:
        >>> found = dft.uncertainty.sandwich(fit, log)
        >>> found.inflation["alpha"] > 0.5
        True
    """
    converged(fit, "sandwich")
    problem, z = problem_of(fit, logs)
    return sandwich_of(fit, problem, z, sample_scores(problem, z))


def converged(fit: Fit, what: str) -> None:
    """Raise `InputError` for a fit that is not at an optimum."""
    if not isinstance(fit, Fit):
        raise InputError(
            f"{what}: expected a fit, found {type(fit).__name__}.", "Give what dft.fit returns."
        )
    if fit.status in (Status.NOT_CONVERGED, Status.SIMULATION_FAILED):
        raise InputError(
            f"{what}: expected a fit that converged, its status is '{fit.status}'. {fit.message}",
            "Fit again, from nearer values, with more starts or with fewer free parameters.",
        )


def quantile(level: float, degrees: float) -> float:
    """Two-sided quantile of Student's t."""
    if degrees > 1e6:
        return NormalDist().inv_cdf(0.5 + 0.5 * level)
    from scipy.special import stdtrit  # slow to import

    return float(stdtrit(degrees, 0.5 + 0.5 * level))


def sandwich_of(fit: Fit, problem: Problem, z: np.ndarray, measured: Scores) -> Sandwich:
    """The sandwich of a problem whose scores are known."""
    inside, weights = _influence(problem, z, measured)
    names = [problem.own[i] for i in inside]
    pairs = zip(measured.places, measured.values, strict=True)
    runs = [weights[:, place] @ values for place, values in pairs]
    scatter, block, memory, degrees = summed(runs)
    # residuals of a fit are smaller than the errors by the parameters that were fitted (HC1)
    used = measured.samples / max(measured.samples - inside.size, 1)
    scatter = used * scatter + weights @ measured.prior @ weights.T
    slopes = problem.slopes(z)[inside]
    k = len(problem.own)
    covariance = np.full((k, k), np.nan)
    covariance[np.ix_(inside, inside)] = scatter * np.outer(slopes, slopes)
    spread = dict(zip(problem.own, np.sqrt(np.diagonal(covariance)), strict=True))
    errors = {n: float(s) if np.isfinite(s) else None for n, s in spread.items()}
    naive = {n: fit.parameters[n].std_error for n in problem.own}
    steps = [record.step for record in problem.records if len(record) > 1]
    timed = bool(problem.model.states) and bool(steps)
    return Sandwich(
        covariance=covariance,
        free=problem.own,
        std_errors=errors,
        inflation={
            n: s / fitted if s is not None and (fitted := naive[n]) else None
            for n, s in errors.items()
        },
        block=block,
        block_seconds=block * float(np.median(steps)) if timed else math.nan,
        memory=dict(zip(names, map(float, memory), strict=True)),
        degrees=dict(zip(names, map(float, degrees), strict=True)),
        values={n: fit.parameters[n].value for n in problem.own},
    )


def pressed(problem: Problem, z: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Coordinates at a bound and pushed against it: the curvature there gives no interval."""
    low, high = problem.limits()
    return ((z <= low + 1e-9) & (gradient >= 0)) | ((z >= high - 1e-9) & (gradient <= 0))


def _influence(problem: Problem, z: np.ndarray, measured: Scores) -> tuple[np.ndarray, np.ndarray]:
    """The free model parameters, and their influence function (change per score), ``(k, N)``.

    Coordinates are treated as in the fit's status: those at a bound are fixed, those of the noise
    are profiled out, and a parameter that is not identifiable is NaN.
    """
    gradient = np.asarray(solve(problem, z, budget=1).quadratic.gradient)
    information = measured.curvature + measured.prior
    k, free, place = len(problem.own), len(problem.free), np.arange(z.size)
    held = pressed(problem, z, gradient) | vanished(problem, z)
    held |= (place >= free) & (np.diagonal(information) <= 0)
    follows = (place >= k) & (place < free)
    inside, beside = np.flatnonzero(~held & ~follows), np.flatnonzero(~held & follows)
    length = np.sqrt(np.diagonal(information))
    length = np.where(length <= 0, 1.0, length)
    scaled = information / np.outer(length, length)
    _, projected = marginal_spread(gradient / length, scaled, inside, beside)
    values, vectors = np.linalg.eigh(projected)
    null = values <= RANK_LIMIT * max(values.max(initial=0.0), 1e-300)
    inverse = (vectors[:, ~null] / values[~null]) @ vectors[:, ~null].T
    cross, noise = scaled[np.ix_(inside, beside)], scaled[np.ix_(beside, beside)]
    weights = np.zeros((inside.size, z.size))
    weights[:, inside] = inverse
    # partitioned inverse: what a score of the noise moves in the parameters, with the noise
    # refitted
    weights[:, beside] = -inverse @ cross @ np.linalg.pinv(noise, rcond=1e-10, hermitian=True)
    weights /= length[inside][:, None] * length[None, :]
    # a parameter with a part in a null direction has no error; others keep theirs
    weights[np.any(np.abs(vectors[:, null]) > 1e-3, axis=1)] = np.nan
    own = inside < k
    return inside[own], weights[own]
