"""Checks that the parts of a loop fit together, before anything is run."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest
from diffthrust._support.validation import finite
from diffthrust.control._base import Block, Controller
from diffthrust.control._compensators import Compensator
from diffthrust.control._plant import Plant


def check_numbers(plant: Plant, rate: Any, delay: Any, noise: Any) -> None:
    """Raise `InputError` for a plant, a rate, a delay or a noise that cannot be meant."""
    plant.check()
    finite("Loop, rate", rate, lambda x: x > 0, "samples in a second, above zero")
    finite("Loop, delay", delay, lambda x: x >= 0, "seconds, zero or more")
    check_noise("Loop", noise, plant.channels)


def check_noise(who: str, noise: Any, channels: Collection[str]) -> None:
    """Raise `InputError` for standard deviations that cannot be meant."""
    example = f'{{"{next(iter(channels))}": 0.3}}'
    for name, level in mapping(f"{who}, noise", noise, example, channels).items():
        finite(f"{who}, noise of '{name}'", level, lambda x: x >= 0, "zero or more")


def mapping(
    what: str,
    values: Any,
    example: str,
    names: Collection[str] | None = None,
    kind: str = "channel",
) -> Mapping[str, Any]:
    """What was given by the names of channels, or of another kind."""
    if not isinstance(values, Mapping):
        raise InputError(
            f"{what}: expected a dictionary by the names of {kind}s, found {values!r}.",
            f"Write {example}.",
        )
    for name in values:
        if names is not None and name not in names:
            near = nearest(str(name), names)
            raise InputError(
                f"{what}: there is no {kind} '{name}'{f' ({near})' if near else ''}; there are "
                f"{listing(names)}.",
                "Correct the name.",
            )
    return values


def seeded(seed: Any) -> np.random.Generator:
    """The generator of the measurement noise."""
    # True is an integer to Python, and never meant as a seed
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(
            f"seed: expected a whole number, 0 or more, found {seed!r}.", "Write seed=0."
        )
    return np.random.default_rng(seed)


def check_blocks(plant: Plant, controller: Any, compensator: Any) -> None:
    """Raise `InputError` for blocks that do not fit each other or the plant."""
    if not isinstance(controller, Controller):
        raise InputError(
            f"Loop: expected a controller, found {controller!r}.",
            "Give an instance, such as dft.control.PD().",
        )
    if compensator is not None and not isinstance(compensator, Compensator):
        raise InputError(
            f"Loop: expected a compensator, found {compensator!r}.",
            "Give an instance, such as dft.control.Lead(), or None.",
        )
    if controller.gives == "command" and compensator is not None:
        raise InputError(
            f"Loop: {type(controller).__name__} gives a command; a compensator expects a thrust.",
            "Leave the compensator out, or use a controller that gives a thrust.",
        )
    if controller.of not in plant.channels:
        raise InputError(
            f"Loop: the reference of {type(controller).__name__} is for '{controller.of}', which "
            f"nothing in the loop gives; there are {listing(plant.channels)}.",
            "Add a vehicle, or use a controller of one of these.",
        )
    for block in (controller, compensator):
        if block is not None:
            _check_reads(plant, block)


def _check_reads(plant: Plant, block: Block) -> None:
    name = type(block).__name__
    models = [model for model in (plant.thruster, plant.vehicle) if model is not None]
    for channel in block.reads:
        if channel not in plant.channels:
            raise InputError(
                f"Loop: {name} reads '{channel}', which nothing in the loop gives; there are "
                f"{listing(plant.channels)}.",
                "Add a vehicle, or use a block that reads one of these.",
            )
        for effect in (effect for model in models for effect in model.effects):
            if effect.memory and channel in effect.ports:
                raise InputError(
                    f"The effect '{effect.name}' acts on whole records of '{channel}', which "
                    f"{name} reads: it cannot run within a loop.",
                    "Leave it out, or use a block that does not read this channel.",
                )
