"""Checks of what a caller gives to a fit or a diagnosis, before any work is done."""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest, shortly
from diffthrust.estimation._limits import SEED_LIMIT, STARTS_LIMIT, SUBSTEPS_LIMIT
from diffthrust.estimation._registry import LIKELIHOODS, LOSSES, NOISE_MODELS
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._commands import adopted
from diffthrust.simulation._inputs import check_samples, inputs_of


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


def by_input(what: str, given: Any, model: Model, example: str) -> dict[str, Any]:
    """What was given for the inputs of a model, by their names.

    Raises:
        InputError: something else than a dictionary.
    """
    if given is not None and not isinstance(given, Mapping):
        raise InputError(
            f"{what}: expected a dictionary by the names of inputs, found {given!r}.",
            f"Write {what}={{'{next(iter(model.inputs), 'input')}': {example}}}.",
        )
    return dict(given or {})


def check_arguments(
    model: Any,
    logs: Sequence[Log],
    unseen: Sequence[Log],
    *,
    seed: Any,
    starts: Any = 1,
    substeps: Any = None,
    loss: str = "gaussian",
    initial: str = "auto",
    likelihood: str = "simulation",
    noise_model: str = "white",
    horizon: Any = None,
    guesses: Any = (),
) -> None:
    """Raise `InputError` for an argument of `fit` or `diagnose` that cannot be meant."""
    if not isinstance(model, Model):
        raise InputError(
            f"Expected a model, found {model!r}.", "Give an instance, such as dft.Thruster()."
        )
    for what, value, known in (
        ("loss", loss, LOSSES),
        ("initial", initial, ("auto", "estimate", "measured")),
        ("likelihood", likelihood, LIKELIHOODS),
        ("noise_model", noise_model, NOISE_MODELS),
    ):
        if value not in known:
            near = nearest(value, known) if isinstance(value, str) else ""
            raise InputError(
                f"{what}: expected one of {', '.join(known)}, found {value!r}"
                f"{f' ({near})' if near else ''}.",
                "Correct it.",
            )
    corrects = LIKELIHOODS[likelihood].corrects
    if corrects and noise_model != "white":
        raise InputError(
            f"noise_model: expected 'white' with the innovations form, found {noise_model!r}: it "
            "has lasting sensor errors of its own.",
            "Leave noise_model out, or use likelihood='simulation'.",
        )
    if corrects and horizon is not None and horizon != "auto":
        raise InputError(  # every sample sets the states right: there is nothing else to set
            f"horizon: the innovations form goes through whole runs, found {horizon!r}.",
            "Leave the horizon out, or use likelihood='simulation'.",
        )
    for what, value, least, most in (
        ("starts", starts, 1, STARTS_LIMIT),
        ("seed", seed, 0, SEED_LIMIT),
        ("substeps", substeps, 1, SUBSTEPS_LIMIT),
    ):
        if what == "substeps" and value is None:
            continue
        try:
            number = operator.index(value)
        except TypeError:
            number = -1
        if number < least:
            raise InputError(
                f"{what}: expected at least {least}, a whole number, found {shortly(value)}.",
                "Correct it.",
            )
        if number > most:
            raise InputError(
                f"{what}: expected at most {most}, found {shortly(value)}.", "Correct it."
            )
    check_samples(model, (*logs, *unseen))
    _check_guesses(adopted(model, logs), guesses)
    for log in unseen:  # before the work, not after it
        inputs_of(adopted(model, logs), log)
    if not logs:
        raise InputError("Expected at least one log to fit, found none.", "Give at least one log.")
    if all(p.fixed for p in model.parameters.values()):
        raise InputError(
            f"Every parameter of '{model}' is fixed: there is nothing to fit.",
            "Free at least one, or use compare.",
        )


def _check_guesses(model: Model, guesses: Any) -> None:
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
