"""Simulate a rival model under designs, and compare it with target outputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from diffthrust._support._running.programs import program
from diffthrust.experiments._rivals import Rival
from diffthrust.simulation._trajectory import Grid, Key, trajectory

InputSeries = Mapping[str, Float[np.ndarray, "designs time"]]
CHUNK = 16
"""Designs per batch, whatever their number: one compilation serves all."""


@dataclass(frozen=True)
class Conditions:
    """Conditions common to all designs.

    Args:
        time: sample instants [s], ``(T,)``.
        noise: standard deviation of each measured channel.
        unsigned: channels whose sensor reports the absolute value.
        substeps: integrator steps per sample.
        correlation: of the noise from one sample to the next.
    """

    time: np.ndarray
    noise: Mapping[str, float]
    unsigned: frozenset[str]
    substeps: int
    correlation: float


class _Layout(NamedTuple):
    """The static part, which fixes the compiled code."""

    key: Key
    grid: Grid
    free: tuple[str, ...]
    transforms: tuple[str, ...]
    channels: tuple[str, ...]
    unsigned: frozenset[str]


class Confronted(NamedTuple):
    """A model compared with targets: outputs, cost, gradient and Gram matrix for each design.

    Args:
        outputs: of the model.
        cost: sum of squared whitened differences; infinite where a simulation failed.
        slope: J' r.
        gram: J' J.
    """

    outputs: Float[np.ndarray, "designs channels time"]
    cost: Float[np.ndarray, " designs"]
    slope: Float[np.ndarray, "designs free"]
    gram: Float[np.ndarray, "designs free free"]


def against(
    rival: Rival,
    conditions: Conditions,
    inputs: InputSeries,
    z: Float[np.ndarray, "designs free"],
    target: Float[np.ndarray, "designs channels time"],
) -> Confronted:
    """Simulate a rival under every design, by coordinates for each, and compare it to targets."""
    named = rival.model.parameters
    hold = tuple((name, "zero") for name in sorted(inputs))
    layout = _Layout(
        Key(rival.model.bind({})),
        Grid(hold, conditions.substeps),
        rival.free,
        tuple(named[n].transform for n in rival.free),
        tuple(conditions.noise),
        conditions.unsigned,
    )
    arrays = {
        "values": {n: np.asarray(p.value, float) for n, p in named.items()},
        "scales": np.array([named[n].scale for n in rival.free]),
        "time": conditions.time,
        "sigma": np.array(list(conditions.noise.values())),
        "correlation": np.asarray(conditions.correlation, float),
    }
    count, passes = z.shape[0], []
    for begin in range(0, count, CHUNK):
        # the last chunk is filled up with its last design
        rows = np.minimum(np.arange(begin, begin + CHUNK), count - 1)
        series = {name: values[rows] for name, values in inputs.items()}
        chunk = _chunk(layout, arrays, series, z[rows], target[rows])
        passes.append([np.array(array)[: count - begin] for array in chunk])
    outputs, cost, slope, gram = (np.concatenate(chunks) for chunks in zip(*passes, strict=True))
    fine = np.isfinite(cost) & np.isfinite(gram).all(axis=(1, 2)) & np.isfinite(slope).all(axis=1)
    return Confronted(outputs, np.where(fine, cost, np.inf), slope, gram)


@program(1)
def _chunk(layout: _Layout, arrays: Any, inputs: Any, z: Any, target: Any) -> tuple[Any, ...]:
    def confront(design: Any) -> tuple[Any, ...]:
        series, point, goal = design
        steps = jnp.eye(point.shape[0])

        def fn(p: Any) -> Any:
            return _outputs(layout, arrays, series, p)

        if layout.free:
            y, slopes = jax.vmap(lambda v: jax.jvp(fn, (point,), (v,)), out_axes=(None, 0))(steps)
        else:
            y = fn(point)
            slopes = jnp.zeros((0, *y.shape))
        residual = _white(arrays, goal - y).reshape(-1)
        rows = jax.vmap(partial(_white, arrays))(slopes).reshape(len(layout.free), residual.size)
        return y, residual @ residual, rows @ residual, rows @ rows.T

    # one after the other: vmap over whole trajectories leaves the processor's cache (256 of them
    # took 397 ms, mapped 144)
    return jax.lax.map(confront, (inputs, z, target))


def _outputs(layout: _Layout, arrays: Any, inputs: Any, z: Any) -> Any:
    values = dict(arrays["values"])
    for i, (name, transform) in enumerate(zip(layout.free, layout.transforms, strict=True)):
        values[name] = jnp.exp(z[i]) if transform == "log" else z[i] * arrays["scales"][i]
    model = layout.key.model.bind(values)
    modelled, _ = trajectory(model, layout.grid, arrays["time"], inputs, {}, {})
    rows = [jnp.abs(modelled[n]) if n in layout.unsigned else modelled[n] for n in layout.channels]
    return jnp.stack(rows)


def _white(arrays: Any, series: Any) -> Any:
    """Whiten series ``(C, T)`` with first-order noise, to unit variance."""
    phi = arrays["correlation"]
    later = (series[:, 1:] - phi * series[:, :-1]) / jnp.sqrt(1.0 - phi**2)
    return jnp.concatenate([series[:, :1], later], axis=1) / arrays["sigma"][:, None]


def outputs_of(
    rival: Rival, conditions: Conditions, inputs: InputSeries
) -> Float[np.ndarray, "designs channels time"]:
    """Predictions of a rival with its estimated parameters."""
    count = next(iter(inputs.values())).shape[0]
    blank = np.zeros((count, len(conditions.noise), conditions.time.size))
    return against(rival, conditions, inputs, np.tile(rival.start, (count, 1)), blank).outputs
