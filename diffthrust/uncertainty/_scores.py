"""Scores (gradients of the log-likelihood by sample) and the covariance of their sum.

The covariance is summed over blocks of time within each log, because samples are correlated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.programs import program
from diffthrust._support.correlation import lag_one
from diffthrust.estimation._likelihood import jacobians, tightness
from diffthrust.estimation._numbers import ProblemNumbers
from diffthrust.estimation._problem import Layout, Problem

_LASTING = 0.97
"""Largest lag-one correlation used for prewhitening."""
_LEAST = 2.0
"""Fewest degrees of freedom: with fewer, an interval would be useless."""


@dataclass(frozen=True, eq=False)
class Scores:
    """The gradient of the cost by sample, and the matching curvature.

    Args:
        values: for each log the gradient of the negative log-likelihood with respect to the
            coordinates in ``places``, by channel and sample, ``(C, n + m, T)``; NaN where nothing
            was measured. Priors are not included.
        places: for each log the coordinates of its rows: shared ones, then its initial states.
        residuals: residuals over the noise level, for each log ``(C, T)``; NaN where nothing was
            measured. The likelihood assumes them white.
        curvature: expected Hessian of the cost without priors, in all coordinates, ``(N, N)``.
        prior: information of the priors, ``(N, N)``.
        samples: number of measured values.
    """

    values: tuple[np.ndarray, ...]
    places: tuple[np.ndarray, ...]
    residuals: tuple[np.ndarray, ...]
    curvature: np.ndarray
    prior: np.ndarray
    samples: int

    def lag_one(self) -> float:
        """The largest correlation of a channel's residuals from sample to sample.

        Zero if within the range of white noise (three standard deviations).
        """
        return max(map(lag_one, zip(*self.residuals, strict=True)), default=0.0)


def sample_scores(problem: Problem, z: np.ndarray) -> Scores:
    """Scores at given coordinates, by one forward-mode pass over the logs.

    For the Gaussian law the curvature is that of Gauss-Newton. For the Student-t law it is weighted
    by the mean derivative of the law's score in each channel, evaluated on the residuals: the
    weights of the fit's information would count outliers twice (Huber & Ronchetti 2009, section
    7.6). A failed simulation gives non-finite values.
    """
    batches = _pass(problem.layout, problem.numbers, jnp.asarray(z))
    n, m = problem.shared, problem.each
    curvature = np.zeros((z.size, z.size))
    rows_of: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
    at = n
    for results, batch, indices in zip(
        batches, problem.numbers.batches, problem.order, strict=True
    ):
        values, residuals, gram = (np.asarray(a) for a in results)
        absent = np.isnan(np.asarray(batch.measured))
        beyond = absent if batch.beyond is None else absent | (np.asarray(batch.beyond) != 0)
        residuals = np.where(beyond, np.nan, residuals)
        values = np.where(absent[:, :, None], np.nan, values)
        for row, index in enumerate(indices):
            size = len(problem.records[index])  # the rest is padding
            place = np.concatenate([np.arange(n), np.arange(at, at + m)])
            at += m
            curvature[np.ix_(place, place)] += gram[row]
            rows_of[index] = values[row, :, :, :size], place, residuals[row, :, :size]
    by_log = [rows_of[index] for index in range(len(problem.records))]
    return Scores(
        values=tuple(v for v, _, _ in by_log),
        places=tuple(p for _, p, _ in by_log),
        residuals=tuple(r for _, _, r in by_log),
        curvature=curvature,
        prior=_prior(problem, z),
        samples=int(np.sum(problem.numbers.counts)),
    )


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
    the next, and recoloured by its long-run gain (Andrews & Monahan 1992). Channels are then
    summed, as the noise of two sensors may be common, and products are summed over overlapping
    blocks with linearly falling weights (Newey & West 1987). Runs are ``(C, k, T)``, NaN where a
    channel was not measured.

    Returns:
        The covariance ``(k, k)``, the block length in samples, the factor by which correlation
        increases a variance ``(k,)``, and the degrees of freedom ``(k,)``.
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
            new = _new(channel_run, lasting) * colour[:, None]
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


def _new(run: np.ndarray, lasting: np.ndarray) -> np.ndarray:
    # the first sample is scaled to the variance of the innovations that follow
    first = run[:, :1] * np.sqrt(1 - lasting**2)[:, None]
    return np.concatenate([first, run[:, 1:] - lasting[:, None] * run[:, :-1]], axis=1)


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
