"""A model from one sample to the next, with its inputs held: what predicts and what is steered."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Relaxing, Signals
from diffthrust.simulation._integrate import advance, exponential_weights
from diffthrust.simulation._trajectory import arriving, rates_of, starting_point

State = dict[str, Array]
PLACE = ("north", "east")
SPEEDS = ("surge", "sway", "yaw_rate")
AT_SEA: tuple[str, ...] = (*SPEEDS, *PLACE, "heading")
"""States that a model of a vessel must have and measure."""


def check_vessel(model: Any, who: str) -> None:
    """Raise `InputError` for what is no vessel that can be run sample by sample."""
    fits = isinstance(model, Model) and all(
        name in model.states and name in model.outputs for name in AT_SEA
    )
    if not fits:
        raise InputError(
            f"{who}: expected a model of a vessel, with the states {listing(AT_SEA)}, found "
            f"{model!s}.",
            "Give a model such as dft.Vessel().",
        )
    for effect in model.effects:
        channels = (*model.inputs, *model.optional_inputs, *model.outputs)
        at = [port for port in effect.ports if port in channels]
        if effect.memory and at:
            raise InputError(
                f"{who}: the effect '{effect.name}' acts on whole records of '{at[0]}': it cannot "
                "run within a loop, where the later samples are not known yet.",
                "Leave it out, or give it states at a port inside the model (rudder_lag has).",
            )


def begin(
    model: Model, inputs: Mapping[str, Array | float], initial: Mapping[str, Array | float]
) -> State:
    """All states at rest, or as given, and those of the effects as they follow; traceable."""
    first = {**arriving(model, jnp.zeros(()), inputs), "time": jnp.zeros(())}
    states = starting_point(model, Signals(first), initial)
    return {name: jnp.asarray(value, float) for name, value in states.items()}


def one_sample(
    model: Model,
    state: State,
    inputs: Mapping[str, Array],
    time: Array,
    period: Array,
    substeps: int,
    push: Mapping[str, Array] | None = None,
) -> State:
    """All states one period [s] later, with inputs held over it; traceable.

    A ``push`` are accelerations that the model does not know: ``north`` and ``east`` [m/s^2] and
    ``yaw`` [rad/s^2], constant over ground.
    """
    held = arriving(model, time, inputs)
    step = period / substeps

    def rates(state: Mapping[str, Array], u: Mapping[str, Array]) -> dict[str, Array | Relaxing]:
        slope = rates_of(model, state, state, u)
        if push is None:
            return slope
        cos, sin = jnp.cos(state["heading"]), jnp.sin(state["heading"])
        more = {
            "surge": push["north"] * cos + push["east"] * sin,
            "sway": push["east"] * cos - push["north"] * sin,
            "yaw_rate": push["yaw"],
        }
        return {**slope, **{name: slope[name] + a for name, a in more.items()}}

    # inputs are held over the sample, so decays are constant and their exponentials are taken once
    slopes = rates(state, {**held, "time": time})
    decays = {name: k.decay for name, k in slopes.items() if isinstance(k, Relaxing)}
    weights = {n: exponential_weights(step, jnp.asarray(decay)) for n, decay in decays.items()}

    def body(count: Array, state: State) -> State:
        now = time + step * count
        instants = {**{name: (value,) for name, value in held.items()}, "time": (now, now + step)}
        return advance(rates, state, instants, step, weights)

    return jax.lax.fori_loop(0, substeps, body, dict(state))
