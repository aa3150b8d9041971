"""Correlation in time of series that come in several runs and have gaps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

_FEW = 20
"""Pairs of values; from fewer no correlation is estimated."""


def ljung_box(correlation: np.ndarray, samples: int) -> float:
    """P-value of white noise (Ljung & Box 1978), by autocorrelations at lags 1, 2, ...

    The correlations are ``(h,)``; ``samples`` is the number of samples behind them.
    """
    from scipy.special import chdtrc  # slow to import

    lag = np.arange(1, correlation.size + 1)
    q = samples * (samples + 2) * np.sum(correlation**2 / (samples - lag))
    return float(chdtrc(correlation.size, q))


def integral(correlation: np.ndarray) -> float:
    """Sum of an autocorrelation over both sides, up to its first zero; at least 1."""
    # Cut at the first zero: summed over all lags, an estimated autocorrelation always adds up to
    # -1/2, whatever the process.
    negative = np.flatnonzero(correlation <= 0)
    return max(1.0, float(2 * correlation[: negative[0] if negative.size else None].sum() - 1))


def autocorrelation(runs: Sequence[np.ndarray], lags: int) -> np.ndarray:
    """Autocorrelation at lags 0, ..., `lags`, pooled over runs about their common mean.

    Missing samples (NaN) are left out of the products. Weighted as if divided by the number of
    samples at every lag, so that the estimate is a positive sequence.
    """
    late = covariance(runs, runs, lags)[lags:]
    return late / late[0] if late[0] > 0 else np.where(np.arange(lags + 1) == 0, 1.0, 0.0)


def lag_one(runs: Sequence[np.ndarray]) -> float:
    """Correlation of each measured value with the one measured before it, pooled over runs.

    Missing samples are left out: what was read at every tenth sample is compared with the reading
    before. Zero where it is within what chance gives to white noise (three standard deviations),
    and where there are too few values to tell.
    """
    valid = [run[np.isfinite(run)] for run in runs]
    later, earlier = (
        np.concatenate([np.zeros(0), *parts])
        for parts in ([values[1:] for values in valid], [values[:-1] for values in valid])
    )
    if later.size <= _FEW:
        return 0.0
    later -= later.mean()
    earlier -= earlier.mean()
    # by each one's size: the product of the squares overflows where a run does nearly
    size = float(np.linalg.norm(later)) * float(np.linalg.norm(earlier))
    correlation = float(later @ earlier) / size if size > 0 else 0.0
    return correlation if correlation > 3 / np.sqrt(later.size) else 0.0


def covariance(first: Sequence[np.ndarray], second: Sequence[np.ndarray], lags: int) -> np.ndarray:
    """Covariance at lags ``-lags .. lags``, positive where `first` follows `second`; pooled."""
    means = [np.nanmean(np.concatenate(list(x))) for x in (first, second)]
    products, counts, full = (np.zeros(2 * lags + 1) for _ in range(3))
    reach = np.abs(np.arange(-lags, lags + 1))
    for x, y in zip(first, second, strict=True):
        x_valid, y_valid = np.isfinite(x), np.isfinite(y)
        flat = np.where(x_valid, x - means[0], 0.0), np.where(y_valid, y - means[1], 0.0)
        products += _lagged(*flat, lags)
        counts += _lagged(x_valid.astype(float), y_valid.astype(float), lags)
        full += np.maximum(x.size - reach, 0)
    # The biased (tapered) estimate: its Fourier transform is never negative, which the unbiased one
    # does not grant. Division by the pairs that were measured corrects for gaps only.
    taper = full / full[lags]
    return np.where(counts > 0.5, products / np.maximum(counts, 1.0), 0.0) * taper


def _lagged(x: np.ndarray, y: np.ndarray, lags: int) -> np.ndarray:
    """Sums over t of x[t + k] y[t] at k = -lags .. lags."""
    size = 2 ** (2 * x.size).bit_length()  # twice the length: a cyclic product would wrap around
    sums = np.fft.irfft(np.fft.rfft(x, size) * np.conj(np.fft.rfft(y, size)), size)
    reach = min(lags, x.size - 1)
    return np.pad(sums[np.arange(-reach, reach + 1)], lags - reach)
