"""Is the residual noise? Its correlation in time, and with what drives the model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import NormalDist
from typing import Any

import numpy as np

from diffthrust._support.correlation import autocorrelation, covariance, integral, ljung_box
from diffthrust._support.results import Brief

_LEVEL = 0.05
_NORMAL = NormalDist()


@dataclass(frozen=True, eq=False, repr=False)
class CrossCorrelation(Brief):
    """Correlation of a residual with one signal over lags.

    Args:
        signal: name of the signal.
        lags: ``(2 K + 1,)`` [s]; positive where the residual follows the signal.
        values: correlation at each lag, ``(2 K + 1,)``.
        band: a residual without relation to the signal stays within plus or minus this at 95 % of
            the lags; the correlation of both in time is accounted for.
        p_value: of the largest value, over all lags and signals of the channel.
    """

    signal: str
    lags: np.ndarray = field(repr=False)
    values: np.ndarray = field(repr=False)
    band: float
    p_value: float

    @property
    def peak(self) -> float:
        """The value of largest size."""
        return float(self.values[np.abs(self.values).argmax()])

    @property
    def lag(self) -> float:
        """Its lag [s]."""
        return float(self.lags[np.abs(self.values).argmax()])

    @property
    def related(self) -> bool:
        """Whether the residual is related to the signal, beyond what chance gives in 5 %."""
        return self.p_value <= _LEVEL

    def to_json(self) -> dict[str, Any]:
        """The peak with its band, as plain data."""
        return {name: getattr(self, name) for name in ("peak", "lag", "band", "p_value")}


@dataclass(frozen=True, eq=False, repr=False)
class ResidualTests(Brief):
    """Tests of the residual of one channel, pooled over runs.

    Args:
        channel: name of the measured channel.
        unit: its unit.
        samples: number of measured samples.
        mean: of the residual; ``mean_error`` is its standard deviation, with the correlation in
            time accounted for.
        lag_one: correlation from one sample to the next.
        correlation_time: integral of the autocorrelation over both sides [s].
        effective_samples: number of independent samples that would tell as much about the mean.
        whiteness: p-value of Ljung & Box 1978 over ``lags`` lags; small where the residual is not
            white.
        autocorrelation: at lags 0, 1, ..., ``(K + 1,)``; ``step`` [s] apart.
        signals: correlation with each signal.
    """

    channel: str
    unit: str
    samples: int
    mean: float
    mean_error: float
    lag_one: float
    correlation_time: float
    effective_samples: float
    whiteness: float
    step: float
    autocorrelation: np.ndarray = field(repr=False)
    signals: Mapping[str, CrossCorrelation]

    @property
    def white(self) -> bool:
        """Whether the residual may be white noise."""
        return self.whiteness > _LEVEL

    @property
    def sentence(self) -> str:
        """The tests in plain words."""
        return self.words("something is missing")

    def words(self, meaning: str) -> str:
        """The tests in plain words.

        Args:
            meaning: what it means that an error lasts.
        """
        if self.white:
            words = f"{self.channel}: the residual may be white noise"
        else:
            words = (
                f"{self.channel}: the error persists for {self.correlation_time:.2g} s: {meaning}"
                if self.effective_samples < 0.9 * self.samples
                else f"{self.channel}: the residual is slightly correlated "
                f"({self.lag_one:+.2f} from sample to sample)"
            )
        if abs(self.mean) > 3 * self.mean_error:
            side = "above" if self.mean > 0 else "below"
            words += (
                f"; on average the measurement lies {abs(self.mean):.2g} {self.unit} {side} the "
                f"model (+-{2 * self.mean_error:.1g})"
            )
        related = [s for s in self.signals.values() if s.related]
        if not related:
            return f"{words}."
        most = max(related, key=lambda s: abs(s.peak) / s.band)
        when = f"{most.lag:.2g} s before" if most.lag > 0 else f"{-most.lag:.2g} s later"
        return (
            f"{words}, and it is related to {most.signal}{'' if most.lag == 0 else ' ' + when} "
            f"(correlation {most.peak:+.2f}, band +-{most.band:.2f})."
        )

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        written = {n: v for n, v in vars(self).items() if n not in ("step", "autocorrelation")}
        return {**written, "signals": {name: s.to_json() for name, s in self.signals.items()}}


def residual_tests(
    channel: str,
    residuals: Sequence[np.ndarray],
    signals: Sequence[Mapping[str, np.ndarray]],
    *,
    step: float,
    unit: str = "",
) -> ResidualTests | None:
    """Test the residual of one channel against whiteness and against the signals.

    Args:
        channel: name of the channel.
        residuals: measured minus modelled of each run, ``(n,)``; NaN where nothing was measured.
        signals: the signals of each run by name, ``(n,)`` each; those that all runs have are used.
        step: time between samples [s].
        unit: of the residual.

    Returns:
        The tests; ``None`` where the residual is constant, not finite, or has less than 10 samples.

    Example:
        >>> residual_tests("speed", [rest], [{"command": u}], step=0.04).white
        False
    """
    pooled = np.concatenate([residual[~np.isnan(residual)] for residual in residuals])
    if pooled.size < 10 or not np.all(np.isfinite(pooled)) or not np.ptp(pooled) > 0:
        return None
    longest = max(residual.size for residual in residuals)
    ours = autocorrelation(residuals, longest // 2)
    inflation = integral(ours)
    # correlated samples count as fewer: the variance of the mean grows by the sum of the
    # autocorrelation
    effective = pooled.size / inflation
    lags = max(1, min(20, ours.size - 1, pooled.size // 5))
    reach = int(np.clip(math.ceil(3 * inflation), 10, max(10, longest // 4)))
    common = [name for name in signals[0] if all(name in s for s in signals)]
    crossed = {
        name: cross_correlation(name, residuals, [s[name] for s in signals], reach, step, ours)
        for name in common
        if np.ptp(np.concatenate([s[name] for s in signals])) > 0
    }
    several = {
        name: replace(c, p_value=min(1.0, c.p_value * len(crossed))) for name, c in crossed.items()
    }
    return ResidualTests(
        channel=channel,
        unit=unit,
        samples=pooled.size,
        mean=float(pooled.mean()),
        mean_error=float(pooled.std() / math.sqrt(effective)),
        lag_one=float(ours[1]),
        correlation_time=inflation * step,
        effective_samples=effective,
        whiteness=ljung_box(ours[1 : lags + 1], pooled.size),
        step=step,
        autocorrelation=ours,
        signals=several,
    )


def cross_correlation(
    name: str,
    residuals: Sequence[np.ndarray],
    signals: Sequence[np.ndarray],
    lags: int,
    step: float,
    ours: np.ndarray | None = None,
) -> CrossCorrelation:
    """Correlation of residuals with a signal over lags, with the band of Bartlett 1955.

    Two unrelated series of ``n`` samples with autocorrelations a and b have a cross-correlation of
    variance sum_k a_k b_k / n, which is 1 / n only where one of them is white.

    Args:
        name: of the signal.
        residuals: of each run, ``(n,)``, NaN where nothing was measured.
        signals: of each run, ``(n,)``.
        lags: the longest lag, in samples.
        step: time between samples [s].
        ours: autocorrelation of the residuals, where it is known already.
    """
    longest = max(residual.size for residual in residuals)
    ours = autocorrelation(residuals, longest // 2) if ours is None else ours
    theirs = autocorrelation(signals, ours.size - 1)
    inflation = max(1.0, float(2 * np.sum(ours * theirs) - 1))
    samples = sum(int(np.isfinite(residual).sum()) for residual in residuals)
    error = math.sqrt(inflation / samples)
    norm = math.sqrt(covariance(residuals, residuals, 0)[0] * covariance(signals, signals, 0)[0])
    values = covariance(residuals, signals, lags) / norm
    # neighbouring lags are correlated: of 2 K + 1 lags only one in ``inflation`` is another trial
    trials = 1 + 2 * lags / inflation
    p = min(1.0, trials * 2 * _NORMAL.cdf(-float(np.abs(values).max()) / error))
    band = -_NORMAL.inv_cdf(_LEVEL / 2) * error
    return CrossCorrelation(name, np.arange(-lags, lags + 1) * step, values, band, p)
