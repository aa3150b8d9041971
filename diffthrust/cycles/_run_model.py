"""Full simulation of a loop around a model: the states of both, by the library's integrator."""

from __future__ import annotations

import math
from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diffthrust._support._running.programs import program
from diffthrust._support.errors import InputError
from diffthrust._support.transfer import Transfer
from diffthrust.cycles._balance_model import ElementEquations
from diffthrust.cycles._oscillation import CycleSeries, LoopCourse
from diffthrust.cycles._run_static import BEYOND, STEPS_A_PERIOD, states_on
from diffthrust.models._base.signals import Relaxing
from diffthrust.simulation._integrate import integrate


def simulated_states(
    transfer: Transfer,
    element: ElementEquations,
    cycle: CycleSeries,
    states: np.ndarray,
    factors: tuple[float, ...],
    periods: int,
) -> list[LoopCourse]:
    """Simulate from starts on a cycle, made larger or smaller.

    A dead time of the linear part is replaced by an all-pass of sixth order.

    Args:
        transfer: the linear part.
        element: the model.
        cycle: where to start.
        states: coefficients of the model's states on the cycle, complex ``(states, m)``.
        factors: on the cycle's size at the start, one simulation for each.
        periods: how long, in periods of the cycle.
    """
    plain = transfer.rational()
    if plain.direct and _passes_at_once(element):
        raise InputError(
            "Both the linear part and the model pass a step of their input at once: the loop has "
            "no states at that instant to be simulated from.",
            "Add the fastest lag of the plant to the linear part.",
        )
    on = np.concatenate([states_on(plain, cycle), states.sum(axis=1).real])
    step = cycle.oscillation.period / STEPS_A_PERIOD
    starts = np.array(factors)[:, None] * on[None, :]
    limit = BEYOND * cycle.oscillation.peak
    return _courses(plain, element, starts, step, periods * STEPS_A_PERIOD, limit)


def course_of(
    transfer: Transfer, element: ElementEquations, output: float, period: float, duration: float
) -> LoopCourse:
    """Simulate a loop from a model's states at zero and a constant output of the linear part.

    Args:
        transfer: the linear part.
        element: the model.
        output: what leaves the linear part at the start, at rest.
        period: an oscillation's period [s], which sets the step.
        duration: how long [s].
    """
    plain = transfer.rational()
    a, b, c, _ = plain.state_space()
    rows = np.vstack([a, c[None, :]])
    # a state at rest (A z = 0) with this output; an integrator has one, others come nearest to it
    z = np.linalg.lstsq(rows, np.append(0.0 * b, output), rcond=None)[0]
    start = np.concatenate([z, np.zeros(len(element.states))])
    count = math.ceil(duration / period) * STEPS_A_PERIOD
    limit = 1e12 * max(1.0, abs(output))
    return _courses(plain, element, start[None, :], period / STEPS_A_PERIOD, count, limit)[0]


def _courses(
    plain: Transfer,
    element: ElementEquations,
    starts: np.ndarray,
    step: float,
    count: int,
    limit: float,
) -> list[LoopCourse]:
    """From states of the linear part and the model, ``(starts, states)``, up to a limit."""
    matrices = zip("abcd", plain.state_space(), strict=True)
    linear = {name: jnp.asarray(value) for name, value in matrices}
    e, y = _marched(element, count, element.values, linear, step, jnp.asarray(starts))
    time = step * np.arange(count + 1)
    return [_cut(time, *row, limit) for row in zip(np.asarray(e), np.asarray(y), strict=True)]


def _cut(time: np.ndarray, e: np.ndarray, y: np.ndarray, limit: float) -> LoopCourse:
    # written so that NaN counts as outside
    outside = np.flatnonzero(~(np.abs(e) <= limit))
    end = int(outside[0]) if outside.size else e.size
    return LoopCourse(time[:end], e[:end], y[:end], bool(outside.size))


def _passes_at_once(element: ElementEquations) -> bool:
    """Whether a step at the model's input shows at once at its output."""
    # no special values: at zero a slope may vanish by chance, as that of speed |speed| does
    states = {name: jnp.asarray(0.7 + 0.1 * i) for i, name in enumerate(element.states)}

    def output(command: Array) -> Array:
        return element.evaluate(element.values, states, command, jnp.asarray(0.0))[1]

    return bool(jnp.any(jax.grad(lambda u: jnp.sum(output(u)))(jnp.asarray(0.5)) != 0.0))


@program(2)
def _marched(
    element: ElementEquations,
    count: int,
    values: Mapping[str, Array],
    linear: Mapping[str, Array],
    step: float,
    starts: Float[Array, "starts states"],
) -> tuple[Float[Array, "starts time"], Float[Array, "starts time"]]:
    names = element.states
    order = linear["b"].shape[0]
    lengths = jnp.full(count, 1.0) * step
    clock = step * jnp.arange(count + 1.0)

    def split(x: Mapping[str, Array]) -> tuple[list[Array], dict[str, Array]]:
        return [x[f"linear.{i}"] for i in range(order)], {name: x[name] for name in names}

    def loop(
        x: Mapping[str, Array], time: Array
    ) -> tuple[dict[str, Array | Relaxing], Array, Array]:
        z, instants = split(x)
        passed = sum((linear["c"][i] * z[i] for i in range(order)), 0.0 * time)
        # where the linear part passes its input at once, the output does not read the command
        _, ahead = element.evaluate(values, instants, -passed, time)
        command = -(passed + linear["d"] * ahead)
        rates, y = element.evaluate(values, instants, command, time)
        for i in range(order):
            row = sum((linear["a"][i, k] * z[k] for k in range(order)), linear["b"][i] * y)
            rates[f"linear.{i}"] = row
        return rates, command, y

    def one(start: Float[Array, " states"]) -> tuple[Array, Array]:
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
