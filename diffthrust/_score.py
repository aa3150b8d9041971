"""What one forward-mode pass says of parameters that were not estimated: the score test."""

from __future__ import annotations

import numpy as np

from diffthrust._likelihood import Quadratic

MOST_REMOVED = 0.9
"""No step is taken to remove more of the squared errors than this, whatever it promises."""


def score_test(q: Quadratic, base: int, more: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Robust score test of ``more`` coordinates at zero, after ``base`` estimated ones.

    The gradient is made orthogonal to that of the estimated coordinates (Neyman 1959), and its
    scatter is taken from blocks of time (Hotelling's law for their number). Also the one-step
    estimate of the coordinates and its covariance.
    """
    from scipy.special import fdtrc  # slow to import

    information = np.asarray(q.information)[: base + more, : base + more]
    scores = np.asarray(q.scores)[: base + more]
    nuisance, cross = information[:base, :base], information[base:, :base]
    through = cross @ np.linalg.pinv(nuisance, rcond=1e-11, hermitian=True)
    left = information[base:, base:] - through @ cross.T
    clear = scores[base:] - through @ scores[:base]
    total = clear.sum(axis=1)
    values, vectors = np.linalg.eigh(left)
    own = np.diagonal(information)[base:]
    kept = values > 1e-8 * max(own.max(initial=0.0), 1e-300)
    rank = int(kept.sum())
    if rank == 0:
        return 1.0, np.zeros(more), np.full((more, more), np.nan)
    basis = vectors[:, kept] / np.sqrt(values[kept])
    seen = basis.T @ clear
    blocks = int(np.sum(np.any(scores != 0, axis=0)))
    moved = basis.T @ total
    if blocks <= rank + 2:
        return 1.0, np.zeros(more), np.full((more, more), np.nan)
    centred = seen - moved[:, None] / blocks * np.any(scores != 0, axis=0)
    scatter = centred @ centred.T * blocks / (blocks - 1)
    hotelling = float(moved @ np.linalg.solve(scatter, moved))
    ratio = hotelling * (blocks - rank) / ((blocks - 1) * rank)
    inverse = basis @ basis.T
    return float(fdtrc(rank, blocks - rank, ratio)), -inverse @ total, inverse


def promise(q: Quadratic, movable: np.ndarray) -> float:
    """What a full Gauss-Newton step promises to gain in log-likelihood.

    The likelihood goes with the logarithm of the squared errors: a step that is to remove most of
    them promises more than its quadratic says.
    """
    length = np.sqrt(np.diagonal(q.information))
    live = (length > 0) & movable
    scaled = q.information[np.ix_(live, live)] / np.outer(length[live], length[live])
    slope = q.gradient[live] / length[live]
    removed = float(slope @ np.linalg.pinv(scaled, rcond=1e-9, hermitian=True) @ slope)
    energy = float(q.energy) / len(q.sigma)
    return -0.5 * energy * float(np.log1p(-min(removed / energy, MOST_REMOVED)))
