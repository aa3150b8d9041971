"""Proposals of the ensemble: independent ones by the fit's covariance, and moves by walkers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import emcee
import numpy as np

_TAILS = 5.0
"""Degrees of freedom of independent proposals: heavier tails than most posteriors."""
MOST_INDEPENDENT = 0.7
"""Share of independent proposals if enough are accepted."""
_ENOUGH = 0.3
"""Acceptance rate that is enough."""


def independent_proposals(
    centre: np.ndarray, root: np.ndarray
) -> Callable[[np.ndarray, Any], tuple[np.ndarray, np.ndarray]]:
    """Independence proposals: multivariate t about the fit.

    If the posterior is close to the fit's Gaussian, most are accepted, and each is an independent
    draw; the heavy tails bound the ratio of the densities, so that no walker gets stuck (Mengersen
    & Tweedie 1996).

    Returns:
        The proposal and the logarithm of q(old) / q(new), as for `emcee.moves.MHMove`.
    """
    dim = centre.size
    # Invert once: a LAPACK call may wait for its threads longer than the work takes.
    inverse = np.linalg.inv(root)

    def log_q(x: np.ndarray) -> np.ndarray:
        away = (x - centre) @ inverse.T
        return -0.5 * (_TAILS + dim) * np.log1p(np.sum(away**2, axis=1) / _TAILS)

    def propose(x: np.ndarray, rng: Any) -> tuple[np.ndarray, np.ndarray]:
        normal = rng.standard_normal(x.shape)
        longer = np.sqrt(_TAILS / rng.chisquare(_TAILS, size=(x.shape[0], 1)))
        new = centre + (longer * normal) @ root.T
        return new, log_q(x) - log_q(new)

    return propose


def moves(centre: np.ndarray, root: np.ndarray, share: float) -> list[tuple[Any, float]]:
    """Independence proposals, and moves by other walkers for non-Gaussian posteriors."""
    return [
        (emcee.moves.MHMove(independent_proposals(centre, root), ndim=centre.size), share),
        (emcee.moves.DEMove(), (1 - share) * 2 / 3),
        (emcee.moves.StretchMove(), (1 - share) / 3),
    ]


def suited(
    density: Callable[[np.ndarray], np.ndarray],
    points: np.ndarray,
    log_prob: np.ndarray,
    centre: np.ndarray,
    root: np.ndarray,
    seed: int,
) -> float:
    """The share of independence proposals: lower if few would be accepted.

    Estimated by one proposal from each of the points, ``(n, d)``, with a separate generator.
    """
    propose = independent_proposals(centre, root)
    new, factors = propose(points, np.random.RandomState(seed))
    accepted = np.exp(np.minimum(density(new)[:, 0] - log_prob + factors, 0.0))
    # never none at all: they are the only moves that leave one mode for another at once
    return max(0.1, MOST_INDEPENDENT * min(1.0, float(np.mean(accepted)) / _ENOUGH))


def learned(
    chain: np.ndarray, centre: np.ndarray, root: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Centre and covariance of the proposals from a segment of the warmup, ``(n, W, d)``.

    Near a bound, or for a curved posterior, they fit better than those of the fit, which are kept
    if the segment is short. The result depends only on the chain, so that a resumed run repeats it,
    and adaptation ends with the warmup: draws come from one fixed mixture of moves, which keeps the
    stationary distribution exact.
    """
    dim = centre.size
    points = chain.reshape(-1, dim)
    # twenty points for each entry of the covariance, or proposals follow the accidents of the
    # warmup
    if len(chain) < 50 or len(points) < 20 * dim**2:
        return centre, root
    try:
        return points.mean(axis=0), np.linalg.cholesky(np.atleast_2d(np.cov(points.T)))
    except np.linalg.LinAlgError:  # the walkers have not moved
        return centre, root
