"""What a loop is put together from: parts that fit, their parameters by name, their timing."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import jax.numpy as jnp
import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.validation import check_known, finite, whole_number
from diffthrust.control._base import Block, Controller
from diffthrust.control._command_path import CommandPath
from diffthrust.control._compensators import Compensator, NoCompensator
from diffthrust.control._faults import Fault, check_faults
from diffthrust.control._loop_scan import Parts, Timing
from diffthrust.control._mpc import MPC
from diffthrust.control._one_sample import check_vessel
from diffthrust.control._plant import Plant
from diffthrust.control._reference import Reference
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Parameter

_MOST = 64
"""Recorded samples in one period of the controller."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LoopAssembly:
    """The parts of a `Loop`."""

    thruster: Model
    controller: Controller
    vehicle: Model | None = None
    compensator: Compensator | None = None
    rate: float = 50.0
    delay: float = 0.0
    noise: Mapping[str, float] = field(default_factory=dict)
    faults: Sequence[Fault] | Fault = ()
    given: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        plant = self.plant
        check_numbers(plant, self.rate, self.delay, self.noise)
        check_blocks(plant, self.controller, self.compensator)
        if self.controller.gives == "thrust" and self.compensator is None:
            object.__setattr__(self, "compensator", NoCompensator.of(self.thruster))
        object.__setattr__(self, "faults", check_faults(self.faults, self.parameters))
        self.parts(1)  # refuses effects that cannot run in a loop, and delays

    @property
    def plant(self) -> Plant:
        """Thruster and vehicle as one system."""
        constants = mapping("Loop, given", self.given, '{"supply_voltage": 24.0}')
        numbers = {
            name: finite(f"Loop, given '{name}'", value, lambda x: True, "a number")
            for name, value in constants.items()
        }
        arrays = {name: jnp.asarray(value) for name, value in numbers.items()}
        return Plant(self.thruster, self.vehicle, arrays)

    @property
    def _members(self) -> dict[str, Any]:
        members = {name: getattr(self, name) for name in
                   ("thruster", "vehicle", "controller", "compensator")}  # fmt: skip
        return {name: block for name, block in members.items() if block is not None}

    @property
    def parameters(self) -> dict[str, Parameter]:
        """All parameters and gains: ``thruster.alpha``, ``controller.bandwidth``, ..."""
        return {
            f"{member}.{name}": p
            for member, block in self._members.items()
            for name, p in block.parameters.items()
        }

    def replace(self, parameters: Mapping[str, Any] | None = None, /, **fields: Any) -> Self:
        """The loop with some parameters or some of its arguments changed.

        Args:
            parameters: full name to a value, a `Parameter`, or some fields of one.
            **fields: arguments of `Loop`.

        Raises:
            InputError: a name that the loop does not have, or a value outside its bounds.

        Example:
            >>> loop.replace({"controller.bandwidth": 2.0}, rate=100.0)
        """
        described = self.parameters
        grouped: dict[str, dict[str, Any]] = {}
        for name, new in (parameters or {}).items():
            check_known(name, described, "The loop has no parameter")
            member, _, short = name.partition(".")
            grouped.setdefault(member, {})[short] = new
        for name in fields:
            if name not in self.__dataclass_fields__:
                raise InputError(
                    f"Loop has no argument '{name}'; it has {listing(self.__dataclass_fields__)}.",
                    'Give parameters by their full names: replace({"thruster.ct": 0.02}).',
                )
        changed = {}
        for member, named in grouped.items():
            block = self._members[member]
            model = isinstance(block, Model)
            changed[member] = block.replace(named) if model else block.replace(**named)
        return replace(self, **changed, **fields)

    def parts(self, substeps: int) -> Parts:
        """What fixes the compiled code."""
        samples = self.samples
        late = round(self.delay * self.rate * samples)
        path = CommandPath(self.thruster, 1.0 / (self.rate * samples))
        timing = Timing(samples, substeps, late)
        return Parts(self.plant, self.controller, self.compensator, path, timing)

    @property
    def samples(self) -> int:
        """The fewest recorded samples in a period such that the delay is a multiple of it."""
        for samples in range(1, _MOST + 1):
            late = self.delay * self.rate * samples
            if abs(late - round(late)) <= 1e-6 * max(1.0, late):
                return samples
        raise InputError(
            f"Loop, delay: expected a simple part of the controller's period, "
            f"{1.0 / self.rate:g} s, found {self.delay:g} s.",
            f"Give {round(self.delay * self.rate * 10) / 10 / self.rate:g} s, for one.",
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class VesselAssembly:
    """The parts of a `VesselLoop`."""

    vessel: Model
    controller: MPC
    noise: Mapping[str, float] = field(default_factory=dict)
    given: Mapping[str, float | Reference] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_vessel(self.vessel, "VesselLoop")
        if not isinstance(self.controller, MPC):
            raise InputError(
                f"VesselLoop: expected an MPC as controller, found {self.controller!r}.",
                "Write controller=dft.control.MPC(model=..., limits=...).",
            )
        if tuple(self.vessel.inputs) != tuple(self.controller.model.inputs):
            raise InputError(
                f"VesselLoop: the vessel has the inputs {listing(self.vessel.inputs)}, the "
                f"controller's model {listing(self.controller.model.inputs)}.",
                "Give both the same drive.",
            )
        check_noise("VesselLoop", self.noise, self.vessel.outputs)
        optional, example = (
            self.vessel.optional_inputs,
            '{"wind_speed": 3.0, "wind_direction": 0.0}',
        )
        constants = mapping("VesselLoop, given", self.given, example, optional)
        for name, value in constants.items():
            if not isinstance(value, Reference):
                finite(
                    f"VesselLoop, given '{name}'",
                    value,
                    lambda x: True,
                    "a number or a Sinusoid, Step or Trajectory",
                )
        if len({"wind_speed", "wind_direction"} & set(constants)) == 1:
            raise InputError(
                "VesselLoop, given: expected wind_speed and wind_direction, found "
                f"{listing(constants)}.",
                f"Write given={example}.",
            )


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
        if names is not None:
            check_known(name, names, f"{what}: there is no {kind}", present="there are")
    return values


def seeded(seed: Any) -> np.random.Generator:
    """The generator of the measurement noise."""
    return np.random.default_rng(whole_number("seed", seed, 0, mend="Write seed=0."))


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
