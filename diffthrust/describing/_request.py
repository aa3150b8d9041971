"""What a describing function is asked for, checked before the work."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest
from diffthrust._support.validation import finite, finite_row, whole_number
from diffthrust.estimation._result import Fit
from diffthrust.logs._units import CHANNEL_UNITS
from diffthrust.models._base.model import Model
from diffthrust.simulation._trajectory import bare

FORMULAS = ("paper", "consistent")
"""Of the plain thruster, in closed form."""
_METHODS = ("simulation", "harmonic_balance", *FORMULAS)
_WHERE = "describing_function"


@dataclass(frozen=True)
class MapRequest:
    """A describing function to be worked out: arguments of `describing_function`, checked."""

    model: Model  # without the effects on what its sensors report unless these count
    amplitudes: np.ndarray
    frequencies: np.ndarray
    input: str
    output: str
    method: str
    harmonics: int
    samples: int | None
    bias: float
    others: Mapping[str, float]
    states: tuple[str, ...]  # those that are integrated

    @property
    def path(self) -> dict[str, Any]:
        """What every result says of the path from input to output, by its name there."""
        units = _inputs(self.model)[self.input], self.model.outputs[self.output]
        names = ("method", "input", "output", "amplitudes", "frequencies")
        named = {name: getattr(self, name) for name in names}
        return {**named, "input_unit": units[0], "output_unit": units[1]}


def _inputs(model: Model) -> dict[str, str]:
    """Every channel that can be given to a model and its effects, with its unit."""
    channels = {**model.inputs, **model.optional_inputs}
    needed = [name for effect in model.effects for name in effect.needs if name not in channels]
    return channels | {n: CHANNEL_UNITS.get(n, "") for n in needed}


def request(
    model: Any,
    amplitudes: Any,
    frequencies: Any,
    *,
    input: str,
    output: str,
    method: str,
    harmonics: Any,
    samples: Any,
    bias: Any,
    others: Any,
    sensors: bool,
) -> MapRequest:
    """The arguments of `describing_function`, checked."""
    model = model.model if isinstance(model, Fit) else model
    if not isinstance(model, Model):
        raise InputError(
            f"{_WHERE}: expected a model or a fit, found {model!r}.",
            "Give an instance, such as dft.Thruster().",
        )
    if not sensors:
        model = bare(model)
    channels = _inputs(model)
    choices = {"input": (input, channels), "output": (output, model.outputs)}
    for what, (name, names) in {**choices, "method": (method, _METHODS)}.items():
        if name not in names:
            near = nearest(name, names) if isinstance(name, str) else ""
            raise InputError(
                f"{_WHERE}: {what}: expected one of {listing(names)}, found {name!r}"
                f"{f' ({near})' if near else ''}.",
                f"Correct the {what}.",
            )
    constant = _constants(model, input, others, channels)
    swing = {input, *constant}
    states = tuple(n for n in model.all_states if n not in swing)
    asked = MapRequest(
        model=model,
        amplitudes=_points("amplitudes", amplitudes),
        frequencies=_points("frequencies", frequencies),
        input=input,
        output=output,
        method=method,
        harmonics=whole_number(f"{_WHERE}: harmonics", harmonics),
        samples=None if samples is None else whole_number(f"{_WHERE}: samples", samples, 16),
        bias=_number("bias", bias),
        others=constant,
        states=states,
    )
    if method == "harmonic_balance" and asked.samples and asked.samples < 2 * asked.harmonics:
        raise InputError(
            f"{_WHERE}: samples: {asked.harmonics} harmonics need at least {2 * asked.harmonics} "
            f"steps to the period, found {asked.samples}.",
            "Give more samples, or leave them out.",
        )
    if method in FORMULAS:
        check_plain(method, model, input, output, asked.bias)
    return asked


def _points(what: str, values: Any) -> np.ndarray:
    """Positive and increasing numbers as an array."""
    row = finite_row(values)
    if row is None:
        raise InputError(
            f"{_WHERE}: {what}: expected finite numbers in one row, found {values!r}.",
            f"Write {what}=np.geomspace(0.1, 10, 32).",
        )
    if np.any(row <= 0):
        raise InputError(
            f"{_WHERE}: {what}: expected positive numbers, found {row[row <= 0][0]:g}.",
            "A sinusoid has a positive amplitude and frequency; give a level as bias.",
        )
    if np.any(np.diff(row) <= 0):
        raise InputError(
            f"{_WHERE}: {what}: expected increasing numbers, each once, found {values!r}.",
            f"Sort them: np.unique({what}).",
        )
    return row


def _constants(
    model: Model, input: str, others: Any, channels: Mapping[str, str]
) -> dict[str, float]:
    if others is not None and not isinstance(others, Mapping):
        raise InputError(
            f"{_WHERE}: others: expected a dictionary by the names of inputs, found {others!r}.",
            "Write others={'supply_voltage': 24.0}.",
        )
    constants = {str(name): _number(f"others: {name}", v) for name, v in (others or {}).items()}
    unknown = [name for name in constants if name not in channels]
    if unknown or input in constants:
        raise InputError(
            f"{_WHERE}: others: '{model}' has no further input {listing(unknown or [input])}; "
            f"it has {listing(n for n in channels if n != input)}.",
            "Correct the names under others.",
        )
    # a state that is given drives the output itself: the inputs before it need no value
    prescribed = [n for n in (input, *constants) if n in model.states]
    wanted = [] if prescribed else list(model.inputs)
    wanted += [n for e in model.effects for n in e.needs]
    missing = [n for n in wanted if n != input and n not in constants]
    if missing:
        raise InputError(
            f"{_WHERE}: '{model}' also reads {listing(dict.fromkeys(missing))}, "
            "which has no value.",
            f"Give a constant one: others={{'{missing[0]}': ...}}.",
        )
    return constants


def _number(what: str, value: Any) -> float:
    return finite(f"{_WHERE}: {what}", value, lambda number: True, "a finite number")


def check_plain(method: str, model: Model, input: str, output: str, bias: float) -> None:
    """Raise `InputError` for a model, or a way to look at it, that the formulas do not cover."""
    beyond: list[str] = []
    if model.quadratic_load is None:
        beyond.append(f"the model '{model.name}'")
    elif model.effects:
        named = ", ".join(f"'{e.name}'" for e in model.effects)
        beyond.append(f"the effects {named}")
    if input != "command" or output not in ("thrust", "speed"):
        beyond.append(f"the path from {input!r} to {output!r}")
    if bias != 0:
        beyond.append(f"a bias of {bias:g}")
    if beyond:
        raise InputError(
            f"describing_function: the formula '{method}' is that of the plain thruster, from "
            f"'command' to 'thrust' or 'speed' about zero; it does not cover {', '.join(beyond)}.",
            "Use method='simulation' or method='harmonic_balance'.",
        )
