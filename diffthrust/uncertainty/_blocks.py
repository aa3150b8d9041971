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

    The series of each channel is prewhitened by a first-order autoregression of its own, from one
    measured sample to the next, and what is new in it counts for all that follows from it (Andrews
    & Monahan 1992). Then channels are summed, for noise of two sensors may be one, and over
    overlapping blocks with weights that fall linearly (Newey & West 1987).

    Args:
        runs: for each log ``(C, k, T)``; NaN where a channel was not measured.

    Returns:
        The covariance ``(k, k)``, the length of the blocks in samples, by how much the memory of
        the series widens a variance ``(k,)``, and the degrees of freedom ``(k,)``.
    """
    size = runs[0].shape[1]
    together = [np.zeros((size, run.shape[2])) for run in runs]
    # a row may be NaN throughout, of a parameter of which nothing is known
    measured = [np.any(np.isfinite(run), axis=1) for run in runs]
    kept = [np.any(at, axis=0) for at in measured]
    weight, memory, doubt = np.zeros(size), np.zeros(size), np.zeros(size)
    for channel in range(runs[0].shape[0]):
        seen = [at[channel] for at in measured]
        series = [run[channel][:, at] for run, at in zip(runs, seen, strict=True)]
        samples = sum(one.shape[1] for one in series)
        if not samples:
            continue
        lasting = _lasting(series, samples)
        colour = 1 / (1 - lasting)
        energy = np.zeros(size)
        for out, one, at in zip(together, series, seen, strict=True):
            new = _new(one, lasting) * colour[:, None]
            out[:, at] += new
            energy += (new**2).sum(axis=1)
        # relative variance of a variance from an autoregression, 4 var(a) / (1 - a)^2 with
        # var(a) = (1 - a^2) / samples
        doubt += energy**2 * 4 * (1 + lasting) / (1 - lasting) / samples
        memory += energy * (1 + lasting) / (1 - lasting)
        weight += energy
    weight = np.where(weight > 0, weight, 1.0)
    columns = [out[:, at] for out, at in zip(together, kept, strict=True)]
    count = max(sum(out.shape[1] for out in columns), 1)
    block = _block(_lag_one(columns), count)
    found = np.zeros((size, size))
    for out in columns:
        found += out @ out.T
        for lag in range(1, min(math.ceil(block), out.shape[1])):
            product = out[:, lag:] @ out[:, :-lag].T
            found += (1 - lag / block) * (product + product.T)
    # and of the blocks (Priestley 1981, table 6.1: 4/3 block over samples)
    relative = 4 / 3 * block / count + doubt / weight**2
    return found, block, np.maximum(memory / weight, 1.0), np.maximum(2 / relative, LEAST)


def _lasting(series: Sequence[np.ndarray], samples: int) -> np.ndarray:
    """Correlation from sample to sample that is taken out of the series of a channel, ``(k,)``."""
    measured = _lag_one(series)
    # the scores of a fit sum to zero, which makes them seem to last less than they do: by
    # (1 + 3 a) / samples (Kendall 1954, Biometrika 41, 403)
    longer = (samples * measured + 1) / max(samples - 3, 1)
    # nothing can be seen to last longer than a quarter of the samples
    limit = min(LASTING, max(samples - 4, 0) / (samples + 4))
    return np.clip(np.where(measured > 0, longer, 0.0), 0.0, limit)


def _new(run: np.ndarray, lasting: np.ndarray) -> np.ndarray:
    first = run[:, :1] * np.sqrt(1 - lasting**2)[:, None]  # as uncertain as those that follow
    return np.concatenate([first, run[:, 1:] - lasting[:, None] * run[:, :-1]], axis=1)


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
