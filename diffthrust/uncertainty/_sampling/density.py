"""The logarithm of the posterior density of a fit's parameters, compiled."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from diffthrust._support._running.programs import program
from diffthrust.estimation._likelihood import apart, named_values, residuals
from diffthrust.estimation._numbers import ProblemNumbers
from diffthrust.estimation._problem import Layout


class DensityShape(NamedTuple):
    """The static part of the program: layout, and channels whose noise level is sampled."""

    layout: Layout
    sampled: tuple[int, ...]


def log_density(shape: DensityShape, data: Any, x: Any) -> tuple[Any, Any]:
    """Logarithm of the posterior density at coordinates ``x``, ``(d,)``, without constants.

    Returns:
        The density, minus infinity outside the bounds or if the simulation fails; and the noise
        level by channel, ``(C,)``: for an unknown level of the Gaussian law, the root mean square
        of the residuals.
    """
    layout, count = shape.layout, data["moved"].shape[0]
    z = data["base"].at[data["moved"]].set(x[:count])
    numbers: ProblemNumbers = data["numbers"]
    if shape.sampled:
        where = jnp.asarray(shape.sampled)
        noise = jnp.asarray(numbers.noise).at[where].set(jnp.exp(x[count:]))
        numbers = replace(numbers, noise=noise)
        layout = replace(layout, known_noise=(True,) * len(layout.channels))
    shared, starts = numbers.split(z, len(layout.free))
    rests = []
    for index, pairs in enumerate(zip(numbers.batches, starts, strict=True)):

        def residuals_of(pair: Any, index: int = index) -> Any:
            return residuals(layout, index, numbers, pair[0], shared, pair[1])

        # a loop of one iteration would keep the compiler from fusing
        if pairs[0].time.shape[0] == 1:
            rests.append(residuals_of(jax.tree.map(lambda a: a[0], pairs))[None])
        else:
            rests.append(jax.lax.map(residuals_of, pairs))
    cost, sigma = layout.cost(numbers, rests)
    cost += apart(layout, numbers, starts)
    values = named_values(layout, numbers, shared)
    for name, (mean, std) in numbers.prior.items():
        cost += 0.5 * ((values[name] - mean) / std) ** 2
        if layout.transforms[layout.free.index(name)] == "log":
            # Jacobian: the prior is a density in the value, the coordinate its logarithm
            cost -= jnp.log(values[name])
    # the likelihood uses the level of the innovations; it is converted to that of the noise
    sigma = sigma / layout.likelihood.noise.levels(layout.channels, numbers, values)
    inside = jnp.all((x >= data["low"]) & (x <= data["high"]))
    return jnp.where(inside & jnp.isfinite(cost), -cost, -jnp.inf), sigma


@program(1)
def log_densities(shape: DensityShape, numbers: tuple[Any, Any]) -> tuple[Any, Any]:
    """`log_density` of many points ``(W, d)``, compiled once for each number of points."""
    data, points = numbers
    return jax.vmap(partial(log_density, shape, data))(points)
