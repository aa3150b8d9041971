"""The likelihoods, with their gradient and information by one forward-mode pass.

That of the simulation error, and that of the innovations where the layout has an observer.

A likelihood turns coordinates into a `Quadratic`: its negative logarithm, the gradient, and the
Gauss-Newton (Fisher) information. That is all the optimiser and the checks see, so another
likelihood takes its place by returning the same three.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust.estimation._ar1 import levels, name_of, whitened
from diffthrust.estimation._gram import gram
from diffthrust.estimation._numbers import Batch, Numbers
from diffthrust.estimation._observer import Limits, innovations
from diffthrust.estimation._problem import Layout, Problem
from diffthrust.simulation._simulate import trajectory

TAIL = 4.0
"""Degrees of freedom of the Student-t law behind ``loss="student_t"``."""


class Quadratic(NamedTuple):
    """A likelihood near some coordinates.

    Args:
        cost: negative log-likelihood without constants; infinite where the simulation fails.
        gradient: of the cost, ``(n,)``.
        information: Gauss-Newton approximation of the cost's Hessian, ``(n, n)``.
        energy: weighted sum of squared residuals, which sets the scale of the gradient.
        sigma: noise standard deviation of each channel, known or estimated, ``(C,)``.
        scores: the gradient by blocks of time, ``(n, blocks)``, without priors: its scatter tells
            how sure the gradient is, however the residuals are correlated within a block. Only of
            layouts with a width, which are made to be tested: for others there are no blocks.
    """

    cost: Any
    gradient: Any
    information: Any
    energy: Any
    sigma: Any
    scores: Any


BLOCKS = 48
"""Blocks of time into which each log is divided for the scatter of the gradient."""


def named_values(layout: Layout, numbers: Numbers, z: Any) -> dict[str, Any]:
    """Parameter values at coordinates; traceable twin of `Problem.values`."""
    moved: Any = None
    if layout.width is not None:
        spread = jnp.zeros(len(layout.free) + 1)
        moved = spread.at[numbers.chosen].set(1.0) > 0
        z = spread.at[numbers.chosen].set(z)
    free = {}
    for i, (name, transform) in enumerate(zip(layout.free, layout.transforms, strict=True)):
        free[name] = jnp.exp(z[i]) if transform == "log" else z[i] * numbers.scales[i]
        if layout.width is not None:
            free[name] = jnp.where(moved[i], free[name], numbers.values[name])
    return {**numbers.values, **free}


def residuals(layout: Layout, index: int, numbers: Numbers, log: Batch, z: Any, start: Any) -> Any:
    """Measured minus simulated or predicted, ``(C, T)``; zero where nothing was measured.

    Of noise that lasts, what is new in each sample.
    """
    grid = layout.grids[index]
    values = named_values(layout, numbers, z)
    model = layout.key.model.bind(values)
    states = {**log.held, **{n: start[i] for i, n in enumerate(layout.starts)}}
    if layout.observer is not None:
        limits = Limits(numbers.clip, numbers.reach)
        return innovations(layout.observer, model, grid, values, log, states, limits)[0]
    anew = {name: (restart.value, restart.unsigned) for name, restart in log.restarts.items()}
    outputs, _ = trajectory(model, grid, log.time, log.inputs, states, anew)
    rows: list[Any] = []
    new: Any = levels(layout.channels, numbers, values) if layout.lasting else None
    for i, name in enumerate(layout.channels):
        modelled, measured = outputs[name], log.measured[i]
        modelled = jnp.where(log.unsigned[i], jnp.abs(modelled), modelled)
        rest = jnp.where(jnp.isnan(measured), 0.0, measured) - modelled
        if name in model.angles:
            rest = rest - 2 * jnp.pi * jnp.round(rest / (2 * jnp.pi))
        rest = jnp.where(jnp.isnan(measured), 0.0, rest)
        if layout.lasting:
            kept, seen = values[name_of(name)], ~jnp.isnan(measured)
            rest = whitened(rest, seen, log.links.past[i], log.links.gap[i], kept, new[i])
        rows.append(rest)
    return jnp.stack(rows)


def errors_at(problem: Problem, z: np.ndarray) -> list[dict[str, np.ndarray]]:
    """The residuals that a likelihood sums, ``(T,)`` by log and channel; NaN where not measured."""
    done = _errors(problem.layout, problem.numbers, jnp.asarray(z))
    found: dict[int, dict[str, np.ndarray]] = {}
    for rests, batch, indices in zip(done, problem.numbers.batches, problem.order, strict=True):
        rests = np.where(np.isnan(batch.measured), np.nan, rests)
        for row, index in enumerate(indices):
            own = rests[row, :, : len(problem.logs[index])]
            found[index] = dict(zip(problem.layout.channels, own, strict=True))
    return [found[index] for index in range(len(problem.logs))]


@partial(jax.jit, static_argnums=0)
def _errors(layout: Layout, numbers: Numbers, z: Any) -> list[Any]:
    shared, starts = numbers.split(z, layout.shared)
    out = []
    for index, pairs in enumerate(zip(numbers.batches, starts, strict=True)):

        def one(pair: Any, index: int = index) -> Any:
            return residuals(layout, index, numbers, pair[0], shared, pair[1])

        out.append(jax.lax.map(one, pairs))
    return out


def noise_levels(problem: Problem, z: np.ndarray, sigma: np.ndarray) -> dict[str, float]:
    """Standard deviation of each channel's noise, from the levels that a likelihood works with."""
    channels = problem.layout.channels
    if problem.layout.lasting:
        sigma = sigma / np.asarray(levels(channels, problem.numbers, problem.values(z)))
    return dict(zip(channels, map(float, sigma), strict=True))


def _with_jacobian(
    layout: Layout, index: int, numbers: Numbers, batch: Batch, z: Any
) -> tuple[Any, Any]:
    """Residuals ``(B, C, T)`` and their derivatives ``(B, n + m, C, T)`` of one batch of logs."""
    size = z.shape[0] + len(layout.starts)

    def one(log: Batch) -> tuple[Any, Any]:
        point = jnp.concatenate([z, log.start])

        def fn(p: Any) -> Any:
            return residuals(layout, index, numbers, log, p[: z.shape[0]], p[z.shape[0] :])

        def push(tangent: Any) -> tuple[Any, Any]:
            return jax.jvp(fn, (point,), (tangent,))

        return jax.vmap(push, out_axes=(None, 0))(jnp.eye(size))

    if batch.time.shape[0] == 1:
        first = jax.tree.map(lambda a: a[0], batch)
        return jax.tree.map(lambda a: a[None], one(first))
    return jax.lax.map(one, batch)


def jacobians(layout: Layout, numbers: Numbers, z: Any) -> list[tuple[Any, Any]]:
    """By batch residuals ``(B, C, T)`` and their derivatives ``(B, n + m, C, T)``."""
    shared, starts = numbers.split(z, layout.shared)
    return [
        _with_jacobian(layout, index, numbers, replace(batch, start=start), shared)
        for index, (batch, start) in enumerate(zip(numbers.batches, starts, strict=True))
    ]


def evaluate(layout: Layout, numbers: Numbers, z: Any) -> Quadratic:
    """Likelihood of all logs at coordinates ``z``: parameters, then initial states."""
    passes = jacobians(layout, numbers, z)
    cost, sigma = noise_of(layout, numbers, [r for r, _ in passes])
    return _assemble(layout, numbers, z[: layout.shared], passes, cost, sigma)


def noise_of(layout: Layout, numbers: Numbers, rests: list[Any]) -> tuple[Any, Any]:
    """Negative log-likelihood, and the noise level of each channel.

    Where the level is not known it is estimated, in closed form for the Gaussian law and as the
    fixed point of its reweighting for the Student-t law.
    """
    counts = numbers.counts
    squares = sum(jnp.sum(r**2, axis=(0, 2)) for r in rests)
    pooled = jnp.sqrt(squares / counts + numbers.floor)
    known = jnp.asarray(layout.known_noise)
    if layout.loss == "gaussian":
        sigma = jnp.where(known, numbers.noise, pooled)
        cost = jnp.where(known, 0.5 * squares / sigma**2, counts * jnp.log(pooled))
        return jnp.sum(cost), sigma
    sigma = jnp.where(known, numbers.noise, pooled)

    def again(_: int, s: Any) -> Any:
        weighted = sum(jnp.sum(r**2 * weights(layout, r, s), axis=(0, 2)) for r in rests)
        return jnp.where(known, s, jnp.sqrt(weighted / counts + numbers.floor))

    sigma = jax.lax.fori_loop(0, 60, again, sigma)
    scaled = sum(
        jnp.sum(jnp.log1p(r**2 / (TAIL * sigma[None, :, None] ** 2)), axis=(0, 2)) for r in rests
    )
    return jnp.sum(0.5 * (TAIL + 1) * scaled + counts * jnp.log(sigma)), sigma


def weights(layout: Layout, rest: Any, sigma: Any) -> Any:
    if layout.loss == "gaussian":
        return jnp.ones_like(rest)
    return (TAIL + 1) / (TAIL + rest**2 / sigma[None, :, None] ** 2)


def _assemble(
    layout: Layout, numbers: Numbers, z: Any, passes: Any, cost: Any, sigma: Any
) -> Quadratic:
    n, m = layout.shared, len(layout.starts)
    gradient, information, energy = jnp.zeros(n), jnp.zeros((n, n)), jnp.zeros(())
    local, cross, own, scores = [], [], [], []
    for rest, jacobian in passes:
        root = jnp.sqrt(weights(layout, rest, sigma)) / sigma[None, :, None]
        rest, jacobian = rest * root, jacobian * root[:, None]
        products = gram([*jnp.moveaxis(jacobian, 1, 0), rest])
        slope = products[:, :-1, -1]
        gradient += slope[:, :n].sum(0)
        information += products[:, :n, :n].sum(0)
        energy += products[:, -1, -1].sum()
        if layout.width is not None:
            scores.append(_by_blocks(jacobian * rest[:, None])[:, :n])
        local.append(slope[:, n:].reshape(-1))
        cross.append(products[:, :n, n:-1].transpose(1, 0, 2).reshape(n, -1))
        own.append(products[:, n:-1, n:-1])
    for name, (mean, std) in numbers.prior.items():

        def away(p: Any, name: str = name, mean: Any = mean, std: Any = std) -> Any:
            return (named_values(layout, numbers, p)[name] - mean) / std

        rest, slope = away(z), jax.jacfwd(away)(z)
        cost += 0.5 * rest**2
        gradient += rest * slope
        information += slope[:, None] * slope[None, :]
    whole = information
    if m:
        blocks = jnp.concatenate(own)
        count = blocks.shape[0]
        diagonal = jnp.zeros((count, m, count, m))
        diagonal = diagonal.at[jnp.arange(count), :, jnp.arange(count), :].set(blocks)
        side = jnp.concatenate(cross, axis=1)
        whole = jnp.block([[information, side], [side.T, diagonal.reshape(count * m, count * m)]])
        gradient = jnp.concatenate([gradient, *local])
    fine = jnp.isfinite(cost) & jnp.all(jnp.isfinite(gradient)) & jnp.all(jnp.isfinite(whole))
    parts = [part.transpose(1, 0, 2).reshape(n, -1) for part in scores]
    blocks = jnp.concatenate([jnp.zeros((n, 0)), *parts], axis=1)
    return Quadratic(jnp.where(fine, cost, jnp.inf), gradient, whole, energy, sigma, blocks)


def _by_blocks(products: Any) -> Any:
    """Sums of ``(B, k, C, T)`` over channels and blocks of time, ``(B, k, blocks)``."""
    size = -(-products.shape[-1] // BLOCKS)
    padding = BLOCKS * size - products.shape[-1]
    padded = jnp.pad(products.sum(axis=2), ((0, 0), (0, 0), (0, padding)))
    return padded.reshape(*padded.shape[:2], BLOCKS, size).sum(axis=-1)
