"""What the quadratic of one forward-mode pass says: the score test, and the gain of a step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diffthrust.diagnosis._candidates import of_effect
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.estimation._likelihood import Quadratic

_MOST_REMOVED = 0.9
"""Numerics: share of the squared errors that a step is credited with removing at most: the
logarithm of what remains has no bound, and a linear response far from the null is not to be trusted
so far."""
_REDUNDANT = 1e-6
"""Numerics: an effect is redundant if it keeps less than this of its information beside the others:
rounding errors of the projection are some 1e-9."""


def project_out(
    information: np.ndarray, scores: np.ndarray, base: int
) -> tuple[np.ndarray, np.ndarray]:
    """Information and scores of coordinates, without what the first ``base`` ones do (Neyman 1959).

    Args:
        information: of all coordinates, ``(n, n)``.
        scores: the gradient by blocks of time, ``(n, blocks)``.
        base: the number of coordinates that are projected out.

    Returns:
        The information ``(n - base, n - base)`` and the scores ``(n - base, blocks)``.
    """
    nuisance, cross = information[:base, :base], information[base:, :base]
    # a pseudo-inverse: parameters that the logs do not determine make the information singular
    through = cross @ np.linalg.pinv(nuisance, rcond=1e-11, hermitian=True)
    return information[base:, base:] - through @ cross.T, scores[base:] - through @ scores[:base]


def score_test(
    information: np.ndarray, scores: np.ndarray, base: int
) -> tuple[float, np.ndarray, np.ndarray]:
    """Robust score test of coordinates at zero, after ``base`` estimated ones.

    The square of the projected gradient, in units of the information, is divided by the scatter of
    the gradient over blocks of time in the same units: errors that last for less than a block raise
    no alarm.

    Args:
        information: of all coordinates, ``(n, n)``.
        scores: the gradient by blocks of time, ``(n, blocks)``.
        base: the number of estimated coordinates, the first ones.

    Returns:
        The p-value, the one-step estimate of the coordinates, and its covariance.
    """
    from scipy.special import fdtrc  # slow to import

    count = len(scores) - base
    projected, gradient = project_out(information, scores, base)
    values, vectors = np.linalg.eigh(projected)
    # directions that the estimated coordinates can do all of have eigenvalues of rounding errors
    unprojected = np.diagonal(information)[base:].max(initial=0.0)
    kept = values > 1e-8 * max(unprojected, 1e-300)
    rank = int(kept.sum())
    blocks = int(np.sum(np.any(scores != 0, axis=0)))
    if rank == 0 or blocks < SETTINGS.structure.fewest_blocks:
        return 1.0, np.zeros(count), np.full((count, count), np.nan)
    basis = vectors[:, kept] / np.sqrt(values[kept])
    standardised = basis.T @ gradient
    scatter = max(1.0, float(np.sum(standardised**2)) / rank)
    ratio = float(np.sum(standardised.sum(axis=1) ** 2)) / rank / scatter
    covariance = basis @ basis.T
    estimated = -covariance @ gradient.sum(axis=1)
    return float(fdtrc(rank, rank * (blocks - 1), ratio)), estimated, covariance


def gauss_newton_step(
    information: np.ndarray, gradient: np.ndarray, movable: np.ndarray
) -> np.ndarray:
    """The full Gauss-Newton step in the coordinates that may move; zero in the others.

    The information is scaled to a unit diagonal first: parameters differ in unit by 1e3 and more.
    """
    length = np.sqrt(np.diagonal(information))
    live = (length > 0) & movable
    scaled = information[np.ix_(live, live)] / np.outer(length[live], length[live])
    slope = gradient[live] / length[live]
    step = np.zeros(gradient.size)
    step[live] = -(np.linalg.pinv(scaled, rcond=1e-9, hermitian=True) @ slope) / length[live]
    return step


def promised_gain(q: Quadratic, movable: np.ndarray) -> float:
    """The gain in log-likelihood that a full Gauss-Newton step promises.

    The likelihood goes with the logarithm of the squared errors: a step that removes most of them
    gains more than its quadratic says.
    """
    if not q.energy > 0:
        return 0.0
    step = gauss_newton_step(q.information, q.gradient, movable)
    removed = -float(np.sum(np.where(step != 0.0, q.gradient * step, 0.0)))
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
    through = cross @ np.linalg.pinv(nuisance, 1e-12, True)
    projected = scaled[np.ix_(of_this, of_this)] - through @ cross.T
    return bool(np.diagonal(projected).max() < _REDUNDANT)
