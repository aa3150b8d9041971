"""What simulators know of a thruster: a state that a command drives, and a force by its speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.export._source import ExportSource
from diffthrust.export._steady import steady_outputs
from diffthrust.export._table import OUTPUT, command_limits, commanding
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model
from diffthrust.models._base.quadratic_load import QuadraticLoad
from diffthrust.models._base.signals import Signals
from diffthrust.simulation._trajectory import read_out

_POINTS = 61
"""Speeds at which a force is tabulated that is not proportional to speed |speed|."""
_PROPORTIONAL = 1e-9
"""A force is, where it is off by no more than this share."""


@dataclass(frozen=True)
class Rotor:
    """What simulators know of a thruster.

    Its ``dynamics`` are "yoerger" (rate = beta command - alpha speed |speed|), "bessa" (inertia
    rate = torque / resistance command - linear speed - quadratic speed |speed|), "first_order"
    (time_constant rate = gain command - speed), or "zero_order" (the command itself).
    """

    dynamics: str
    numbers: dict[str, float]  # its constants by these names
    low: float  # commands from here, in the model's unit
    high: float  # to here
    unit: str  # of the command
    ends: tuple[float, float]  # the speeds that both lead to [rad/s]
    coefficients: tuple[float, float]  # force over speed |speed|, ahead and astern [N s^2/rad^2]
    quadratic: bool  # the force is proportional to it
    speeds: np.ndarray  # at which the force is tabulated [rad/s], (n,)
    forces: np.ndarray  # there [N], (n,)
    left_out: tuple[Effect, ...]  # effects that have no place
    notes: tuple[str, ...]  # what was neglected of the model itself

    @property
    def largest(self) -> float:
        """The command that is furthest from zero."""
        return max(abs(self.low), abs(self.high))

    @property
    def full(self) -> float:
        """The largest speed that the commands lead to [rad/s]."""
        return max(map(abs, self.ends))


def rotor_of(source: ExportSource, limits: tuple[float, float] | None) -> Rotor:
    """The thruster in the terms of simulators, within limits in the unit of the logs."""
    model = source.model
    channel = commanding(model, source)
    if model.name == "static_thruster":
        return _static(source, channel, command_limits(source, channel, limits))
    has_dynamics = model.quadratic_load is not None or model.name in _LAWS
    if channel != "command" or not has_dynamics:
        raise InputError(
            f"Simulators have no place for the model '{model}'; they know the dynamics of "
            f"{', '.join(['thruster', *_LAWS])}, from a command.",
            "Export it to python or to c.",
        )
    low, high = command_limits(source, channel, limits)
    left_out = _without_place(model)
    plain = model._copy(effects=tuple(e for e in model.effects if e not in left_out))
    values = {name: float(p.value) for name, p in plain.parameters.items()}
    taken_as_one: tuple[str, ...] = ()
    power, error = values.get("exponent", 1.0), source.errors.get("exponent", 0.0)
    # simulators know commands of the first power only: an exponent within its error counts as one
    if power != 1.0 and abs(power - 1.0) <= 2 * error:
        values["exponent"], plain = 1.0, plain.replace(exponent=1.0)
        taken_as_one = (f"The exponent is taken as 1: it is {power:.4g}, within its error.",)
    limit = values.get("command_saturation.limit", np.inf)
    low, high = max(low, -limit), min(high, limit)
    torque_driven = plain.quadratic_load
    if torque_driven is not None:
        dynamics, numbers, notes = _torque(torque_driven, values)
    else:
        dynamics, numbers, notes = _LAWS[model.name](values)
    reached = steady_outputs(plain, {channel: np.array([low, high])}, ("speed",))[0]
    power = numbers.pop("exponent", 1.0)
    low, high = (float(np.sign(c) * abs(c) ** power) for c in (low, high))
    ends = float(reached[0]), float(reached[1])
    full = max(map(abs, ends))
    speeds = np.linspace(-full, full, _POINTS)
    forces = source.strength * _force(plain, speeds)
    shape = speeds * np.abs(speeds)
    # exact at full speed, where the forces are largest
    ahead, astern = float(forces[-1] / shape[-1]), float(forces[0] / shape[0])
    line = np.where(speeds < 0, astern, ahead) * shape
    off = float(np.max(np.abs(forces - line)) / np.max(np.abs(forces)))
    return Rotor(
        dynamics,
        numbers,
        low,
        high,
        source.inputs[channel],
        ends,
        (ahead, astern),
        off <= _PROPORTIONAL,
        speeds,
        forces,
        tuple(left_out),
        (*taken_as_one, *notes),
    )


def _static(source: ExportSource, channel: str, limits: tuple[float, float]) -> Rotor:
    """A thruster without dynamics: its command stands for the speed, and the force is a table."""
    low, high = limits
    effects = source.model.effects
    left_out = tuple(e for e in effects if e.memory or e.states)
    plain = source.model._copy(effects=tuple(e for e in effects if not (e.memory or e.states)))
    commands = np.unique([*np.linspace(low, high, _POINTS), 0.0])
    forces = source.strength * steady_outputs(plain, {channel: commands}, (OUTPUT,))[0]
    unit = source.inputs[channel]
    ends = float(commands[0]), float(commands[-1])
    at_ends = float(forces[-1]), float(forces[0])
    return Rotor("zero_order", {}, low, high, unit, ends, at_ends, False, commands, forces,
                 left_out, ())  # fmt: skip


def _without_place(model: Model) -> list[Effect]:
    """The effects that simulators do not know."""
    left_out: list[Effect] = []
    for effect in reversed(model.effects):
        if all(port in model.outputs for port in effect.ports):
            continue  # what only a sensor does is no part of a thruster
        # simulators clamp what they are sent, after all that is done to it before
        last = not any("command" in earlier.ports for earlier in left_out)
        taken = effect.name == "linear_damping" or (effect.name == "command_saturation" and last)
        if not (taken or _of_speed(effect)):
            left_out.insert(0, effect)
    return left_out


def _of_speed(effect: Effect) -> bool:
    """Whether an effect changes the force by the present speed, and by nothing else."""
    if effect.ports != ("propeller",) or effect.states:
        return False
    try:
        effect.at("propeller", jnp.asarray(1.0), Signals({"speed": jnp.asarray(1.0)}))
    except (InputError, KeyError):  # it reads another signal
        return False
    return True


def _force(model: Model, speeds: np.ndarray) -> np.ndarray:
    """The thrust at given speeds, without what sensors add."""
    kept = (effect for effect in model.effects if effect.ports == ("propeller",))
    model = model._copy(effects=tuple(kept))
    signals = {"speed": jnp.asarray(speeds), "time": jnp.zeros(speeds.shape)}
    zeros = {name: jnp.zeros(speeds.shape) for name in (*model.states, *model.inputs)}
    return np.asarray(read_out(model, Signals({**zeros, **signals}))[OUTPUT])


def _torque(
    thruster: QuadraticLoad, values: dict[str, float]
) -> tuple[str, dict[str, float], tuple[str, ...]]:
    """Yoerger et al. 1990; with a linear damping that of Bessa et al. 2006."""
    damping = values.get("linear_damping.rate", 0.0)
    if not damping:
        return "yoerger", {"alpha": thruster.load, "beta": thruster.drive_gain}, ()
    # only ratios to the inertia are identifiable from motion: it is set to 1
    numbers = {"inertia": 1.0, "linear": damping, "quadratic": thruster.load}
    return "bessa", {**numbers, "torque": thruster.drive_gain, "resistance": 1.0}, ()


def _motor(values: dict[str, float]) -> tuple[str, dict[str, float], tuple[str, ...]]:
    """Bessa et al. 2006: a DC motor without inductance."""
    back = values["torque_constant"] * values["back_emf"] / values["resistance"]
    damping = values.get("linear_damping.rate", 0.0)
    numbers = {
        "inertia": values["inertia"],
        "linear": values["viscous"] + back + damping,
        "quadratic": values["load"],
        "torque": values["torque_constant"],
        "resistance": values["resistance"],
    }
    late = 1e3 * values["inductance"] / values["resistance"]
    notes = [f"The current follows at once: its time constant of {late:.2g} ms is neglected."]
    if values["coulomb"]:
        notes.append(f"The dry friction of {values['coulomb']:.3g} N m has no place: left out.")
    return "bessa", numbers, tuple(notes)


def _loop(values: dict[str, float]) -> tuple[str, dict[str, float], tuple[str, ...]]:
    """A speed loop of the first order."""
    numbers = {name: values[name] for name in ("gain", "time_constant", "exponent")}
    notes = []
    if values["exponent"] != 1.0:
        notes.append(
            "The speed follows what is sent in proportion, not as the power that was fitted: send "
            f"sign(command) |command|^{values['exponent']:.6g}."
        )
    return "first_order", numbers, tuple(notes)


_LAWS: dict[str, Any] = {
    "dc_motor_thruster": _motor,
    "speed_loop_thruster": _loop,
}
"""How other models of the library become constants of simulators."""
