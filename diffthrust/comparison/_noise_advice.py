"""Which noise and law of errors of `fit` suit the residuals of a comparison."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from diffthrust.estimation._arguments import LOSSES, NOISE_MODELS


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
