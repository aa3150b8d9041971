"""Which states an output depends on, directly or through others."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import jax

from diffthrust.models._base.effect import Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Signals
from diffthrust.simulation._runge_kutta import plain_rate
from diffthrust.simulation._trajectory import equations_of, rates_of, read_out


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
