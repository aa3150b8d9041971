"""Scores: what each sample says of the parameters, log by log and in the order of time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support.correlation import lag_one
from diffthrust.estimation._likelihood import jacobians
from diffthrust.estimation._numbers import ProblemNumbers
from diffthrust.estimation._problem import Layout, Problem


@dataclass(frozen=True, eq=False)
class Scores:
    """The gradient of the cost by samples, and the curvature that belongs to it.

    Args:
        values: for each log the gradient of the negative log-likelihood with respect to the
            coordinates in ``places``, by channel and sample, ``(C, n + m, T)``; NaN where nothing
            was measured. Priors are no samples and not in it.
        places: for each log the coordinates of its rows: the shared ones, then its initial states.
        residuals: for each log and channel over the noise level, ``(C, T)``; NaN where nothing was
            measured. They are what the likelihood takes as white.
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

        Zero where it is within what chance gives to white noise (three standard deviations).
        """
        return max(map(lag_one, zip(*self.residuals, strict=True)), default=0.0)


def scores(problem: Problem, z: np.ndarray) -> Scores:
    """Scores at some coordinates, by one forward-mode pass over the logs.

    The curvature is the Gauss-Newton one for the Gaussian law. Under the Student-t law it is
    weighted by the mean slope of the law's score in each channel, measured on the residuals: the
    weights of the fit's own information would count outliers twice (Huber & Ronchetti 2009,
    section 7.6).

    Args:
        problem: an estimation problem.
        z: coordinates, ``(N,)``.

    Raises:
        Nothing: a simulation that fails gives values that are not finite.

    Example:
        >>> scores(*problem_of(fit, logs)).lag_one()
    """
    done = _pass(problem.layout, problem.numbers, jnp.asarray(z))
    n, m = problem.shared, len(problem.layout.starts)
    curvature = np.zeros((z.size, z.size))
    found: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
    at = n
    for part, batch, indices in zip(done, problem.numbers.batches, problem.order, strict=True):
        values, rests, gram = (np.asarray(a) for a in part)
        absent = np.isnan(np.asarray(batch.measured))
        rests = np.where(absent, np.nan, rests)
        values = np.where(absent[:, :, None], np.nan, values)
        for row, index in enumerate(indices):
            size = len(problem.logs[index])  # what follows is padding
            place = np.concatenate([np.arange(n), np.arange(at, at + m)])
            at += m
            curvature[np.ix_(place, place)] += gram[row]
            found[index] = values[row, :, :, :size], place, rests[row, :, :size]
    by_log = [found[index] for index in range(len(problem.logs))]
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
    return out


@partial(jax.jit, static_argnums=0)
def _pass(layout: Layout, numbers: ProblemNumbers, z: Any) -> list[tuple[Any, Any, Any]]:
    """By batch scores ``(B, C, n + m, T)``, residuals ``(B, C, T)``, grams of n + m columns."""
    passes = jacobians(layout, numbers, z)
    rests, law = [rest for rest, _ in passes], layout.likelihood.law
    _, sigma = layout.cost(numbers, rests)
    bend = law.bend(rests, numbers, sigma)
    out = []
    for rest, jacobian in passes:
        level = sigma[None, :, None]
        weighted = rest / level * law.weights(rest, sigma)
        values = jnp.einsum("bict,bct->bcit", jacobian / level[:, None], weighted)
        rows = jacobian * (jnp.sqrt(bend) / sigma)[None, None, :, None]
        out.append((values, rest / level, jnp.einsum("bict,bjct->bij", rows, rows)))
    return out
