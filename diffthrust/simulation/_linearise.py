"""Derivatives of a model's rates and outputs by its states, ports and inputs."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.programs import program
from diffthrust.models._base.effect import Ports, Reading
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Signals
from diffthrust.simulation._integrate import plain_rate
from diffthrust.simulation._record import Record
from diffthrust.simulation._trajectory import (
    Key,
    arriving,
    equations_of,
    measured_by,
    rates_of,
    read_out,
)


def states_behind(
    model: Model, output: str, states: tuple[str, ...], signals: Mapping[str, Any]
) -> tuple[str, ...]:
    """The states, in their order, that an output can feel.

    A vehicle's speed does not feel its position, nor its yaw rate the place to which it has turned;
    periodic responses are found without them, even where they drift or turn without end.

    Args:
        model: the model.
        output: whose states are wanted.
        states: all that are integrated.
        signals: a value for each of the inputs and for the time, numbers.
    """
    numbers = {name: 0.5 for name in states}

    def right_hand_side(state: Mapping[str, Any]) -> tuple[Any, ...]:
        s = {**signals, **state}
        rates = rates_of(model, states, state, signals)
        series = Signals({n: jax.numpy.broadcast_to(v, (1,)) for n, v in s.items()})
        return (*(rates[n] for n in states), read_out(model, series)[output])

    # By the traced operations, not by derivatives: a slope may vanish at the point that is tried
    # (drag at rest), and a dead band has none.
    closed = jax.make_jaxpr(right_hand_side)(numbers)
    felt = dependence(closed.jaxpr)
    sizes = [
        len(jax.tree.leaves(component)) for component in jax.eval_shape(right_hand_side, numbers)
    ]
    order = sorted(states)  # as a dictionary's leaves are
    rows, at = [], 0
    for size in sizes:  # a relaxing state has two numbers
        rows.append({order[i] for leaf in felt[at : at + size] for i in leaf})
        at += size
    behind, wave = set(rows[-1]), set(rows[-1])
    while wave:
        wave = set().union(*(rows[states.index(n)] for n in wave)) - behind
        behind |= wave
    return tuple(name for name in states if name in behind)


def enters(name: str, model: Model, inputs: Collection[str]) -> bool:
    """Whether an input, or the time, enters the equations of a model with its effects."""
    names = sorted({"time", *inputs, *model.all_states})

    def run(*values: Any) -> Any:
        s = Signals(dict(zip(names, values, strict=True)))
        return [
            [plain_rate(value) for value in part.values()]
            for part in equations_of(model, s, Ports(model.effects, s))
        ]

    program = jax.make_jaxpr(run)(*(jax.numpy.asarray(0.5) for _ in names)).jaxpr
    place = program.invars[names.index(name)]
    return any(place is taken for step in program.eqns for taken in step.invars)


def dependence(jaxpr: Any) -> list[set[int]]:
    """For each result of traced code the arguments that it can depend on."""
    reach: dict[Any, set[int]] = {var: {i} for i, var in enumerate(jaxpr.invars)}

    def of(atom: Any) -> set[int]:
        return set() if hasattr(atom, "val") else reach.get(atom, set())

    for equation in jaxpr.eqns:
        reached = set().union(*(of(atom) for atom in equation.invars))
        for var in equation.outvars:
            reach[var] = reached
    return [of(atom) for atom in jaxpr.outvars]


def slopes_at(model: Model, record: Record) -> tuple[dict[str, Any], dict[str, Any]]:
    """Derivatives of rates and outputs by states, ports and inputs, at one point of a record.

    Returns:
        ``{rate: (by_state, by_port, by_input)}`` and the same of the outputs.
    """
    rates, outputs = jax.tree.map(np.asarray, slopes(Key(model), *point_in(model, record)))
    return rates, outputs


def point_in(model: Model, record: Record) -> tuple[dict[str, Any], ...]:
    """Values of parameters, of the states and of the inputs, away from where slopes may vanish."""
    rng = np.random.default_rng(0)
    series = {n: record.at_samples(v) for n, v in record.inputs_for(model).items()}
    # away from zero, where a slope may vanish by symmetry (the drag of a vessel at rest)
    inputs = {n: np.asarray(np.nanmean(np.abs(v)) + 0.1) for n, v in series.items()}
    # Random values, for at equal ones differences of states cancel, and a slope that exists looks
    # like zero.
    states = {n: np.asarray(rng.uniform(0.3, 0.7)) for n in model.all_states if n not in inputs}
    return {n: np.asarray(p.value, float) for n, p in model.parameters.items()}, states, inputs


@program(1, quick_compile=True)
def slopes(
    key: Key, values: Mapping[str, Any], states: dict[str, Any], inputs: dict[str, Any]
) -> tuple[Any, Any]:
    """What `slopes_at` gives, at a point of its own.

    A program, for one by one its operations took 0.4 s of a first diagnosis, of a vessel 0.6 s.
    """
    model = key.model.bind(values)

    def both(x: dict[str, Any], push: dict[str, Any], fed: dict[str, Any]) -> Any:
        s = Signals({**fed, "time": jnp.zeros(()), **x})
        rates, outputs = equations_of(model, s, Reading(model.effects, s, push))
        return tuple(
            {n: jnp.asarray(plain_rate(v), float) for n, v in series.items() if n in declared}
            for series, declared in ((rates, model.states), (outputs, model.outputs))
        )

    still = {n: jnp.zeros(()) for n in model.ports}
    return jax.jacfwd(both, argnums=(0, 1, 2))(states, still, inputs)


class InfiniteSlope(NamedTuple):
    """Where a derivative of a model is not finite, and the mend, a sentence each."""

    problem: str
    mend: str


_FINITE = (
    "Write '{}' so that its derivatives are finite at every sample: a root, a logarithm or a power "
    "below one of what is zero there has none. Keep it from zero, such as by "
    "jnp.sqrt(jnp.maximum(x, 1e-12))"
)


def infinite_slope(
    model: Model,
    record: Record,
    start: Mapping[str, float],
    path: Mapping[str, np.ndarray],
    *,
    places: bool,
) -> InfiniteSlope | None:
    """The first derivative along a run that is not finite; ``None`` if all are.

    A root of what is zero in some samples is finite, and its slope is not: no search could begin,
    and it was said that every start diverged.

    Args:
        model: the model.
        record: the log.
        start: its initial states, and values of parameters that differ by log.
        path: a finite simulation of it, ``(n,)`` each.
        places: derivatives by inputs and ports count, beside those by free parameters and states.
    """
    time = record.log.time
    inputs = {n: record.at_samples(v) for n, v in record.inputs_for(model).items()}
    states = {n: path[n] for n in model.all_states if n not in inputs}
    values = {n: p.value for n, p in model.parameters.items()}
    values |= {n: start[n] for n in model.per_log if n in start}
    still = {n: np.zeros(time.size) for n in model.ports}
    given = {"parameter": values, "state": states, "port": still, "input": inputs}

    free = [n for n, p in model.parameters.items() if not p.fixed]
    fixable = {f"parameter '{n}'" for n in free}
    kinds = {
        "parameter": free,
        "state": states,
        **({"port": still, "input": inputs} if places else {}),
    }
    lost = []
    for kind, name in ((kind, name) for kind, names in kinds.items() for name in names):
        value = jnp.asarray(given[kind][name], float)
        # by it alone: beside an infinite slope a tangent of zero is no number
        along = partial(_along, model, time, given, kind, name)
        _, slopes = jax.jvp(along, (value,), (jnp.ones_like(value),))
        for of, slope in slopes.items():
            at = np.flatnonzero(~np.isfinite(np.broadcast_to(slope, time.shape)))
            if at.size:
                lost.append((int(at[0]), at.size, of, f"{kind} '{name}'"))
    if not lost:
        return None
    k, count, of, by = min(lost, key=lambda row: row[0])
    where = f"{count} of {time.size} samples; first at sample {k + 1} (t = {time[k]:.6g} s)"
    units = {**model.inputs, **model.optional_inputs, **model.all_states}
    there = [f"{n} = {v[k]:.4g} {units.get(n, '')}".rstrip() for n, v in (inputs | states).items()]
    return InfiniteSlope(
        f"{record.name}: the simulation is finite, but the derivative of {of} by the {by} is not, "
        f"at {where}, where {', '.join(there[:6])}.",
        _FINITE.format(model) + (f", or fix {by.partition(' ')[2]}." if by in fixable else "."),
    )


def _along(
    model: Model,
    time: np.ndarray,
    given: Mapping[str, Mapping[str, Any]],
    kind: str,
    name: str,
    value: Any,
) -> dict[str, Any]:
    """Rates and outputs along a run, with another value of one of what is given by kind."""
    now = {**given, kind: {**given[kind], name: value}}
    bound = model.bind(now["parameter"])
    s = Signals({**arriving(bound, time, now["input"]), "time": time, **now["state"]})
    port = Reading(bound.effects, s, now["port"])
    rates, outputs = equations_of(bound, s, port)
    rates = {**rates, **port.rates}
    return {
        **{f"the rate of '{n}'": plain_rate(rates[n]) for n in now["state"]},
        **{f"the output '{n}'": v for n, v in measured_by(bound, s, outputs).items()},
    }
