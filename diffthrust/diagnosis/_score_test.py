"""What the quadratic of one forward-mode pass says: the score test, and what a step promises."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diffthrust.diagnosis._held import of_effect
from diffthrust.estimation._likelihood import Quadratic

_MOST_REMOVED = 0.9
"""No step is taken to remove more of the squared errors than this, whatever it promises."""
_REDUNDANT = 1e-6
"""An effect is redundant that keeps less than this of its information beside the others."""


def score_test(
    information: np.ndarray, scores: np.ndarray, base: int
) -> tuple[float, np.ndarray, np.ndarray]:
    """Robust score test of coordinates at zero, after ``base`` estimated ones.

    The gradient is made orthogonal to that of the estimated coordinates (Neyman 1959). Its square
    in units of the information is divided by the scatter of the gradient over blocks of time in the
    same units, so that errors that last for less than a block raise no alarm. Also the one-step
    estimate of the coordinates and its covariance.

    Args:
        information: of all of them, ``(n, n)``.
        scores: the gradient by blocks of time, ``(n, blocks)``.
        base: how many are estimated; the first ones.
    """
    from scipy.special import fdtrc  # slow to import

    more = len(scores) - base
    nuisance, cross = information[:base, :base], information[base:, :base]
    through = cross @ np.linalg.pinv(nuisance, rcond=1e-11, hermitian=True)
    remaining = information[base:, base:] - through @ cross.T
    gradient = scores[base:] - through @ scores[:base]
    values, vectors = np.linalg.eigh(remaining)
    diagonal = np.diagonal(information)[base:]
    kept = values > 1e-8 * max(diagonal.max(initial=0.0), 1e-300)
    rank = int(kept.sum())
    blocks = int(np.sum(np.any(scores != 0, axis=0)))
    if rank == 0 or blocks < 3:
        return 1.0, np.zeros(more), np.full((more, more), np.nan)
    basis = vectors[:, kept] / np.sqrt(values[kept])
    projected = basis.T @ gradient
    scatter = max(1.0, float(np.sum(projected**2)) / rank)
    ratio = float(np.sum(projected.sum(axis=1) ** 2)) / rank / scatter
    inverse = basis @ basis.T
    estimated = -inverse @ gradient.sum(axis=1)
    return float(fdtrc(rank, rank * (blocks - 1), ratio)), estimated, inverse


def promised_gain(q: Quadratic, movable: np.ndarray) -> float:
    """What a full Gauss-Newton step promises to gain in log-likelihood.

    The likelihood goes with the logarithm of the squared errors: a step that is to remove most of
    them promises more than its quadratic says.
    """
    length = np.sqrt(np.diagonal(q.information))
    live = (length > 0) & movable
    scaled = q.information[np.ix_(live, live)] / np.outer(length[live], length[live])
    slope = q.gradient[live] / length[live]
    if not live.any() or not q.energy > 0:
        return 0.0
    removed = float(slope @ np.linalg.pinv(scaled, rcond=1e-9, hermitian=True) @ slope)
    energy = float(q.energy) / len(q.sigma)
    return -0.5 * energy * float(np.log1p(-min(removed / energy, _MOST_REMOVED)))


def redundant(q: Quadratic, names: Sequence[str], effect: str) -> bool:
    """Whether an effect does nothing that the other estimated parameters cannot."""
    live = np.diagonal(q.information) > 0
    of_this = np.zeros(live.size, bool)
    of_this[: len(names)] = [of_effect(n, effect) for n in names]
    length = np.sqrt(np.diagonal(q.information)[live])
    scaled = q.information[np.ix_(live, live)] / np.outer(length, length)
    of_this = of_this[live]
    if not of_this.any():
        return True
    cross, nuisance = scaled[np.ix_(of_this, ~of_this)], scaled[np.ix_(~of_this, ~of_this)]
    remaining = (
        scaled[np.ix_(of_this, of_this)] - cross @ np.linalg.pinv(nuisance, 1e-12, True) @ cross.T
    )
    return bool(np.diagonal(remaining).max() < _REDUNDANT)
