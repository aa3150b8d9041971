"""A whole loop in one scan: sampled control, the command's way, and the plant's next step.

Every step of the integrator is one turn of the scan; what is done less often (the controller, the
motor controller) is worked out at every turn and taken over at its own samples. That keeps the body
elementwise, so XLA compiles the loop as one kernel, and forward derivatives pass through it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from diffthrust._support._running.programs import program
from diffthrust.control._compensators import Compensator
from diffthrust.control._controllers import Controller, Kept
from diffthrust.control._faults import FaultNumbers, factors_at, taken_command
from diffthrust.control._plant import CommandPath, Plant, named
from diffthrust.models._base.signals import Relaxing, Signals, elementwise, expect
from diffthrust.simulation._integrate import advance, exponential_weights


@dataclass(frozen=True)
class Parts:
    """What a loop is made of, as a static argument: equal where the structure is equal."""

    plant: Plant = field(compare=False)
    controller: Controller = field(compare=False)
    compensator: Compensator | None = field(compare=False)
    path: CommandPath = field(compare=False)
    samples: int  # recorded samples in one period of the controller
    substeps: int  # integrator steps in one recorded sample
    late: int  # the computational delay, in recorded samples
    structure: tuple[Any, ...] = field(init=False)

    def __post_init__(self) -> None:
        parts = (self.plant.thruster, self.plant.vehicle, self.controller, self.compensator)
        classes = (block.structure if block else None for block in parts)
        memories = tuple(self.path.lengths.items())
        object.__setattr__(self, "structure", (*classes, tuple(self.plant.given), memories))


def loop_signals(
    parts: Parts,
    values: Mapping[str, Array],
    signals: Mapping[str, Array],
    faults: FaultNumbers,
    rows: Mapping[str, Array],
    start: Mapping[str, Array],
) -> dict[str, Array]:
    """Run a loop; traceable.

    Args:
        parts: the structure.
        values: all parameters and gains by full name.
        signals: constant inputs of the thruster.
        faults: what breaks, and when.
        rows: over the recorded samples, ``(T,)`` each: ``time`` [s] (evenly spaced), ``wanted``,
            ``wanted_rate``, ``wanted_acceleration``, and ``noise.CHANNEL`` for noisy channels.
        start: initial states by name; others as the models have them at rest.

    Returns:
        Over the recorded samples, ``(T,)`` each: the states, ``command`` (as it is sent),
        ``motor_command`` (after faults and the effects on it), ``wanted_thrust``, the memories of
        controller and compensator, outputs by name, and ``measured.CHANNEL``.
    """
    plant = Plant(parts.plant.thruster, parts.plant.vehicle, signals).bind(values)
    blocks = {
        name: block._bound(named(values, f"{name}."))
        for name, block in (("controller", parts.controller), ("compensator", parts.compensator))
        if block is not None
    }
    time, step = rows["time"], rows["time"][1] - rows["time"][0]
    first = {name: jnp.asarray(value, float) for name, value in plant.start(start).items()}
    loop = _Loop(parts, values, signals, faults, start, plant, blocks, step)
    jumping = any("factors" in fault for fault in faults)
    x, weights = _turns(rows, parts, loop.short, partial(loop.decays, first), jumping=jumping)
    zero = jnp.zeros(())
    begin = {
        "state": first,
        "kept": {
            name: {n: jnp.asarray(block.start().get(n, 0.0), float) for n in block.states}
            for name, block in blocks.items()
        },
        **dict.fromkeys(("output", "wanted_thrust", "command", "taken", "motor_command"), zero),
        "line": jnp.zeros((parts.late + 1,)),
        "path": parts.path.start(),
    }
    _, path = jax.lax.scan(partial(loop.turn, weights), begin, x)
    path = {name: value[:: parts.substeps] for name, value in path.items()}
    return {**path, **_read(loop.plant_at(time), path, rows)}


class _Loop(NamedTuple):
    """A loop while it runs: what stays the same from turn to turn, and what a turn does."""

    parts: Parts
    values: Mapping[str, Array]
    signals: Mapping[str, Array]
    faults: FaultNumbers
    start: Mapping[str, Array]
    plant: Plant  # without faults
    blocks: Mapping[str, Any]  # controller and compensator
    step: Array  # between two recorded samples [s]

    @property
    def short(self) -> Array:
        """Step of the integrator [s]."""
        return self.step / self.parts.substeps

    def plant_at(self, instant: Array) -> Plant:
        """The plant as faults leave it at an instant, or at many."""
        factors = factors_at(self.faults, instant)
        if not factors:
            return self.plant
        return self.plant.bind({n: self.values[n] * f for n, f in factors.items()})

    def decays(self, state: Mapping[str, Array], instant: Array) -> dict[str, Array]:
        """Rates at which relaxing states decay [1/s]."""
        rates, _, _ = self.plant_at(instant).equations(state, jnp.zeros(()), instant)
        return {n: jnp.asarray(k.decay) for n, k in rates.items() if isinstance(k, Relaxing)}

    def turn(
        self, weights: Mapping[str, Any], carry: dict[str, Any], x: Mapping[str, Any]
    ) -> tuple[dict[str, Any], dict[str, Array]]:
        """One step of the integrator, and what goes on record at its start."""
        state, now, plant = carry["state"], x["time"], self.plant_at(x["time"])
        control, sent = self._sent(plant, carry, x)
        # a record of the loop that is simulated again begins settled at its first command; states
        # of effects have a dot in their names, those of the models begin where they are given
        if settling := [name for name in state if "." in name]:
            settled = plant.start(self.start, sent["motor_command"])
            state = {**state, **{n: jnp.where(x["first"], settled[n], state[n]) for n in settling}}
        row = {
            **state,
            "command": sent["command"],
            "motor_command": sent["motor_command"],
            "wanted_thrust": control["wanted_thrust"],
            **{f"{b}.{n}": v for b, memory in control["kept"].items() for n, v in memory.items()},
        }
        held = {"motor": (sent["motor_command"],), "time": (now, now + self.short)}

        def rates(state: Mapping[str, Array], u: Mapping[str, Array]) -> dict[str, Array]:
            return plant.equations(state, u["motor"], u["time"])[0]

        state = advance(rates, state, held, self.short, x.get("weights", weights))
        return {"state": state, **control, **sent}, row

    def _sent(
        self, plant: Plant, carry: dict[str, Any], x: Mapping[str, Any]
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """What the blocks make of a turn's readings, and how it arrives at the motor."""
        parts, state, now = self.parts, carry["state"], x["time"]
        _, _, reported = plant.equations(state, carry["motor_command"], now)
        noisy = {n: v + x[f"noise.{n}"] if f"noise.{n}" in x else v for n, v in reported.items()}
        wanted = {n: x[n] for n in ("wanted", "wanted_rate", "wanted_acceleration")}
        s = Signals({**noisy, **wanted, "time": now})
        control = _controlled(self.blocks, s, carry["kept"], self.step * parts.samples)
        control = _when(x["tick"], parts.samples * parts.substeps, control, carry)
        line = jnp.concatenate([control["output"][None], carry["line"][:-1]])
        # a line of outputs and not an index into the past: the loop's body stays one kernel
        command = line[parts.late]
        # faults act on what arrives, after the dead time and before the motor controller's effects
        taken = taken_command(self.faults, command, carry["taken"], now)
        inflow = {"inflow": state["velocity"]} if "velocity" in state else {}
        inputs = {**inflow, **self.signals, "time": now, parts.path.channel: taken}
        effects = plant.thruster.effects
        motor, path = parts.path(effects, inputs, carry["path"], x["first"], self.step)
        sent = {"line": line, "command": command, "taken": taken, "motor_command": motor}
        return control, _when(x["mark"], parts.substeps, {**sent, "path": path}, carry)


def _turns(
    rows: Mapping[str, Array],
    parts: Parts,
    short: Array,
    decays: Callable[[Array], dict[str, Array]],
    *,
    jumping: bool,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Rows for every turn of the scan, and the weights of relaxing states if these are constant."""
    x: dict[str, Any] = {name: jnp.repeat(row, parts.substeps) for name, row in rows.items()}
    index = jnp.arange(x["time"].shape[0])
    time = rows["time"]
    x["time"] = time[0] + short * index.astype(float)
    x["mark"] = index % parts.substeps == 0
    x["tick"] = index % (parts.substeps * parts.samples) == 0
    x["first"] = index == 0
    fixed = {} if jumping else decays(time[0])
    weights = {name: exponential_weights(short, decay) for name, decay in fixed.items()}
    if jumping:  # time constants may jump with the parameters
        each = jax.vmap(decays)(x["time"])
        x["weights"] = {name: exponential_weights(short, decay) for name, decay in each.items()}
    return x, weights


def _controlled(
    blocks: Mapping[str, Any], s: Signals, kept: Mapping[str, Kept], period: Array
) -> dict[str, Any]:
    """What controller and compensator make of one sample."""
    memory: dict[str, Kept] = {}

    def evaluate(name: str, *before: Array) -> Array:
        where = type(blocks[name]).__name__
        with elementwise(where):
            value, after = blocks[name](*before, s, kept[name], period)
        expect(where, "value to remember for", blocks[name].states, after)
        memory[name] = {n: jnp.asarray(after[n], float) for n in blocks[name].states}
        return jnp.asarray(value, float)

    value = evaluate("controller")
    gives = blocks["controller"].gives
    output = evaluate("compensator", value) if "compensator" in blocks else value
    wanted = value if gives == "thrust" else jnp.zeros(())
    return {"kept": memory, "output": output, "wanted_thrust": wanted}


def _read(plant: Plant, path: Mapping[str, Array], rows: Mapping[str, Array]) -> dict[str, Array]:
    """Outputs over a whole record, as they are and as the sensors report them."""
    _, outputs, reported = plant.equations(path, path["motor_command"], rows["time"])
    noisy = {
        f"measured.{name}": value + rows.get(f"noise.{name}", 0.0)
        for name, value in reported.items()
    }
    return {**outputs, **noisy}


def _when(flag: Array, every: int, new: dict[str, Any], carry: Mapping[str, Any]) -> dict[str, Any]:
    """What is new, at turns with the flag, and else what was carried to here."""
    if every == 1:  # no select is needed
        return new
    return jax.tree.map(partial(jnp.where, flag), new, {name: carry[name] for name in new})


compiled_loop = program(1)(loop_signals)
"""`loop_signals`, compiled once for each structure and number of samples."""
