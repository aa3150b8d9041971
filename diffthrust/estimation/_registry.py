"""The words of `fit` for likelihoods, noises and laws of errors.

A new noise is a class in a file of its own and its place in `NOISE_MODELS`; a new law of errors a
class in `_laws` and its place in `LOSSES`. Spec files, checks of arguments, the advice on noise and
the reference read the words here.
"""

from __future__ import annotations

from collections.abc import Sequence

from diffthrust.estimation._censored import Censored, are_censored
from diffthrust.estimation._laws import Gaussian, Law, StudentT
from diffthrust.estimation._noise import AR1, NoiseModel, White
from diffthrust.estimation._residuals import Innovations, Likelihood, SimulationError
from diffthrust.models._base.model import Model
from diffthrust.simulation._record import Record

LIKELIHOODS: dict[str, type[Likelihood]] = {
    kind.word: kind for kind in (SimulationError, Innovations)
}
NOISE_MODELS: dict[str, NoiseModel] = {noise.word: noise for noise in (White(), AR1())}
LOSSES: dict[str, Law] = {law.word: law for law in (Gaussian(), StudentT())}


def likelihood_of(
    model: Model, records: Sequence[Record], *, likelihood: str, noise_model: str, loss: str
) -> Likelihood:
    """The likelihood that the words of a fit mean, for a model and its records.

    Raises:
        InputError: logs that it cannot be made for.
    """
    kind, noise, law = LIKELIHOODS[likelihood], NOISE_MODELS[noise_model], LOSSES[loss]
    if law.closed and not kind.corrects and not noise.lasts and are_censored(records):
        law = Censored()
    return kind.of(model, records, noise, law)
