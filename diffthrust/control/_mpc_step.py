"""One sample of a predictive controller: Gauss-Newton over the horizon, within the limits."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._simulate import Key
from diffthrust.control._box import least_squares_within
from diffthrust.control._motion import AT_SEA, PLACE, SPEEDS, one_sample

_LENGTHS = np.array([1.0, 0.5, 0.25, 0.1])
_MARGIN = 1e-3
"""Of the range between the limits: slopes are taken this far inside, where a force law that stops
at a limit (a propeller at rest) still has one."""
_SETTLED = 1e-3
"""Of the range: a plan that an iteration changes by less is taken as the best."""


class Plan(NamedTuple):
    """What a predictive controller intends, and what it remembers until the next sample.

    Args:
        inputs: what to apply now, by name, in the model's units.
        planned: the inputs over the horizon, as shares of the range between their limits,
            ``(horizon, inputs)``.
        state: the states that it expects at the next sample.
        push: accelerations that the model does not explain, ``north``, ``east`` [m/s^2] and ``yaw``
            [rad/s^2]; zero unless they are estimated.
        cost: the sum of squares that was minimized.
        iterations: Gauss-Newton steps that were taken.
        settled: whether the last of them changed the inputs by less than a thousandth of their
            ranges.
    """

    inputs: dict[str, Any]
    planned: Any
    state: dict[str, Any]
    push: dict[str, Any]
    cost: Any
    iterations: Any
    settled: Any


class Frame(NamedTuple):
    """What fixes the compiled code of a controller, beside the lengths of its arrays."""

    key: Key
    substeps: int
    estimating: bool


class Numbers(NamedTuple):
    """What a controller can be given anew without another compilation."""

    values: dict[str, Any]
    low: Any
    high: Any
    moves: Any
    period: Any
    position: Any
    lag: Any
    iterations: Any


def solve(frame: Frame, given: Numbers, plan: Plan, seen: Mapping[str, Any], place: Any) -> Plan:
    """`MPC.step`, traceable: ``place`` is ``(horizon, 2)``, NaN in ``seen`` stands for not seen."""
    model = frame.key.model.bind(given.values)
    period, names = given.period, tuple(model.inputs)
    missed = {n: jnp.where(jnp.isnan(seen[n]), 0.0, seen[n] - plan.state[n]) for n in SPEEDS}
    push = _estimate(plan, missed, period, given.lag) if frame.estimating else plan.push
    state = {**plan.state}
    state |= {n: jnp.where(jnp.isnan(seen[n]), plan.state[n], seen[n]) for n in AT_SEA}
    before = jnp.stack([plan.inputs[name] for name in names])
    before = (before - given.low) / (given.high - given.low)

    def inputs_of(shares: Any) -> dict[str, Any]:
        row = given.low + shares * (given.high - given.low)
        return {name: row[i] for i, name in enumerate(names)}

    def after(state: Any, shares: Any) -> Any:
        zero = jnp.zeros(())  # models do not read the time of day
        inputs = inputs_of(shares)
        return one_sample(model, state, inputs, zero, period, frame.substeps, push)

    def residual(flat: Any) -> Any:
        shares = flat.reshape(plan.planned.shape)

        def body(state: Any, row: Any) -> tuple[Any, Any]:
            state = after(state, row)
            return state, jnp.stack([state[name] for name in PLACE])

        _, track = jax.lax.scan(body, state, shares)
        changes = jnp.diff(shares, axis=0, prepend=before[None]) / given.moves[None]
        return jnp.concatenate([((track - place) / given.position).ravel(), changes.ravel()])

    def cost(flat: Any) -> Any:
        total = jnp.sum(residual(flat) ** 2)
        return jnp.where(jnp.isfinite(total), total, jnp.inf)

    def improve(carry: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
        flat, count, _ = carry
        jacobian = jax.jacfwd(residual)(jnp.clip(flat, _MARGIN, 1.0 - _MARGIN))
        step, _ = least_squares_within(
            jacobian, residual(flat), -flat, 1.0 - flat, jnp.zeros_like(flat)
        )
        tried = jax.vmap(lambda length: flat + length * step)(_LENGTHS)
        costs = jax.vmap(cost)(tried)
        best = jnp.argmin(costs)
        better = costs[best] < cost(flat)
        new = jnp.where(better, tried[best], flat)
        return new, count + 1, jnp.max(jnp.abs(new - flat)) < _SETTLED

    def unsettled(carry: tuple[Any, Any, Any]) -> Any:
        return ~carry[2] & (carry[1] < given.iterations)

    guess = jnp.concatenate([plan.planned[1:], plan.planned[-1:]]).ravel()
    flat, count, settled = jax.lax.while_loop(
        unsettled, improve, (guess, jnp.asarray(0), jnp.asarray(False))
    )
    planned = jnp.clip(flat, 0.0, 1.0).reshape(plan.planned.shape)
    expected = after(state, planned[0])
    return Plan(inputs_of(planned[0]), planned, expected, push, cost(flat), count, settled)


def _estimate(plan: Plan, missed: Mapping[str, Any], period: Any, lag: Any) -> dict[str, Any]:
    """The unexplained accelerations, moved towards what the last sample missed."""
    heading = plan.state["heading"]
    cos, sin = jnp.cos(heading), jnp.sin(heading)
    gain = -jnp.expm1(-period / lag) / period
    found = {
        "north": missed["surge"] * cos - missed["sway"] * sin,
        "east": missed["surge"] * sin + missed["sway"] * cos,
        "yaw": missed["yaw_rate"],
    }
    return {name: plan.push[name] + gain * found[name] for name in plan.push}


solved = partial(jax.jit, static_argnums=0)(solve)
"""`solve`, compiled once for each structure and horizon."""
