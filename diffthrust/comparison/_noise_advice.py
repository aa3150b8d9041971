"""Which law of noise suits the residuals of a comparison: white or lasting, with spikes or not."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from diffthrust.estimation._ar1 import RANGE, linked
from diffthrust.estimation._laws import TAIL

NOISE_CHOICES = (
    ("white", "gaussian"),
    ("white", "student_t"),
    ("ar1", "gaussian"),
    ("ar1", "student_t"),
)
_ROUNDS = 60
"""Rounds of reweighting for the level of a Student-t law."""


@dataclass(frozen=True)
class NoiseAdvice:
    """The noise that residuals look like, as arguments of `fit`.

    Residuals that last may be noise that lasts or a model that lacks something: the advice makes
    standard errors honest in the first case; in the second a diagnosis is wanted.

    Args:
        noise_model: "white" or "ar1".
        loss: "gaussian" or "student_t".
        bic: information criterion of each law, "white gaussian" and so on, less that of the best.
        correlation: correlation time [s] of each channel under "ar1".
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
        if (self.noise_model, self.loss) == NOISE_CHOICES[0]:
            return "The residuals look like white Gaussian noise, as a plain fit assumes."
        words, options = [], []
        if self.noise_model == "ar1":
            times = ", ".join(f"{name} {s:.2g} s" for name, s in self.correlation.items())
            words.append(f"last from sample to sample (correlation time: {times})")
            options.append("noise_model='ar1'")
        if self.loss == "student_t":
            words.append("have more large values than Gaussian noise")
            options.append("loss='student_t'")
        seen = f"The residuals {' and '.join(words)}: fit with {', '.join(options)}"
        if self.noise_model == "white":
            return f"{seen}."
        worst = max(self.widening.values())
        return (
            f"{seen}. Standard errors that assume white noise may be {worst:.2g} times too small. "
            "If the model lacks something, a diagnosis will say so."
        )

    def to_json(self) -> dict[str, Any]:
        """The advice as plain data."""
        return {**vars(self), "sentence": self.sentence}


def noise_advice(
    residuals: Mapping[str, Sequence[np.ndarray]], times: Mapping[str, Sequence[np.ndarray]]
) -> NoiseAdvice:
    """Weigh four laws of noise by the Bayesian information criterion.

    Args:
        residuals: by channel those of each run, ``(n,)``; NaN where nothing was measured.
        times: by channel the times of each run [s].

    Source: the laws are those of `fit`; the criterion is Schwarz 1978.
    """
    bic = {" ".join(law): 0.0 for law in NOISE_CHOICES}
    correlation, widening = {}, {}
    for name, runs in residuals.items():
        pairs = list(zip(runs, times[name], strict=True))
        samples = sum(int(np.isfinite(run).sum()) for run in runs)
        step = float(np.median(np.concatenate([np.diff(time) for time in times[name]])))
        for noise, loss in NOISE_CHOICES:
            cost, kept = _cost(pairs, noise, loss, step)
            bic[f"{noise} {loss}"] += 2 * cost + (noise == "ar1") * math.log(samples)
            if noise == "ar1":
                correlation[name] = -step / math.log(kept)
                widening[name] = math.sqrt((1 + kept) / (1 - kept))
    noise, loss = min(NOISE_CHOICES, key=lambda law: bic[" ".join(law)])
    least = bic[f"{noise} {loss}"]
    return NoiseAdvice(
        noise, loss, {law: value - least for law, value in bic.items()}, correlation, widening
    )


def _cost(pairs: Sequence[Any], noise: str, loss: str, step: float) -> tuple[float, float]:
    """Negative log-likelihood of one channel, and its correlation from one step to the next."""
    if noise == "white":
        rests = np.concatenate([run[np.isfinite(run)] for run, _ in pairs])
        return level_cost(rests, loss), 0.0
    from scipy.optimize import minimize_scalar  # slow to import

    links = [linked(time[None], run[None, None], np.zeros((1, run.size), bool), step)
             for run, time in pairs]  # fmt: skip

    def at(lag_one: float) -> float:
        news, jacobian = [], 0.0
        for (run, _), link in zip(pairs, links, strict=True):
            seen, kept = np.isfinite(run), lag_one ** link.gap[0, 0]
            scale = np.sqrt(1 - kept**2)
            new = (run - kept * np.nan_to_num(run)[link.past[0, 0]]) / scale
            news.append(new[seen])
            jacobian += float(np.sum(np.log(scale[seen])))
        return level_cost(np.concatenate(news), loss) + jacobian

    best = minimize_scalar(at, bounds=RANGE, method="bounded")
    return float(best.fun), float(best.x)


def level_cost(rests: np.ndarray, loss: str) -> float:
    """Negative log-likelihood at the best level of the noise, all constants included."""
    level = float(np.sqrt(np.mean(rests**2))) or 1e-300
    if loss == "gaussian":
        return rests.size * (math.log(level) + 0.5 * math.log(2 * math.pi) + 0.5)
    for _ in range(_ROUNDS):
        weights = (TAIL + 1) / (TAIL + (rests / level) ** 2)
        level = float(np.sqrt(np.mean(weights * rests**2))) or 1e-300
    constant = math.lgamma((TAIL + 1) / 2) - math.lgamma(TAIL / 2)
    constant -= 0.5 * math.log(TAIL * math.pi)
    tail = 0.5 * (TAIL + 1) * np.log1p(rests**2 / (TAIL * level**2)).sum()
    return float(tail) + rests.size * (math.log(level) - constant)
