"""The sandwich covariance: standard errors valid for residuals correlated in time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import NormalDist
from typing import Any

import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.programs import program
from diffthrust._support.correlation import lag_one
from diffthrust._support.errors import InputError
from diffthrust._support.files import plain
from diffthrust._support.results import Brief
from diffthrust.estimation._insensitive import vanished
from diffthrust.estimation._likelihood import jacobians, tightness
from diffthrust.estimation._numbers import ProblemNumbers
from diffthrust.estimation._problem import Layout, Problem
from diffthrust.estimation._rebuild import problem_of
from diffthrust.estimation._result import Fit
from diffthrust.estimation._solver import solve
from diffthrust.estimation._status import RANK_LIMIT, Status, marginal_spread
from diffthrust.logs._log import Log


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
        >>> result = dft.uncertainty.sandwich(fit, log)
        >>> result.covariance.shape, result.free
        ((3, 3), ('alpha', 'beta', 'ct'))
        >>> low, high = result.interval("alpha", 0.95)
        >>> low < fit.parameters["alpha"].value < high, list(result.to_json())[:2]
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
        names = ("free", "covariance", "std_errors", "inflation", "memory", "degrees")
        block = {"samples": self.block, "seconds": self.block_seconds}
        return plain({"schema": 1, **{n: getattr(self, n) for n in names}, "block": block})


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
        >>> result = dft.uncertainty.sandwich(fit, log)
        >>> result.inflation["alpha"] > 0.5
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


_LASTING = 0.97
"""Largest lag-one correlation used for prewhitening."""
_LEAST = 2.0
"""Fewest degrees of freedom: with fewer, an interval would be useless."""


@dataclass(frozen=True, eq=False)
class Scores:
    """The gradient of the cost by sample, and the matching curvature."""

    values: tuple[np.ndarray, ...]
    """For each log the gradient of the negative log-likelihood, without priors, with respect to
    the coordinates in ``places``, by channel and sample, ``(C, n + m, T)``; NaN where nothing was
    measured."""
    places: tuple[np.ndarray, ...]
    """For each log the coordinates of its rows: shared ones, then its initial states."""
    residuals: tuple[np.ndarray, ...]
    """For each log, over the noise level, ``(C, T)``; NaN where nothing was measured."""
    curvature: np.ndarray
    """Expected Hessian of the cost without priors, in all coordinates, ``(N, N)``."""
    prior: np.ndarray
    """Information of the priors, ``(N, N)``."""
    samples: int
    """Number of measured values."""

    def lag_one(self) -> float:
        """The largest correlation of a channel's residuals from sample to sample.

        Zero if within the range of white noise (three standard deviations).
        """
        return max(map(lag_one, zip(*self.residuals, strict=True)), default=0.0)


def sample_scores(problem: Problem, z: np.ndarray) -> Scores:
    """Scores at given coordinates, by one forward-mode pass over the logs.

    Of the Student-t law the curvature is weighted by the mean derivative of the law's score in each
    channel, evaluated on the residuals: the weights of the fit's information would count outliers
    twice (Huber & Ronchetti 2009, section 7.6). A failed simulation gives non-finite values.
    """
    batches = _pass(problem.layout, problem.numbers, jnp.asarray(z))
    n, m = problem.shared, problem.each
    curvature = np.zeros((z.size, z.size))
    by_log: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
    for parts, batch, indices in zip(batches, problem.numbers.batches, problem.order, strict=True):
        values, residuals, gram = (np.asarray(a) for a in parts)
        absent = np.isnan(np.asarray(batch.measured))
        beyond = absent if batch.beyond is None else absent | (np.asarray(batch.beyond) != 0)
        residuals = np.where(beyond, np.nan, residuals)
        values = np.where(absent[:, :, None], np.nan, values)
        for row, index in enumerate(indices):
            size = len(problem.records[index])  # the rest is padding
            place = np.concatenate([np.arange(n), n + m * len(by_log) + np.arange(m)])
            curvature[np.ix_(place, place)] += gram[row]
            by_log[index] = values[row, :, :, :size], place, residuals[row, :, :size]
    ordered = [by_log[index] for index in range(len(problem.records))]
    values, places, residuals = zip(*ordered, strict=True)
    samples = int(np.sum(problem.numbers.counts))
    return Scores(values, places, residuals, curvature, _prior(problem, z), samples)


def _prior(problem: Problem, z: np.ndarray) -> np.ndarray:
    out = np.zeros((z.size, z.size))
    slopes = problem.slopes(z)
    for name, (_, std) in problem.numbers.prior.items():
        i = problem.free.index(name)
        out[i, i] = (slopes[i] / float(std)) ** 2
    own = np.arange(problem.shared, z.size)
    out[own, own] += np.tile(tightness(problem.layout, problem.numbers), len(problem.records))
    return out


@program(1)
def _pass(layout: Layout, numbers: ProblemNumbers, z: Any) -> list[tuple[Any, Any, Any]]:
    """By batch: scores ``(B, C, n + m, T)``, residuals ``(B, C, T)``, Gram matrices."""
    passes = jacobians(layout, numbers, z)
    residuals, law = [residual for residual, _ in passes], layout.likelihood.law
    _, sigma = layout.cost(numbers, residuals)
    bends = law.bend(residuals, numbers, sigma)
    out = []
    for (residual, jacobian), bend, batch in zip(passes, bends, numbers.batches, strict=True):
        level = sigma[None, :, None]
        straight, weight = law.straight(residual, sigma, batch)
        weighted = straight / level * weight
        values = jnp.einsum("bict,bct->bcit", jacobian / level[:, None], weighted)
        rows = jacobian * (jnp.sqrt(bend) / level)[:, None]
        out.append((values, residual / level, jnp.einsum("bict,bjct->bij", rows, rows)))
    return out


def summed(runs: Sequence[np.ndarray]) -> tuple[np.ndarray, float, np.ndarray, np.ndarray]:
    """Covariance of the sum of series: logs are independent, samples within a log are not.

    Each channel's series is prewhitened by a first-order autoregression from one measured sample to
    the next, and recoloured by its long-run gain. Channels are then summed, as the noise of two
    sensors may be common, and products are summed over overlapping blocks. Runs are ``(C, k, T)``,
    NaN where a channel was not measured. Also the block length in samples, the factor by which
    correlation increases a variance ``(k,)``, and the degrees of freedom ``(k,)``.
    """
    size = runs[0].shape[1]
    together = [np.zeros((size, run.shape[2])) for run in runs]
    # a row is NaN throughout for a parameter that the logs do not determine
    measured = [np.any(np.isfinite(run), axis=1) for run in runs]
    kept = [np.any(at, axis=0) for at in measured]
    weight, memory, doubt = np.zeros(size), np.zeros(size), np.zeros(size)
    for channel in range(runs[0].shape[0]):
        finite = [at[channel] for at in measured]
        series = [run[channel][:, at] for run, at in zip(runs, finite, strict=True)]
        samples = sum(channel_run.shape[1] for channel_run in series)
        if not samples:
            continue
        lasting = _lasting(series, samples)
        colour = 1 / (1 - lasting)
        energy = np.zeros(size)
        for out, channel_run, at in zip(together, series, finite, strict=True):
            # the first sample is scaled to the variance of the innovations that follow
            first = channel_run[:, :1] * np.sqrt(1 - lasting**2)[:, None]
            later = channel_run[:, 1:] - lasting[:, None] * channel_run[:, :-1]
            new = np.concatenate([first, later], axis=1) * colour[:, None]
            out[:, at] += new
            energy += (new**2).sum(axis=1)
        # relative variance of the long-run variance from the estimated coefficient a:
        # 4 var(a) / (1 - a)^2 with var(a) = (1 - a^2) / samples
        doubt += energy**2 * 4 * (1 + lasting) / (1 - lasting) / samples
        memory += energy * (1 + lasting) / (1 - lasting)
        weight += energy
    weight = np.where(weight > 0, weight, 1.0)
    columns = [out[:, at] for out, at in zip(together, kept, strict=True)]
    count = max(sum(out.shape[1] for out in columns), 1)
    block = _block(_lag_one_by_row(columns), count)
    scatter = np.zeros((size, size))
    for out in columns:
        scatter += out @ out.T
        for lag in range(1, min(math.ceil(block), out.shape[1])):
            product = out[:, lag:] @ out[:, :-lag].T
            # Bartlett's weights: the estimate stays positive definite, as equal weights would not
            scatter += (1 - lag / block) * (product + product.T)
    # relative variance from the blocks (Priestley 1981, table 6.1: 4/3 block over samples)
    relative = 4 / 3 * block / count + doubt / weight**2
    return scatter, block, np.maximum(memory / weight, 1.0), np.maximum(2 / relative, _LEAST)


def _lasting(series: Sequence[np.ndarray], samples: int) -> np.ndarray:
    """Lag-one correlation by which the series of a channel are prewhitened, ``(k,)``."""
    measured = _lag_one_by_row(series)
    # scores of a fit sum to zero, which biases their lag-one correlation downwards by
    # (1 + 3 a) / samples (Kendall 1954, Biometrika 41, 403)
    longer = (samples * measured + 1) / max(samples - 3, 1)
    # a memory beyond a quarter of the samples cannot be observed
    limit = min(_LASTING, max(samples - 4, 0) / (samples + 4))
    return np.clip(np.where(measured > 0, longer, 0.0), 0.0, limit)


def _lag_one_by_row(runs: Sequence[np.ndarray]) -> np.ndarray:
    """Lag-one correlation of each series about zero, ``(k,)``."""
    products = sum((run[:, 1:] * run[:, :-1]).sum(axis=1) for run in runs)
    squares = sum((run[:, :-1] ** 2).sum(axis=1) for run in runs)
    return np.asarray(products / np.where(np.asarray(squares) > 0, squares, 1.0))


def _block(lag_one: np.ndarray, samples: int) -> float:
    """Block length for first-order series with falling weights (Andrews 1991, eq. 6.4)."""
    a = np.clip(lag_one[np.isfinite(lag_one)], -_LASTING, _LASTING)
    if not a.size:
        return 1.0
    curved = np.sum(4 * a**2 / ((1 - a) ** 6 * (1 + a) ** 2)) / np.sum(1 / (1 - a) ** 4)
    return float(np.clip(1.1447 * (curved * samples) ** (1 / 3), 1.0, samples))
