"""Where a model settles under inputs that stay as they are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.programs import program
from diffthrust._support.errors import InputError
from diffthrust.models._base.model import Model
from diffthrust.simulation._trajectory import Grid, Key, bare, trajectory

_STEPS = 1000
"""Operations of integration between two looks at whether the model has settled."""
_LOOKS = 60
"""Looks after which an output that has not settled is given up."""
_TOGETHER = 64
"""Sets of inputs are simulated in multiples of this number, so that few programs are compiled."""
_SETTLED = 1e-10
"""An output has settled where it moves less than this share of all that is found."""


def steady_outputs(
    model: Model, inputs: Mapping[str, np.ndarray], outputs: tuple[str, ...]
) -> np.ndarray:
    """The outputs, ``(outputs, n)``, that a model settles at from rest, under constant inputs.

    Inputs are ``(n,)`` each, all in the model's units; effects of sensors are left out.
    """
    plain = bare(model)
    step = min(0.02, 4 * model.time_scales[0] or 0.02)
    for _ in range(4):
        settled = _run(plain, inputs, outputs, step)
        if settled is not None:
            return settled
        step /= 4  # friction and small inertias are stiff
    raise InputError(
        f"The model '{model}' does not settle under constant inputs.",
        "A table needs a steady state; export the model itself, to python or to c.",
    )


_Static = tuple[Key, Grid, tuple[str, ...], float]


@program(1)
def _on(static: _Static, numbers: Any) -> Any:
    """The outputs and the states after a number of steps."""
    key, grid, names, step = static
    values, start, inputs, begin = numbers
    time = start + step * jnp.arange(_STEPS + 1.0)

    def settled(value: Mapping[str, jax.Array], states: Mapping[str, jax.Array]) -> Any:
        series = {name: jnp.full(time.shape, v) for name, v in value.items()}
        model = key.model.bind(values)
        outputs, path = trajectory(model, grid, time, series, states, {})
        last = jnp.stack([outputs[name][-1] for name in names])
        return last, {name: p[-1] for name, p in path.items()}

    return jax.vmap(settled)(inputs, begin)


def _run(
    model: Model, inputs: Mapping[str, np.ndarray], outputs: tuple[str, ...], step: float
) -> np.ndarray | None:
    """The steady outputs with steps of this length, or None where they do not settle."""
    count = len(next(iter(inputs.values())))
    padded = {n: np.pad(v, (0, -count % _TOGETHER), "edge") for n, v in inputs.items()}
    size = len(next(iter(padded.values())))
    grid = Grid(tuple((name, "zero") for name in sorted(inputs)), uniform=True)
    static = (Key(model), grid, outputs, step)
    values = {name: np.float64(p.value) for name, p in model.parameters.items()}
    begin = {name: np.zeros(size) for name in model.states if name not in inputs}
    last, states = _on(static, (values, 0.0, padded, begin))
    for look in range(1, _LOOKS if states else 1):
        now, states = _on(static, (values, look * _STEPS * step, padded, states))
        if not np.all(np.isfinite(now)):
            return None
        span = float(np.max(np.abs(now))) or 1.0
        if float(np.max(np.abs(now - last))) <= _SETTLED * span:
            return np.asarray(now)[:count].T
        last = now
    return None if states else np.asarray(last)[:count].T
