"""Is the residual noise, and of which law? Its correlation in time, and with the model's drives."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from statistics import NormalDist
from typing import Any

import numpy as np

from diffthrust._support.correlation import autocorrelation, covariance, integral, ljung_box
from diffthrust._support.results import Brief
from diffthrust.estimation._arguments import LOSSES, NOISE_MODELS

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
        """The tests in plain words, with what it means that an error lasts."""
        if self.white:
            words = "the residual may be white noise"
        elif self.effective_samples < 0.9 * self.samples:
            words = f"the error persists for {self.correlation_time:.2g} s: {meaning}"
        else:
            from_sample = f"{self.lag_one:+.2f} from sample to sample"
            words = f"the residual is slightly correlated ({from_sample})"
        if abs(self.mean) > 3 * self.mean_error:
            side = "above" if self.mean > 0 else "below"
            words += (
                f"; on average the measurement lies {abs(self.mean):.2g} {self.unit} {side} the "
                f"model (+-{2 * self.mean_error:.1g})"
            )
        related = [s for s in self.signals.values() if s.related]
        if related:
            most = max(related, key=lambda s: abs(s.peak) / s.band)
            when = f" {abs(most.lag):.2g} s {'before' if most.lag > 0 else 'later'}"
            words += (
                f", and it is related to {most.signal}{when if most.lag else ''} "
                f"(correlation {most.peak:+.2f}, band +-{most.band:.2f})"
            )
        return f"{self.channel}: {words}."

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

    Residuals are measured minus modelled of each run, ``(n,)``, NaN where nothing was measured; of
    the signals, a ``step`` [s] apart, those that all runs have are used. ``None`` where the
    residual is constant, not finite, or has less than 10 samples.
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
    series = {name: [s[name] for s in signals] for name in common}
    crossed = {
        name: cross_correlation(name, residuals, values, reach, step, ours)
        for name, values in series.items()
        if np.ptp(np.concatenate(values)) > 0
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
    variance sum_k a_k b_k / n, which is 1 / n only where one of them is white. ``lags`` counts
    samples, which are a ``step`` [s] apart; ``ours`` is the autocorrelation of the residuals.
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


@dataclass(frozen=True)
class NoiseAdvice:
    """The noise that residuals look like, as arguments of `fit`.

    Residuals that last may be noise that lasts or a model that lacks something: the advice makes
    standard errors honest in the first case; in the second a diagnosis is wanted.

    Args:
        noise_model: a word of `fit`, such as "white" or "ar1".
        loss: a word of `fit`, such as "gaussian" or "student_t".
        bic: information criterion of each pair, "white gaussian" and so on, less that of the best.
        correlation: correlation time [s] of each channel under noise that lasts ("ar1").
        widening: by how much the error of a slowly varying quantity is larger than under white
            noise, by channel: the root of (1 + phi) / (1 - phi).

    Example:
        >>> advice = dft.compare(fit, unseen).noise_advice
        >>> advice.sentence
        'The residuals look like white Gaussian noise, as a plain fit assumes.'
        >>> list(advice.to_json())[:2]
        ['noise_model', 'loss']
    """

    noise_model: str
    loss: str
    bic: Mapping[str, float]
    correlation: Mapping[str, float]
    widening: Mapping[str, float]

    @property
    def sentence(self) -> str:
        """The advice in words."""
        noise, law = NOISE_MODELS[self.noise_model], LOSSES[self.loss]
        if not noise.lasts and law.closed:
            return "The residuals look like white Gaussian noise, as a plain fit assumes."
        words, options = [], []
        if noise.lasts:
            times = ", ".join(f"{name} {s:.2g} s" for name, s in self.correlation.items())
            words.append(f"last from sample to sample (correlation time: {times})")
            options.append(f"noise_model='{self.noise_model}'")
        if not law.closed:
            words.append(law.shows)
            options.append(f"loss='{self.loss}'")
        advice = f"The residuals {' and '.join(words)}: fit with {', '.join(options)}"
        if not noise.lasts:
            return f"{advice}."
        worst = max(self.widening.values())
        return (
            f"{advice}. Standard errors that assume white noise may be {worst:.2g} times too "
            "small. If the model lacks something, a diagnosis will say so."
        )

    def to_json(self) -> dict[str, Any]:
        """The advice as plain data."""
        return {**vars(self), "sentence": self.sentence}


def noise_advice(
    residuals: Mapping[str, Sequence[np.ndarray]], times: Mapping[str, Sequence[np.ndarray]]
) -> NoiseAdvice:
    """Weigh pairs of a noise and a law of errors by the Bayesian information criterion.

    Residuals and times of each run are by channel, ``(n,)``; NaN where nothing was measured.

    Source: noises and laws are those of `fit`; the criterion is Schwarz 1978.
    """
    bic: dict[tuple[str, str], float] = {}
    lag_ones: dict[str, dict[str, float]] = {}
    steps = {n: float(np.median(np.concatenate(list(map(np.diff, t))))) for n, t in times.items()}
    for (noise_word, noise), (loss, law) in product(NOISE_MODELS.items(), LOSSES.items()):
        total = 0.0
        for name, runs in residuals.items():
            likeliest = noise.likeliest(runs, times[name], law, steps[name])
            if likeliest is None:
                break
            samples = sum(int(np.isfinite(run).sum()) for run in runs)
            free = sum(not p.fixed for p in noise.parameters([name]).values())
            total += 2 * likeliest.cost + free * math.log(samples)
            if noise.lasts:
                lag_ones.setdefault(noise_word, {})[name] = likeliest.lag_one
        else:
            bic[noise_word, loss] = total
    noise_model, loss = min(bic, key=lambda pair: bic[pair])
    least = bic[noise_model, loss]
    # where white noise suits better, the first that lasts says how much correlation there is
    lag_one = lag_ones.get(noise_model) or next(iter(lag_ones.values()), {})
    return NoiseAdvice(
        noise_model,
        loss,
        {" ".join(pair): value - least for pair, value in bic.items()},
        {name: -steps[name] / math.log(kept) for name, kept in lag_one.items()},
        {name: math.sqrt((1 + kept) / (1 - kept)) for name, kept in lag_one.items()},
    )
