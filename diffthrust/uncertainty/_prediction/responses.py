"""Step responses of a model: steady output and response time.

The model is simulated with its effects. Each step size has a separate time base, some sixteen
response times long, found with the median draw; sizes, durations and draws are only numbers, so one
compilation serves all.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.programs import program
from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.models._base.model import Model
from diffthrust.simulation._trajectory import Grid, Key, bare, trajectory
from diffthrust.uncertainty._prediction.draws import Draws

_SAMPLES = 800
"""Samples of one response."""
_LONG = 16.0
"""Length of a response in multiples of its time to 63 %."""
_SETTLED = 1e-3
"""A response has settled if its last fifth varies by at most this share of it."""
_TRIALS = 40
"""Most durations tried before a model counts as not settling."""


class Responses(NamedTuple):
    """Responses by draw and size of step, ``(n, m)``."""

    steady: np.ndarray
    """The output at the end."""
    time: np.ndarray
    """Time after the step [s] at which 1 - 1/e of the change is covered; infinite without any."""
    unsettled: float
    """Share of draws not settled at the end, at the worst size."""


def responses(
    draws: Draws, sizes: np.ndarray, output: str, inputs: Mapping[str, float]
) -> Responses:
    """Simulate steps of the model's input from zero and rest, to each size, for every draw.

    The output is without effects of its sensor; ``inputs`` are constants that the model or its
    effects read.
    """
    model = bare(draws.model)
    drive = _drive(model, inputs)
    if output not in model.outputs:
        raise InputError(
            f"quantities: '{model}' puts out no {output!r}, but {listing(model.outputs)}.",
            "Correct the response.",
        )
    grid = Grid(tuple((n, "zero") for n in sorted({drive, *inputs})))
    static = Key(model), grid, (drive, output)
    constants = _numbers(inputs)

    def run(values: Mapping[str, float], ends: np.ndarray) -> tuple[np.ndarray, ...]:
        numbers = _numbers(values), jnp.asarray(ends), jnp.asarray(sizes), constants
        return tuple(np.asarray(column) for column in step_responses(*static, *numbers))

    ends = _durations(model, run, {n: float(np.median(v)) for n, v in draws.values.items()}, sizes)
    rows = [run({n: v[i] for n, v in draws.values.items()}, ends) for i in range(len(draws))]
    steady, time, moving = (np.stack(column) for column in zip(*rows, strict=True))
    unsettled = ~(moving <= 3 * _SETTLED)
    return Responses(steady, time, float(unsettled.mean(axis=0).max()))


def _numbers(values: Mapping[str, float]) -> dict[str, Any]:
    return {name: jnp.asarray(float(value)) for name, value in values.items()}


def _drive(model: Model, inputs: Mapping[str, float]) -> str:
    free = [name for name in model.inputs if name not in inputs]
    if len(free) != 1 or not model.states:
        raise InputError(
            f"quantities: step responses need a model with states and one input; '{model}' has "
            f"the inputs {listing(model.inputs)}.",
            "Give constant values of the other inputs, inputs={'name': value}, or leave them out.",
        )
    needed = [n for e in model.effects for n in e.needs if n not in inputs and n != free[0]]
    if needed:
        raise InputError(
            f"quantities: the effects of '{model}' read {listing(needed)}, which has no value.",
            f"Give one: inputs={{'{needed[0]}': ...}}.",
        )
    available = {**model.inputs, **model.optional_inputs}
    available |= {n: "" for e in model.effects for n in e.needs}
    unknown = [n for n in inputs if n not in available]
    if unknown:
        raise InputError(
            f"quantities: '{model}' has no input {listing(unknown)}; it has {listing(available)}.",
            "Correct the names under inputs.",
        )
    return free[0]


def _durations(model: Model, run: Any, values: Mapping[str, float], sizes: Any) -> np.ndarray:
    """Duration of the response to each step size [s], ``(m,)``."""
    slowest = model.time_scales[1]
    ends = np.full(sizes.size, slowest if np.isfinite(slowest) else 10.0)
    least, ready = np.zeros(sizes.size), np.zeros(sizes.size, bool)
    for _ in range(_TRIALS):
        steady, time, moving = run(values, ends)
        wanted = ends.copy()
        for j in range(sizes.size):
            if not np.isfinite(steady[j]):  # the integrator's step is too long
                wanted[j] = ends[j] / 8
            elif not np.isfinite(time[j]) and moving[j] == 0:  # nothing moves
                ready[j] = True
            elif not moving[j] <= _SETTLED:
                # a duration at which it had not settled is never tried again: the search cannot
                # swing
                least[j] = wanted[j] = 2 * ends[j]
            else:
                # the time to 63 % is rough where few samples cover it: at most a factor of 30 at
                # once
                wanted[j] = max(_LONG * time[j], least[j], ends[j] / 30)
                ready[j] = wanted[j] > 0.6 * ends[j] and wanted[j] < 1.6 * ends[j]
        if ready.all():
            return ends
        ends = np.where(ready, ends, wanted)
    raise InputError(
        f"quantities: the response of '{model}' does not settle after steps to "
        f"{', '.join(f'{s:g}' for s in sizes[~ready][:3])}.",
        "Look at another response, or at other sizes.",
    )


@program(3)
def step_responses(
    key: Key, grid: Grid, names: tuple[str, str], values: Any, ends: Any, sizes: Any, constants: Any
) -> Any:
    drive, output = names
    model = key.model.bind(values)

    def respond(end: Any, size: Any) -> Any:
        # one sample before the step, at rest: inputs are held, so the step acts from time zero on
        time = end * (jnp.arange(-1.0, _SAMPLES - 1.0) / (_SAMPLES - 2.0))
        after = jnp.arange(_SAMPLES) >= 1
        series = {n: jnp.full(_SAMPLES, v) for n, v in constants.items()}
        series[drive] = jnp.where(after, size, 0.0)
        outputs, _ = trajectory(model, grid, time, series, {}, {})
        y = outputs[output]
        last, first = y[-1], y[1]
        way = last - first
        still = jnp.abs(way) <= 1e-9 * jnp.max(jnp.abs(y))
        tail = y[-(_SAMPLES // 5) :]
        share = jnp.where(still, 0.0, (jnp.max(tail) - jnp.min(tail)) / jnp.abs(way))
        return last, jnp.where(still, jnp.inf, _near(time, (last - y) / way)), share

    return jax.vmap(respond)(ends, sizes)


def _near(time: Any, remaining: Any) -> Any:
    """Time at which the remaining share falls below 1/e, interpolated exponentially."""
    below = (remaining <= jnp.exp(-1.0)) & (jnp.arange(remaining.size) >= 2)
    k = jnp.argmax(below)
    a, b = remaining[k - 1], remaining[k]
    positive = (a > 0) & (b > 0)
    # safe arguments for the branch that is not taken: `where` computes both
    top, bottom = jnp.where(positive, a, 1.0), jnp.where(positive, b, 0.5)
    curved = (jnp.log(top) + 1.0) / (jnp.log(top) - jnp.log(bottom))
    fraction = jnp.where(positive, curved, (a - jnp.exp(-1.0)) / (a - b))
    return jnp.where(jnp.any(below), time[k - 1] + fraction * (time[k] - time[k - 1]), jnp.inf)
