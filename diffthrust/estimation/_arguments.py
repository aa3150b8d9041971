"""The arguments of a fit: their words, and checks before any work is done.

A new noise is a class in `_noise` or in a file of its own and its place in `NOISE_MODELS`; a new
law of errors a class in `_laws` and its place in `LOSSES`. Spec files, checks, the advice on noise
and the reference read the words here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest, short_repr
from diffthrust._support.validation import check_known, whole_number
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
WORDS = ("likelihood", "loss", "noise_model")
"""The arguments of a fit that name one of these."""


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


def listed(logs: Any, what: str = "logs") -> tuple[Log, ...]:
    """One log or several as a tuple; ``what`` names the argument.

    Raises:
        InputError: something else than logs.
    """
    several = (logs,) if isinstance(logs, Log) else logs
    if isinstance(several, Sequence) and not isinstance(several, str):
        strange = [entry for entry in several if not isinstance(entry, Log)]
        if not strange:
            return tuple(several)
        description = f"{_described(strange[0])} in a {type(several).__name__}"
    else:
        description = _described(several)
    raise InputError(
        f"{what}: expected a Log or a sequence of Logs, found {description}.",
        "Read files with dft.read_log, tables with dft.Log.from_dataframe.",
    )


def _described(value: Any) -> str:
    """What was found in place of an object, in a few characters: a table has no short `repr`."""
    kind = type(value).__name__
    if isinstance(value, type):
        return f"the class {value.__name__}"
    return f"{short_repr(value)} ({kind})" if isinstance(value, str | int | float) else kind


def training_and_unseen(logs: Any, holdout: Any) -> tuple[tuple[Log, ...], tuple[Log, ...]]:
    """The arguments ``logs`` and ``holdout`` as tuples.

    Raises:
        InputError: something else than logs, or a log that is in both.
    """
    train = listed(logs)
    unseen = listed(holdout, "holdout") if holdout is not None else ()
    contents = {log.sha256 for log in train} if unseen else set()
    both = [log.name for log in unseen if log.sha256 in contents]
    if both:
        raise InputError(
            f"holdout: {listing(both)} is also a training log; an unseen log must not be one.",
            "Take it out of logs, or leave holdout out.",
        )
    return train, unseen


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


def check_arguments(
    model: Any, logs: Sequence[Log], options: FitOptions, per_log: Sequence[str] | None = None
) -> None:
    """Raise `InputError` for an argument of `fit` or `diagnose` that cannot be meant.

    Only `check_guesses` needs the model in the units of its logs. ``per_log`` is the argument of
    `fit`: the model may be marked without it.
    """
    if not isinstance(model, Model):
        is_class = isinstance(model, type) and issubclass(model, Model)
        raise InputError(
            f"Expected a model, found {_described(model)}.",
            f"Give an instance, such as {model.__name__ if is_class else 'dft.Thruster'}().",
        )
    for what, value, choices in (
        ("loss", options.loss, LOSSES),
        ("initial", options.initial, ("auto", "estimate", "measured")),
        ("likelihood", options.likelihood, LIKELIHOODS),
        ("noise_model", options.noise_model, NOISE_MODELS),
    ):
        if not isinstance(value, str) or value not in choices:
            near = nearest(value, choices) if isinstance(value, str) else ""
            raise InputError(
                f"{what}: expected one of {', '.join(choices)}, found {short_repr(value)}"
                f"{f' ({near})' if near else ''}.",
                f"Write {what}='{next(iter(choices))}', or one of the others.",
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
    whole_number("starts", options.starts, 1, STARTS_LIMIT, "Write starts=8, or leave it out.")
    whole_number("seed", options.seed, 0, SEED_LIMIT, "Write seed=0, or leave it out.")
    if options.substeps is not None:
        mend = "Leave it out: the fit chooses it."
        whole_number("substeps", options.substeps, 1, SUBSTEPS_LIMIT, mend)
    check_switch("doubts", options.doubts)
    if not logs:
        raise InputError("logs: expected at least one log to fit, found none.", "Give one.")
    if model.per_log and len(logs) < 2:
        marks = {name: {"per_log": False} for name in model.per_log}
        unmarked = "leave per_log out" if per_log else f"write model.replace({marks})"
        raise InputError(
            f"per_log: {listing(model.per_log)} is to differ from log to log, and there is one log "
            "to fit: nothing tells by how much.",
            f"Give more logs, or {unmarked}: the value is then that of this log.",
        )
    if all(p.fixed for p in model.parameters.values()) and not model.per_log:
        raise InputError(
            f"Every parameter of '{model}' is fixed: there is nothing to fit.",
            "Free at least one, or use compare.",
        )


def differing_by_log(model: Any, names: Any) -> Any:
    """The model with some parameters marked that differ from log to log; None marks none.

    Raises:
        InputError: something else than a list of names, or a name that the model does not have.
    """
    if names is None:
        return model
    if isinstance(names, str) or not isinstance(names, Sequence):
        raise InputError(
            f"per_log: expected a list of names of parameters, found {short_repr(names)}.",
            "Write per_log=['water_current.to_north'].",
        )
    if not names or not isinstance(model, Model):
        return model
    named = model.parameters
    for name in names:
        check_known(
            name,
            named,
            f"per_log: '{model}' has no parameter",
            mend="Correct the name, or add the effect that has it.",
        )
    return model.replace({name: {"per_log": True} for name in names})


def check_switch(what: str, value: Any) -> None:
    """Raise `InputError` unless a value is True or False: the text "no" would count as True."""
    if not isinstance(value, bool | int | np.bool_):
        raise InputError(
            f"{what}: expected True or False, found {short_repr(value)}.", f"Write {what}=False."
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
        for name in values:
            check_known(name, named, f"guesses: '{model}' has no parameter")
        absent = [n for n, value in values.items() if value == named[n].null]
        model.replace({n: value for n, value in values.items() if n not in absent})
        held = [n for n, value in values.items() if named[n].fixed and value != named[n].value]
        if held:
            raise InputError(
                f"guesses: {listing(held)} is fixed, but a guess gives another value.",
                "Free it, or leave it out of the guess.",
            )
