"""Full simulation of a loop around a model: the states of both, by the library's integrator."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.transfer import Transfer
from diffthrust.cycles._model_element import ModelElement
from diffthrust.cycles._oscillation import Harmonics
from diffthrust.cycles._run_static import BEYOND, STEPS, Course, states_on
from diffthrust.simulation._integrate import integrate


def simulated_states(
    transfer: Transfer,
    element: ModelElement,
    cycle: Harmonics,
    states: np.ndarray,
    factors: tuple[float, ...],
    periods: int,
) -> list[Course]:
    """Simulate from starts on a cycle, made larger or smaller.

    A dead time of the linear part is replaced by an all-pass of sixth order.

    Args:
        transfer: the linear part.
        element: the model.
        cycle: where to start.
        states: coefficients of the model's states on the cycle, complex ``(states, m)``.
        factors: on the cycle's size at the start, one simulation for each.
        periods: how long, in periods of the cycle.

    Raises:
        InputError: both the linear part and the model pass a step at once.
    """
    plain = transfer.rational()
    linear = states_on(plain, cycle)
    own = states.sum(axis=1).real
    a, b, c, d = plain.state_space()
    if d and passes(element):
        raise InputError(
            "Both the linear part and the model pass a step of their input at once: the loop has "
            "no states at that instant to be simulated from.",
            "Add the fastest lag of the plant to the linear part.",
        )
    count = periods * STEPS
    step = cycle.oscillation.period / STEPS
    starts = np.array(factors)[:, None] * np.concatenate([linear, own])[None, :]
    matrices = {"a": a, "b": b, "c": c, "d": np.asarray(d)}
    arrays = {name: jnp.asarray(value) for name, value in matrices.items()}
    e, y = _marched(element, count, element.values, arrays, step, jnp.asarray(starts))
    limit = BEYOND * cycle.oscillation.peak
    time = step * np.arange(count + 1)
    return [_cut(time, *row, limit) for row in zip(np.asarray(e), np.asarray(y), strict=True)]


def _cut(time: np.ndarray, e: np.ndarray, y: np.ndarray, limit: float) -> Course:
    gone = np.flatnonzero(~(np.abs(e) <= limit))
    end = int(gone[0]) if gone.size else e.size
    return Course(time[:end], e[:end], y[:end], bool(gone.size))


def passes(element: ModelElement) -> bool:
    """Whether a step at the model's input shows at once at its output."""
    states = {name: jnp.asarray(0.7 + 0.1 * i) for i, name in enumerate(element.states)}

    def output(command: Any) -> Any:
        return element.evaluate(element.values, states, command, jnp.asarray(0.0))[1]

    return bool(jnp.any(jax.grad(lambda u: jnp.sum(output(u)))(jnp.asarray(0.5)) != 0.0))


@partial(jax.jit, static_argnums=(0, 1))
def _marched(
    element: ModelElement, count: int, values: Any, linear: Any, step: Any, starts: Any
) -> Any:
    names = element.states
    order = linear["b"].shape[0]
    lengths = jnp.full(count, 1.0) * step
    clock = step * jnp.arange(count + 1.0)

    def split(x: Mapping[str, Any]) -> tuple[list[Any], dict[str, Any]]:
        return [x[f"linear.{i}"] for i in range(order)], {name: x[name] for name in names}

    def loop(x: Mapping[str, Any], time: Any) -> tuple[dict[str, Any], Any, Any]:
        z, own = split(x)
        passed = sum((linear["c"][i] * z[i] for i in range(order)), 0.0 * time)
        # where the linear part passes its input at once, the output does not read the command
        _, ahead = element.evaluate(values, own, -passed, time)
        command = -(passed + linear["d"] * ahead)
        rates, y = element.evaluate(values, own, command, time)
        for i in range(order):
            row = sum((linear["a"][i, k] * z[k] for k in range(order)), linear["b"][i] * y)
            rates[f"linear.{i}"] = row
        return rates, command, y

    def one(start: Any) -> Any:
        begin = {f"linear.{i}": start[i] for i in range(order)}
        begin |= {name: start[order + i] for i, name in enumerate(names)}
        path = integrate(
            lambda x, u: loop(x, u["time"])[0],
            begin,
            {"time": (clock[:-1], clock[1:])},
            lengths,
            {},
            uniform=True,
        )
        _, command, y = loop(path, clock)
        return command, jnp.broadcast_to(y, clock.shape)

    return jax.vmap(one)(starts)


def course_of(
    transfer: Transfer,
    element: ModelElement,
    start: Mapping[str, float],
    output: float,
    period: float,
    duration: float,
) -> Course:
    """Simulate a loop from given states of the model and a constant output of the linear part.

    Args:
        transfer: the linear part.
        element: the model.
        start: states of the model by name; zero where not named.
        output: what leaves the linear part at the start, at rest.
        period: an oscillation's period [s], which sets the step.
        duration: how long [s].
    """
    plain = transfer.rational()
    a, b, c, d = plain.state_space()
    rows = np.vstack([a, c[None, :]])
    z = np.linalg.lstsq(rows, np.append(0.0 * b, output), rcond=None)[0]
    own = [start.get(name, 0.0) for name in element.states]
    count = math.ceil(duration / period) * STEPS
    matrices = {"a": a, "b": b, "c": c, "d": np.asarray(d)}
    arrays = {name: jnp.asarray(value) for name, value in matrices.items()}
    begin = jnp.asarray(np.concatenate([z, own]))[None, :]
    e, y = _marched(element, count, element.values, arrays, period / STEPS, begin)
    time = period / STEPS * np.arange(count + 1)
    return _cut(time, np.asarray(e)[0], np.asarray(y)[0], 1e12 * max(1.0, abs(output)))
