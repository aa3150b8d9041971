"""How the walkers of an ensemble move: by the fit's covariance, and by each other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import emcee
import numpy as np

_TAILS = 5.0
"""Degrees of freedom of the independent proposals: tails heavier than those of most posteriors."""
MOST_INDEPENDENT = 0.7
"""Share of the independent proposals, where enough of them are accepted."""
_ENOUGH = 0.3
"""The share of them that is enough."""


def independent_proposals(
    centre: np.ndarray, root: np.ndarray
) -> Callable[[np.ndarray, Any], tuple[np.ndarray, np.ndarray]]:
    """Proposals that do not depend on where a walker is: multivariate t about the fit.

    Where the posterior is near the fit's Gaussian most are accepted, and each is a new draw; the
    tails bound the ratio of the densities, so that no walker waits for ever (Mengersen & Tweedie
    1996).

    Returns:
        The proposal and the logarithm of q(old) / q(new), as `emcee.moves.MHMove` wants them.
    """
    dim = centre.size
    # once: a call of LAPACK may wait for its threads longer than the work takes
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
    """Independent proposals, and moves by the other walkers for posteriors of another form."""
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
    """The share of independent proposals: less where few of them would be accepted.

    Judged by one proposal from each of the points, ``(n, d)``, with a generator of its own.
    """
    propose = independent_proposals(centre, root)
    new, factors = propose(points, np.random.RandomState(seed))
    accepted = np.exp(np.minimum(density(new)[:, 0] - log_prob + factors, 0.0))
    return max(0.1, MOST_INDEPENDENT * min(1.0, float(np.mean(accepted)) / _ENOUGH))


def learned(
    chain: np.ndarray, centre: np.ndarray, root: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Centre and covariance of the proposals from a part of the warmup, ``(n, W, d)``.

    Beside a bound, or where the posterior is bent, they fit better than those of the fit, which are
    kept where the part is short. What is learned depends on the chain alone, and nothing is learned
    once the draws begin: the draws are those of one fixed mixture of moves.
    """
    dim = centre.size
    points = chain.reshape(-1, dim)
    if len(chain) < 50 or len(points) < 20 * dim**2:
        return centre, root
    try:
        return points.mean(axis=0), np.linalg.cholesky(np.atleast_2d(np.cov(points.T)))
    except np.linalg.LinAlgError:  # walkers that have not moved
        return centre, root
