"""A likelihood with its gradient and information, by one forward-mode pass.

Coordinates are turned into a `Quadratic`: the negative logarithm of the likelihood, its gradient,
and the Gauss-Newton (Fisher) information. That is all the optimiser and the checks see. What the
residuals are, and of which law, is a matter of the layout's `Likelihood`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.programs import program
from diffthrust.estimation._numbers import Batch, ProblemNumbers
from diffthrust.estimation._problem import Layout, Problem

_FEW = 6
"""Of so many series all pairs go into one pass: its compilation takes longer the more they are."""


class Quadratic(NamedTuple):
    """A likelihood near some coordinates.

    ``scores`` are the gradient by blocks of time, ``(n, blocks)``, without priors: its scatter
    tells how sure the gradient is, however the residuals are correlated within a block. Only of
    layouts with a width, which are made to be tested: for others there are no blocks.
    """

    cost: Any  # negative log-likelihood without constants; infinite where the simulation fails
    gradient: Any  # of the cost, ``(n,)``
    information: Any  # Gauss-Newton approximation of the cost's Hessian, ``(n, n)``
    energy: Any  # weighted sum of squared residuals, which sets the scale of the gradient
    sigma: Any  # noise standard deviation of each channel, known or estimated, ``(C,)``
    scores: Any

    def turned(self, matrix: Any) -> Quadratic:
        """In other coordinates, by which the old ones have this ``matrix``."""
        return self._replace(
            gradient=matrix.T @ self.gradient, information=matrix.T @ self.information @ matrix
        )


_BLOCKS = 48
"""Blocks of time into which each log is divided for the scatter of the gradient."""


def named_values(layout: Layout, numbers: ProblemNumbers, z: Any) -> dict[str, Any]:
    """Parameter values at coordinates; traceable twin of `Problem.values`."""
    moved = _moved(layout, numbers)
    if layout.width is not None:
        z = jnp.zeros(len(layout.free) + 1).at[numbers.chosen].set(z)
    free = {}
    for i, (name, transform) in enumerate(zip(layout.free, layout.transforms, strict=True)):
        free[name] = jnp.exp(z[i]) if transform == "log" else z[i] * numbers.scales[i]
        if name in moved:
            free[name] = jnp.where(moved[name], free[name], numbers.values[name])
    return {**numbers.values, **free}


def _moved(layout: Layout, numbers: ProblemNumbers) -> dict[str, Any]:
    """Whether each free parameter is among those that are moved; empty where all of them are."""
    if layout.width is None:
        return {}
    chosen = jnp.zeros(len(layout.free) + 1).at[numbers.chosen].set(1.0) > 0
    return {name: chosen[i] for i, name in enumerate(layout.free)}


def values_of_log(
    layout: Layout, numbers: ProblemNumbers, values: Mapping[str, Any], own: Any
) -> dict[str, Any]:
    """Parameter values in one log, from those of all and its coordinates; traceable.

    A parameter that is not moved does not differ by log either: a candidate that is absent from a
    trial would else act in each log by itself.
    """
    first, values_here = len(layout.starts), dict(values)
    moved = _moved(layout, numbers) if layout.per_log else {}
    for i, (name, transform) in enumerate(layout.per_log, start=first):
        kind, mean = numbers.varying[name], values[name]
        away = jnp.where(moved[name], own[i], 0.0) if name in moved else own[i]
        value = mean * jnp.exp(away) if transform == "log" else mean + kind.scale * away
        # at a bound, and beyond it by rounding, the derivative is that from within
        room = 1e-9 * kind.scale
        value = jnp.clip(value, kind.low - room, kind.high + room)
        within = jnp.clip(value, kind.low, kind.high)
        values_here[name] = value + jax.lax.stop_gradient(within - value)
    return values_here


def tightness(layout: Layout, numbers: ProblemNumbers) -> Any:
    """One over the variance of each coordinate of a log, ``(local,)``; initial states have none."""
    widths = [numbers.varying[name].width for name, _ in layout.per_log]
    return jnp.asarray([*[0.0] * len(layout.starts), *(1.0 / width**2 for width in widths)])


def apart(layout: Layout, numbers: ProblemNumbers, own: Sequence[Any]) -> Any:
    """What it costs that parameters that differ by log lie apart from their means; traceable.

    ``own`` is by batch what is each log's own, ``(logs, local)``.
    """
    tight = tightness(layout, numbers)[None]
    return sum((0.5 * jnp.sum(tight * away**2) for away in own), jnp.zeros(()))


def residuals(
    layout: Layout, index: int, numbers: ProblemNumbers, log: Batch, z: Any, start: Any
) -> Any:
    """What is summed of one log, ``(C, T)``; zero where nothing was measured."""
    values = values_of_log(layout, numbers, named_values(layout, numbers, z), start)
    model = layout.key.model.bind(values)
    states = {**log.held, **{n: start[i] for i, n in enumerate(layout.starts)}}
    grid, channels = layout.grids[index], layout.channels
    if numbers.substeps is not None:
        grid = replace(grid, substeps=numbers.substeps)
    return layout.likelihood.residuals(channels, model, grid, values, numbers, log, states)


def errors_at(problem: Problem, z: np.ndarray) -> list[dict[str, np.ndarray]]:
    """The residuals that a likelihood sums, ``(T,)`` by log and channel; NaN where not measured."""
    by_batch = _errors(problem.layout, problem.numbers, jnp.asarray(z))
    by_log: dict[int, dict[str, np.ndarray]] = {}
    for rests, batch, indices in zip(by_batch, problem.numbers.batches, problem.order, strict=True):
        rests = np.where(np.isnan(batch.measured), np.nan, rests)
        for row, index in enumerate(indices):
            record = problem.records[index]
            by_channel = zip(problem.layout.channels, rests[row, :, : len(record)], strict=True)
            by_log[index] = {
                name: residual for name, residual in by_channel if name in record.measured
            }
    return [by_log[index] for index in range(len(problem.records))]


@program(1, quick_compile=True)
def _errors(layout: Layout, numbers: ProblemNumbers, z: Any) -> list[Any]:
    shared, starts = numbers.split(z, layout.shared)
    out = []
    for index, pairs in enumerate(zip(numbers.batches, starts, strict=True)):

        def of_log(pair: Any, index: int = index) -> Any:
            return residuals(layout, index, numbers, pair[0], shared, pair[1])

        out.append(jax.lax.map(of_log, pairs))
    return out


def noise_levels(problem: Problem, z: np.ndarray, sigma: np.ndarray) -> dict[str, float]:
    """Standard deviation of each channel's noise, from the levels that a likelihood works with."""
    channels, noise = problem.layout.channels, problem.layout.likelihood.noise
    sigma = sigma / np.asarray(noise.levels(channels, problem.numbers, problem.values(z)))
    return dict(zip(channels, map(float, sigma), strict=True))


def _with_jacobian(
    layout: Layout, index: int, numbers: ProblemNumbers, batch: Batch, z: Any
) -> tuple[Any, Any]:
    """Residuals ``(B, C, T)`` and their derivatives ``(B, n + m, C, T)`` of one batch of logs."""
    size = z.shape[0] + len(layout.local)

    def of_log(log: Batch) -> tuple[Any, Any]:
        point = jnp.concatenate([z, log.start])

        def fn(p: Any) -> Any:
            return residuals(layout, index, numbers, log, p[: z.shape[0]], p[z.shape[0] :])

        def push(tangent: Any) -> tuple[Any, Any]:
            return jax.jvp(fn, (point,), (tangent,))

        # All columns in one forward pass, which keeps the integration loop one fused kernel: over
        # 10 000 samples of a thruster three columns took 0.30 ms. Reverse mode took 24 ms and
        # `jax.linearize` 29 ms, as both leave that kernel.
        return jax.vmap(push, out_axes=(None, 0))(jnp.eye(size))

    if batch.time.shape[0] == 1:
        first = jax.tree.map(lambda a: a[0], batch)
        return jax.tree.map(lambda a: a[None], of_log(first))
    # log after log: 256 residuals with Jacobians took 397 ms side by side under `vmap`, 144 ms so
    return jax.lax.map(of_log, batch)


def jacobians(layout: Layout, numbers: ProblemNumbers, z: Any) -> list[tuple[Any, Any]]:
    """By batch residuals ``(B, C, T)`` and their derivatives ``(B, n + m, C, T)``."""
    shared, starts = numbers.split(z, layout.shared)
    return [
        _with_jacobian(layout, index, numbers, replace(batch, start=start), shared)
        for index, (batch, start) in enumerate(zip(numbers.batches, starts, strict=True))
    ]


def evaluate(layout: Layout, numbers: ProblemNumbers, z: Any) -> Quadratic:
    """Likelihood of all logs at coordinates ``z``: parameters, then what is each log's own."""
    passes = jacobians(layout, numbers, z)
    cost, sigma = layout.cost(numbers, [r for r, _ in passes])
    shared, own = numbers.split(z, layout.shared)
    cost += apart(layout, numbers, own)
    return _assemble(layout, numbers, shared, own, passes, cost, sigma)


def _assemble(
    layout: Layout,
    numbers: ProblemNumbers,
    z: Any,
    own: Sequence[Any],
    passes: Any,
    cost: Any,
    sigma: Any,
) -> Quadratic:
    n, m, tight = layout.shared, len(layout.local), tightness(layout, numbers)[None]
    gradient, information, energy = jnp.zeros(n), jnp.zeros((n, n)), jnp.zeros(())
    local, cross, corners, scores = [], [], [], []
    for (residual, jacobian), batch, apart in zip(passes, numbers.batches, own, strict=True):
        residual, weight = layout.likelihood.law.straight(residual, sigma, batch)
        root = jnp.sqrt(weight) / sigma[None, :, None]
        residual, jacobian = residual * root, jacobian * root[:, None]
        products = gram([*jnp.moveaxis(jacobian, 1, 0), residual])
        slope = products[:, :-1, -1]
        gradient += slope[:, :n].sum(0)
        information += products[:, :n, :n].sum(0)
        energy += products[:, -1, -1].sum() + (tight * apart**2).sum()
        if layout.width is not None:
            scores.append(by_blocks(jacobian * residual[:, None], _BLOCKS, jnp)[:, :n])
        local.append((slope[:, n:] + tight * apart).reshape(-1))
        side = products[:, :n, n:-1].transpose(1, 0, 2)
        cross.append(side.reshape(n, side.shape[1] * m))  # -1 is refused where n is 0
        corners.append(products[:, n:-1, n:-1] + jnp.diag(tight[0])[None])
    for name, (mean, std) in numbers.prior.items():

        def away(p: Any, name: str = name, mean: Any = mean, std: Any = std) -> Any:
            return (named_values(layout, numbers, p)[name] - mean) / std

        residual, slope = away(z), jax.jacfwd(away)(z)
        cost += 0.5 * residual**2
        gradient += residual * slope
        information += slope[:, None] * slope[None, :]
    matrix = information
    if m:
        blocks = jnp.concatenate(corners)
        count = blocks.shape[0]
        diagonal = jnp.zeros((count, m, count, m))
        diagonal = diagonal.at[jnp.arange(count), :, jnp.arange(count), :].set(blocks)
        side = jnp.concatenate(cross, axis=1)
        matrix = jnp.block([[information, side], [side.T, diagonal.reshape(count * m, count * m)]])
        gradient = jnp.concatenate([gradient, *local])
    fine = jnp.isfinite(cost) & jnp.all(jnp.isfinite(gradient)) & jnp.all(jnp.isfinite(matrix))
    parts = [score.transpose(1, 0, 2).reshape(n, -1) for score in scores]
    blocks = jnp.concatenate([jnp.zeros((n, 0)), *parts], axis=1)
    return Quadratic(jnp.where(fine, cost, jnp.inf), gradient, matrix, energy, sigma, blocks)


def by_blocks(products: Any, count: int, xp: Any) -> Any:
    """Sums of ``(B, k, C, T)`` over channels and blocks of time, ``(B, k, count)``.

    ``xp`` is whose functions are used, `numpy` or `jax.numpy`.
    """
    size = -(-products.shape[-1] // count)
    padding = count * size - products.shape[-1]
    padded = xp.pad(products.sum(axis=2), ((0, 0), (0, 0), (0, padding)))
    return padded.reshape(*padded.shape[:2], count, size).sum(axis=-1)


def gram(series: Sequence[Any]) -> Any:
    """Inner products of ``k`` series ``(B, C, T)`` with each other, ``(B, k, k)``.

    A matrix product first writes the series to memory and is slow for matrices of a few rows. Of a
    few series all products are summed in one pass, into which XLA also draws what the series are
    made from: several times faster than all else in a Gauss-Newton step.
    """
    k = len(series)
    if k > _FEW:
        rows = jnp.stack(series, axis=1).reshape(series[0].shape[0], k, -1)
        return jnp.einsum("bit,bjt->bij", rows, rows)
    pairs = [(i, j) for i in range(k) for j in range(i + 1)]
    sums = jax.lax.reduce(
        tuple(series[i] * series[j] for i, j in pairs),
        (jnp.zeros(()),) * len(pairs),
        lambda one, other: tuple(a + b for a, b in zip(one, other, strict=True)),
        (1, 2),
    )
    products = dict(zip(pairs, sums, strict=True))
    symmetric = [[products[max(i, j), min(i, j)] for j in range(k)] for i in range(k)]
    return jnp.stack([jnp.stack(row, axis=-1) for row in symmetric], axis=-2)
