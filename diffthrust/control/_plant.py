"""A thruster with the effects on its command, and the vehicle that it pushes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.control._compensators import Compensator
from diffthrust.control._controllers import Controller
from diffthrust.effects import CommandDelay, CommandRateLimit
from diffthrust.models._base.effect import Effect, Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Signals, expect
from diffthrust.models._craft.placed import Placed
from diffthrust.simulation._trajectory import equations_of, measured_by, starting_point


def driven(thruster: Model) -> str:
    """The input that a loop gives: ``command``, or that of the one thruster of a craft."""
    commands = [n for n in thruster.inputs if n.rpartition(".")[2] == "command"]
    return commands[0] if len(commands) == 1 else ""


def named(values: Mapping[str, Array], prefix: str) -> dict[str, Array]:
    """The values of one part of a loop, without its name before theirs."""
    return {k.removeprefix(prefix): v for k, v in values.items() if k.startswith(prefix)}


@dataclass(frozen=True)
class Plant:
    """A thruster with its vehicle, or alone.

    The vehicle moves under the thrust as it is, not as a sensor reports it. Where there is a
    vehicle, the thruster's input ``inflow`` is the vehicle's velocity: the water comes at the
    propeller as fast as the vehicle moves through it.
    """

    thruster: Model  # with the input ``command``, or a craft of one thruster
    vehicle: Model | None  # with the input ``thrust``
    given: Mapping[str, Array]  # other inputs of the thruster, constant

    def check(self) -> None:
        """Raise `InputError` where the two cannot be joined."""
        if not isinstance(self.thruster, Model) or not driven(self.thruster):
            raise InputError(
                "Loop: expected a thruster with the input 'command', or a craft of one thruster, "
                f"found {self.thruster!s}.",
                "Give a model such as dft.Thruster().",
            )
        if self.vehicle is not None:
            if not isinstance(self.vehicle, Model) or list(self.vehicle.inputs) != ["thrust"]:
                raise InputError(
                    f"Loop: expected a vehicle with the one input 'thrust', found "
                    f"{self.vehicle!s}.",
                    "Give a model such as dft.AxisVehicle().",
                )
            if "thrust" not in self.thruster.outputs:
                raise InputError(
                    f"Loop: the model '{self.thruster.name}' has no output 'thrust' to push the "
                    f"vehicle; it has {listing(self.thruster.outputs)}.",
                    "Use a model that gives a thrust.",
                )
            twice = [n for n in self.vehicle.all_states if n in self.thruster.all_states]
            if twice:
                raise InputError(
                    f"Loop: thruster and vehicle both have a state {listing(twice)}.",
                    "Give one of them another name.",
                )
            for effect in self.vehicle.effects:
                if effect.memory and "thrust" in effect.ports:
                    raise InputError(
                        f"The effect '{effect.name}' acts on whole records of 'thrust': it cannot "
                        "run between the thruster and the vehicle of a loop.",
                        "Leave it out.",
                    )
        channels = {**self.thruster.inputs, **self.thruster.optional_inputs}
        wrong = [n for n in self.given if n not in channels or n in self._own]
        if wrong:
            raise InputError(
                f"given: the loop takes no {listing(wrong)}; the thruster's other inputs are "
                f"{listing(n for n in channels if n not in self._own)}.",
                "Correct the name.",
            )
        has = {*self.given, *self._own}
        needs = [n for e in self.thruster.effects for n in e.needs]
        absent = [n for n in (*self.thruster.inputs, *needs) if n not in has]
        if absent:
            raise InputError(
                f"Loop: the thruster '{self.thruster}' needs the input {listing(absent)}.",
                f'Give a constant: given={{"{absent[0]}": ...}}.',
            )

    def check_blocks(self, controller: Any, compensator: Any) -> None:
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
        name = type(controller).__name__
        if controller.gives == "command" and compensator is not None:
            raise InputError(
                f"Loop: {name} gives a command; a compensator expects a thrust.",
                "Leave the compensator out, or use a controller that gives a thrust.",
            )
        if controller.of not in self.channels:
            raise InputError(
                f"Loop: the reference of {name} is for '{controller.of}', which nothing in the "
                f"loop gives; there are {listing(self.channels)}.",
                "Add a vehicle, or use a controller of one of these.",
            )
        for block in (controller, compensator):
            for channel in block.reads if block is not None else ():
                self._check_channel(channel, type(block).__name__)

    def _check_channel(self, channel: str, reader: str) -> None:
        if channel not in self.channels:
            raise InputError(
                f"Loop: {reader} reads '{channel}', which nothing in the loop gives; there are "
                f"{listing(self.channels)}.",
                "Add a vehicle, or use a block that reads one of these.",
            )
        for effect in (effect for model in self.models for effect in model.effects):
            if effect.memory and channel in effect.ports:
                raise InputError(
                    f"The effect '{effect.name}' acts on whole records of '{channel}', which "
                    f"{reader} reads: it cannot run within a loop.",
                    "Leave it out, or use a block that does not read this channel.",
                )

    @property
    def models(self) -> tuple[Model, ...]:
        """The thruster, and the vehicle where there is one."""
        return (self.thruster,) if self.vehicle is None else (self.thruster, self.vehicle)

    @property
    def _own(self) -> tuple[str, ...]:
        """Inputs of the thruster that the loop itself gives."""
        states = ("speed",) if "speed" in self.thruster.states else ()
        moving = self.vehicle is not None and "velocity" in self.vehicle.outputs
        return (driven(self.thruster), *states, *(("inflow",) if moving else ()))

    @property
    def channels(self) -> dict[str, str]:
        """Everything that can be measured, with its unit."""
        return {n: unit for model in self.models for n, unit in model.outputs.items()}

    @property
    def states(self) -> dict[str, str]:
        """All states by their own names, with their units."""
        return {n: unit for model in self.models for n, unit in model.all_states.items()}

    def bind(self, values: Mapping[str, Array]) -> Plant:
        """The plant reading (possibly traced) values by full name."""

        def part(model: Model, prefix: str) -> Model:
            numbers = named(values, prefix)
            return model.bind(numbers) if numbers else model

        vehicle = part(self.vehicle, "vehicle.") if self.vehicle else None
        return Plant(part(self.thruster, "thruster."), vehicle, self.given)

    def start(self, initial: Mapping[str, Array], command: Array | float = 0.0) -> dict[str, Array]:
        """All states at the start: those given, others as the models have them at rest.

        Effects with states of their own begin settled at ``command``, as in `simulate`.
        """
        zero = jnp.zeros(())
        first = {driven(self.thruster): jnp.asarray(command, float), "time": zero, **self.given}
        if "inflow" in self._own:
            first["inflow"] = initial.get("velocity", zero)
        states = starting_point(self.thruster, Signals(first), initial)
        if self.vehicle:
            side = Signals({"thrust": zero, "time": zero})
            states |= starting_point(self.vehicle, side, initial)
        return states

    def equations(
        self, state: Mapping[str, Array], command: Array, time: Array
    ) -> tuple[dict[str, Array], dict[str, Array], dict[str, Array]]:
        """Rates of all states, outputs as they are, and outputs as the sensors report them.

        Elementwise: with numbers inside the integration, with whole arrays for a record. Effects
        with memory on an output count in the latter only.
        """
        channel = driven(self.thruster)
        signals: dict[str, Array] = {channel: command, "time": time, **self.given}
        if "inflow" in self._own:
            signals["inflow"] = state["velocity"]
        rates, outputs, reported = _side(self.thruster, state, signals, channel)
        if self.vehicle is not None:
            moved = _side(self.vehicle, state, {"thrust": outputs["thrust"], "time": time}, "")
            rates, outputs, reported = (
                {**a, **b} for a, b in zip((rates, outputs, reported), moved, strict=True)
            )
        return rates, outputs, reported


def _side(
    model: Model, state: Mapping[str, Array], signals: Mapping[str, Array], worked_out: str
) -> tuple[dict[str, Array], dict[str, Array], dict[str, Array]]:
    """Rates, outputs and readings of one of the two models."""
    # each effect sees the inputs as earlier ones have left them, as in `_trajectory`
    for effect in model.effects:
        outer = Ports((effect,), Signals(signals))
        signals = {n: v if n == worked_out else outer(n, v) for n, v in signals.items()}
    s = Signals({**{name: state[name] for name in model.all_states}, **signals})
    port = Ports(model.effects, s)
    derivatives, outputs = equations_of(model, s, port)
    rates = {**derivatives, **port.rates}
    expect(f"{type(model).__name__}.equations", "rate of the state", model.all_states, rates)
    shape = jnp.shape(signals["time"])
    now = tuple(effect for effect in model.effects if shape or not effect.memory)
    reported = measured_by(model._copy(effects=now), s, outputs)
    return rates, {n: jnp.broadcast_to(outputs[n], shape) for n in model.outputs}, reported


def _delayed(line: Array, value: Array, first: Array, samples: Array) -> tuple[Array, Array]:
    """A sample so many samples later, linear between them, and the line of samples to remember.

    The line has the newest in front, ``(n,)`` with n above ``samples``, and begins full of the
    first.
    """
    line = jnp.where(first, value, jnp.concatenate([value[None], line[:-1]]))
    # weights in the place of an index: no gather in the loop's body, and a derivative by the delay
    weights = jnp.maximum(1.0 - jnp.abs(samples - jnp.arange(line.shape[0], dtype=float)), 0.0)
    return jnp.sum(weights * line), line


class CommandPath:
    """The effects on the command of a thruster, sample by sample: what they do to whole records.

    The numbers are those of `effects._forms`, so that a loop's record, simulated again from its
    commands, moves as it did in the loop. The samples are ``step`` [s] apart. An `InputError`
    refuses an effect that reads other samples than the present one, of which no form is known that
    runs sample by sample.
    """

    def __init__(self, thruster: Model, step: float) -> None:
        self.channel: str = driven(thruster)
        self.lengths: dict[str, int] = {}
        """Samples that each effect remembers; they fix the compiled code."""
        for placed in thruster.effects:
            effect = _itself(placed)
            at = [port for port in placed.ports if port in thruster.inputs]
            if not at or not effect.memory:
                continue
            if isinstance(effect, CommandDelay):
                samples = math.ceil(float(effect.delay) / step + 1e-6) + 1
                # powers of two: another delay seldom needs another compilation
                self.lengths[placed.name] = 2 ** max(1, math.ceil(math.log2(samples)))
            elif isinstance(effect, CommandRateLimit):
                self.lengths[placed.name] = 0
            else:
                raise InputError(
                    f"The effect '{effect.name}' acts on whole records of '{at[0]}' and reads "
                    "other samples than the present one: it cannot run within a loop, where the "
                    "later samples are not known yet.",
                    "Leave it out, or give it states at a port inside the model.",
                )

    def start(self) -> dict[str, Array]:
        """What is remembered before the first sample."""
        return {name: jnp.zeros((n,) if n else ()) for name, n in self.lengths.items()}

    def __call__(
        self,
        effects: tuple[Effect, ...],
        signals: Mapping[str, Array],
        kept: Mapping[str, Array],
        first: Array,
        step: Array,
    ) -> tuple[Array, dict[str, Array]]:
        """The command that reaches the model, and what is to be remembered.

        Of the inputs at this sample, the command and ``time`` among them; ``first`` says whether
        it is the first one.
        """
        value, after = signals[self.channel], {}
        for placed in effects:
            effect, name = _itself(placed), placed.name
            if isinstance(effect, CommandDelay):
                value, after[name] = _delayed(kept[name], value, first, effect.delay / step)
            elif isinstance(effect, CommandRateLimit):
                last, reach = kept[name], effect.rate * step
                value = jnp.where(first, value, jnp.clip(value, last - reach, last + reach))
                after[name] = value
            else:
                arriving = Signals({**signals, self.channel: value})
                value = Ports((placed,), arriving)(self.channel, value)
        return value, after


def _itself(effect: Effect) -> Effect:
    """The effect that acts on the thruster of a craft."""
    return effect.inner if isinstance(effect, Placed) else effect
