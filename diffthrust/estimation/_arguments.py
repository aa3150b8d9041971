"""The arguments of a fit: their words, and checks before any work is done.

A new noise is a class in `_noise` or in a file of its own and its place in `NOISE_MODELS`; a new
law of errors a class in `_laws` and its place in `LOSSES`. Spec files, checks, the advice on noise
and the reference read the words here.
"""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest, short_repr
from diffthrust.estimation._laws import Censored, Gaussian, Law, StudentT, are_censored
from diffthrust.estimation._noise import AR1, NoiseModel, White
from diffthrust.estimation._residuals import Innovations, Likelihood, SimulationError
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._record import Record

STARTS_LIMIT = 1_000
"""More starts find nothing that these did not, and take hours."""
SUBSTEPS_LIMIT = 10_000
"""A model that needs finer steps is a stiff one: no fixed step is right for it."""
SEED_LIMIT = 2**64 - 1
"""As long as the integers of a spec file."""

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


def listed(logs: Any) -> tuple[Log, ...]:
    """One log or several as a tuple.

    Raises:
        InputError: something else than logs.
    """
    several = (logs,) if isinstance(logs, Log) else logs
    if not isinstance(several, Sequence) or not all(isinstance(log, Log) for log in several):
        raise InputError(
            f"Expected a Log or a sequence of them, found {type(logs).__name__}.",
            "Read a file with dft.read_log, or make a dft.Log.",
        )
    return tuple(several)


def by_input(what: str, values: Any, model: Model, example: str) -> dict[str, Any]:
    """What was given for the inputs of a model, by their names.

    Raises:
        InputError: something else than a dictionary.
    """
    if values is not None and not isinstance(values, Mapping):
        raise InputError(
            f"{what}: expected a dictionary by the names of inputs, found {values!r}.",
            f"Write {what}={{'{next(iter(model.inputs), 'input')}': {example}}}.",
        )
    return dict(values or {})


@dataclass(frozen=True)
class FitOptions:
    """The options of `fit`, which describes them."""

    starts: int = 8
    guesses: Sequence[Mapping[str, float]] = ()
    seed: int = 0
    horizon: float | Sequence[float | None] | Literal["auto"] | None = "auto"
    likelihood: str = "simulation"
    loss: str = "gaussian"
    noise_model: str = "white"
    initial: str = "auto"
    substeps: int | None = None
    doubts: bool = True


def check_arguments(model: Any, logs: Sequence[Log], options: FitOptions) -> None:
    """Raise `InputError` for an argument of `fit` or `diagnose` that cannot be meant.

    Only `check_guesses` needs the model in the units of its logs.
    """
    if not isinstance(model, Model):
        raise InputError(
            f"Expected a model, found {model!r}.", "Give an instance, such as dft.Thruster()."
        )
    for what, value, choices in (
        ("loss", options.loss, LOSSES),
        ("initial", options.initial, ("auto", "estimate", "measured")),
        ("likelihood", options.likelihood, LIKELIHOODS),
        ("noise_model", options.noise_model, NOISE_MODELS),
    ):
        if value not in choices:
            near = nearest(value, choices) if isinstance(value, str) else ""
            raise InputError(
                f"{what}: expected one of {', '.join(choices)}, found {value!r}"
                f"{f' ({near})' if near else ''}.",
                "Correct it.",
            )
    corrects = LIKELIHOODS[options.likelihood].corrects
    if corrects and options.noise_model != "white":
        raise InputError(
            f"noise_model: expected 'white' with the innovations form, found "
            f"{options.noise_model!r}: it has lasting sensor errors of its own.",
            "Leave noise_model out, or use likelihood='simulation'.",
        )
    if corrects and options.horizon is not None and options.horizon != "auto":
        raise InputError(  # every sample corrects the states: there is nothing to restart
            f"horizon: the innovations form goes through whole runs, found {options.horizon!r}.",
            "Leave the horizon out, or use likelihood='simulation'.",
        )
    _check_whole_numbers(options)
    if not logs:
        raise InputError("Expected at least one log to fit, found none.", "Give at least one log.")
    if all(p.fixed for p in model.parameters.values()):
        raise InputError(
            f"Every parameter of '{model}' is fixed: there is nothing to fit.",
            "Free at least one, or use compare.",
        )


def _check_whole_numbers(options: FitOptions) -> None:
    for what, value, least, most in (
        ("starts", options.starts, 1, STARTS_LIMIT),
        ("seed", options.seed, 0, SEED_LIMIT),
        ("substeps", options.substeps, 1, SUBSTEPS_LIMIT),
    ):
        if what == "substeps" and value is None:
            continue
        try:
            number = operator.index(value)  # pyright: ignore[reportArgumentType]
        except TypeError:
            number = -1
        if number < least:
            raise InputError(
                f"{what}: expected at least {least}, a whole number, found {short_repr(value)}.",
                "Correct it.",
            )
        if number > most:
            raise InputError(
                f"{what}: expected at most {most}, found {short_repr(value)}.", "Correct it."
            )


def check_guesses(model: Model, guesses: Any) -> None:
    """Raise `InputError` for guesses that are no values of the model's free parameters."""
    if not isinstance(guesses, Sequence) or not all(isinstance(g, Mapping) for g in guesses):
        raise InputError(
            f"guesses: expected a list of values by parameter, found {guesses!r}.",
            f"Write guesses=[{{'{next(iter(model.parameters), 'name')}': 1.0}}].",
        )
    named = model.parameters
    for values in guesses:
        absent = [n for n, value in values.items() if n in named and value == named[n].null]
        model.replace({n: value for n, value in values.items() if n not in absent})
        held = [n for n, value in values.items() if named[n].fixed and value != named[n].value]
        if held:
            raise InputError(
                f"guesses: {listing(held)} is fixed, but a guess gives another value.",
                "Free it, or leave it out of the guess.",
            )
