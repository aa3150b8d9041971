"""How far a sum over correlated samples scatters, from blocks of time."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

LASTING = 0.97
"""A series is taken to last no longer than this correlation from sample to sample allows."""
LEAST = 2.0
"""Fewest degrees of freedom: with less, an interval would say nothing at all."""


def summed(runs: Sequence[np.ndarray]) -> tuple[np.ndarray, float, np.ndarray, np.ndarray]:
    """Covariance of the sum of series, whose logs are independent and whose samples are not.

    Each series is prewhitened by a first-order autoregression of its own (Andrews & Monahan 1992),
    the rest is summed over overlapping blocks with weights that fall linearly (Newey & West 1987).

    Args:
        runs: for each log ``(k, T)``.

    Returns:
        The covariance ``(k, k)``, the length of the blocks in samples, the correlation from sample
        to sample that was taken out before ``(k,)``, and the degrees of freedom ``(k,)``.
    """
    samples = sum(run.shape[1] for run in runs)
    measured = _lag_one(runs)
    # the scores of a fit sum to zero, which makes them seem to last less than they do: by
    # (1 + 3 a) / samples (Kendall 1954, Biometrika 41, 403)
    longer = (samples * measured + 1) / max(samples - 3, 1)
    # nothing can be seen to last longer than a quarter of the samples
    limit = min(LASTING, max(samples - 4, 0) / (samples + 4))
    lasting = np.clip(np.where(measured > 0, longer, 0.0), 0.0, limit)
    new = []
    for run in runs:
        first = run[:, :1] * np.sqrt(1 - lasting**2)[:, None]  # as uncertain as those that follow
        new.append(np.concatenate([first, run[:, 1:] - lasting[:, None] * run[:, :-1]], axis=1))
    block = _block(_lag_one(new), samples)
    out = np.zeros((lasting.size, lasting.size))
    for run in new:
        out += run @ run.T
        for lag in range(1, min(math.ceil(block), run.shape[1])):
            product = run[:, lag:] @ run[:, :-lag].T
            out += (1 - lag / block) * (product + product.T)
    colour = 1 / (1 - lasting)
    # relative variance of a variance: of the blocks (Priestley 1981, table 6.1: 4/3 block over
    # samples), and of the autoregression, 4 var(a) / (1 - a)^2 with var(a) = (1 - a^2) / samples
    relative = (4 / 3 * block + 4 * (1 + lasting) / (1 - lasting)) / samples
    degrees = np.maximum(2 / relative, LEAST)
    return out * np.outer(colour, colour), block, lasting, degrees


def _lag_one(runs: Sequence[np.ndarray]) -> np.ndarray:
    """Correlation of each series with itself one sample later, about zero, ``(k,)``."""
    products = sum((run[:, 1:] * run[:, :-1]).sum(axis=1) for run in runs)
    squares = sum((run[:, :-1] ** 2).sum(axis=1) for run in runs)
    return np.asarray(products / np.where(np.asarray(squares) > 0, squares, 1.0))


def _block(lag_one: np.ndarray, samples: int) -> float:
    """Length of blocks with falling weights for first-order series (Andrews 1991, eq. 6.4)."""
    a = np.clip(lag_one[np.isfinite(lag_one)], -LASTING, LASTING)
    if not a.size:
        return 1.0
    curved = np.sum(4 * a**2 / ((1 - a) ** 6 * (1 + a) ** 2)) / np.sum(1 / (1 - a) ** 4)
    return float(np.clip(1.1447 * (curved * samples) ** (1 / 3), 1.0, samples))
