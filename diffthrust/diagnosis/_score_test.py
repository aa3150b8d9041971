"""Whether coordinates at zero differ from it by more than chance, beside estimated ones."""

from __future__ import annotations

import numpy as np

from diffthrust.diagnosis._settings import SETTINGS


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
    scores = np.where(np.isfinite(np.diagonal(information))[:, None], scores, 0.0)
    information = without_overflow(information)
    nuisance, cross = information[:base, :base], information[base:, :base]
    # a pseudo-inverse: parameters that the logs do not determine make the information singular
    through = cross @ np.linalg.pinv(nuisance, rcond=1e-11, hermitian=True)
    return information[base:, base:] - through @ cross.T, scores[base:] - through @ scores[:base]


def without_overflow(information: np.ndarray) -> np.ndarray:
    """An information, zero for coordinates whose derivatives overflow along a path.

    They can be neither tested nor moved. A diagonal that is finite bounds all beside it. Of a
    Kingfisher, whose sway nobody measures, one was not, and no eigenvalues are found then.
    """
    finite = np.isfinite(np.diagonal(information))
    return np.where(np.outer(finite, finite), information, 0.0)


def score_test(
    information: np.ndarray, scores: np.ndarray, base: int
) -> tuple[float, np.ndarray, np.ndarray]:
    """Robust score test of coordinates at zero, after ``base`` estimated ones.

    The square of the projected gradient, in units of the information, is divided by the scatter of
    the gradient over blocks of time in the same units: errors that last for less than a block raise
    no alarm. Arguments as of `project_out`.

    Returns:
        The p-value, the one-step estimate of the coordinates, and its covariance.
    """
    from scipy.special import fdtrc  # slow to import

    count = len(scores) - base
    projected, gradient = project_out(information, scores, base)
    values, vectors = np.linalg.eigh(projected)
    # directions that the estimated coordinates can do all of have eigenvalues of rounding errors
    unprojected = np.diagonal(without_overflow(information))[base:].max(initial=0.0)
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
