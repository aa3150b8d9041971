"""Criteria for black-box models: BIC and autocorrelation of residuals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diffthrust.blackbox._records import SampledLog
from diffthrust.blackbox._system import System

_LAGS = 25
WHITENESS_LEVEL = 0.001
"""Probability of taking white residuals for correlated ones."""


def samples_of(records: Sequence[SampledLog]) -> int:
    """Number of measured outputs."""
    return int(sum(np.isfinite(record.y).sum() for record in records))


def prediction_errors(system: System, records: Sequence[SampledLog]) -> list[np.ndarray]:
    """Measured minus predicted by record, ``(n, p)``; NaN where a sample is missing."""
    return [record.y - system.predict(record.u, record.y) for record in records]


def bic_of(system: System, records: Sequence[SampledLog], size: int) -> tuple[float, np.ndarray]:
    """The Bayesian information criterion of the one-step errors, and their standard deviations.

    Source: Schwarz 1978, with the Gaussian likelihood of white errors. All models are rated on the
    same samples, each from its best starting states, which count as parameters of each record.
    """
    e = np.concatenate(prediction_errors(system, records))
    if np.isinf(e).any():
        return np.inf, np.full(e.shape[1], np.inf)
    e = e[np.isfinite(e).all(axis=1)]
    spread = e.T @ e / len(e)
    # noise-free logs leave rounding only: the logarithm stays finite, and more orders gain nothing
    # there
    floor = 1e-26 * np.mean(np.concatenate([r.y[r.complete] for r in records]) ** 2)
    _, logarithm = np.linalg.slogdet(spread + floor * np.eye(len(spread)))
    free = size + len(records) * system.order
    # count all measurements: a model with a longer delay does not predict the first samples
    samples = sum(int(record.complete.sum()) for record in records)
    degrees = max(1.0, samples - free / len(spread))
    return (
        float(samples * logarithm + free * np.log(samples)),
        np.sqrt(np.diag(spread) * samples / degrees),
    )


def memory_of(residuals: Sequence[np.ndarray], used: int) -> tuple[float, float]:
    """The correlation at one step, and its probability if residuals were white.

    Source: Ljung & Box 1978, pooled over stretches, with ``used`` coefficients taken off.
    """
    from scipy.stats import chi2  # takes a while

    pooled = np.concatenate(residuals)
    power = float(pooled @ pooled)
    # the chi-square law holds for many more samples than lags
    if pooled.size < 4 * _LAGS or not power > 0:
        return np.nan, np.nan
    lags = np.arange(1, _LAGS + 1)
    rho = [sum(float(e[k:] @ e[:-k]) for e in residuals if e.size > k) / power for k in lags]
    statistic = pooled.size * (pooled.size + 2) * np.sum(np.square(rho) / (pooled.size - lags))
    return rho[0], float(chi2.sf(statistic, max(1, _LAGS - used)))


def memory_note(memory: tuple[float, float], allowed_for: bool) -> tuple[str, ...]:
    """A note if residuals are not white."""
    if not memory[1] < WHITENESS_LEVEL:
        return ()
    means = "standard errors hold for white ones only."
    if allowed_for:
        means = "standard errors allow for that if the noise knows nothing of the input."
    return (
        f"The residuals last from sample to sample (correlation {memory[0]:.2f} at one step, "
        f"Ljung-Box p < {WHITENESS_LEVEL}): {means}",
    )
