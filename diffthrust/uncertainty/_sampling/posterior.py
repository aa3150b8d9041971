"""The posterior of a fit: its density, sampled coordinates, start, and checks that it exists."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.batching import run_program, shared_runs
from diffthrust._support._running.programs import program
from diffthrust._support.errors import InputError
from diffthrust.estimation._likelihood import apart, named_values, residuals
from diffthrust.estimation._numbers import ProblemNumbers
from diffthrust.estimation._problem import Layout, Problem
from diffthrust.estimation._rebuild import problem_of
from diffthrust.estimation._result import Fit
from diffthrust.estimation._solver import solve
from diffthrust.logs._log import Log
from diffthrust.models._base.parameter import Normal
from diffthrust.uncertainty._profile_walk import VANISHED

LANES = 16
"""Points evaluated at a time, in the lanes of the vector registers."""
_FAR = 8.0
"""A prior whose mean is more than this many standard deviations from the fit excludes it."""


class DensityShape(NamedTuple):
    """The static part of the program: layout, and channels whose noise level is sampled."""

    layout: Layout
    sampled: tuple[int, ...]


def log_density(shape: DensityShape, data: Any, x: Any) -> tuple[Any, Any]:
    """Logarithm of the posterior density at coordinates ``x``, ``(d,)``, without constants.

    Minus infinity outside the bounds or if the simulation fails. The second result is the noise
    level by channel, ``(C,)``: for an unknown one of the Gaussian law the rms of the residuals.
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


@dataclass(frozen=True, eq=False)
class Posterior:
    """The posterior of a fit: likelihood of its logs times the priors of its parameters.

    The coordinates are those of the fit (see `Problem`): logarithms or scaled values of the free
    parameters, then parameters of the noise, then initial states of the logs and their distances
    from the means of what differs by log. Coordinates fixed in the fit, and initial states that no
    measurement depends on, are left out. The widths of what differs by log are held at the fit's.

    Unknown noise levels: for the Gaussian law the fit's cost, N log(rms) per channel, is exactly
    the likelihood with the level integrated out under the prior 1 / level. For other laws no
    such form exists; the logarithms of the levels are further coordinates, with a flat prior, which
    is the same prior.

    A `Normal` prior is a density in the parameter's value. Without one the prior is flat between
    the bounds in the coordinate, for a "log" parameter in its logarithm.
    """

    fit: Fit
    problem: Problem
    base: np.ndarray
    """All coordinates of the problem at the fit, of which those at ``moved`` are sampled."""
    moved: np.ndarray
    sampled: tuple[int, ...]
    """Channels whose noise level is sampled."""
    centre: np.ndarray
    """The sampled coordinates at the fit, ``(d,)``, within their limits ``low`` and ``high``."""
    low: np.ndarray
    high: np.ndarray

    @property
    def dim(self) -> int:
        """Number of sampled coordinates."""
        return self.centre.size

    @property
    def shape(self) -> DensityShape:
        """The static part of the compiled code."""
        return DensityShape(self.problem.layout, self.sampled)

    @cached_property
    def data(self) -> dict[str, Any]:
        """The numeric part, a pytree of arrays."""
        return {
            "numbers": self.problem.numbers,
            "base": jnp.asarray(self.base),
            "moved": jnp.asarray(self.moved),
            "low": jnp.asarray(self.low),
            "high": jnp.asarray(self.high),
        }

    @property
    def unknown(self) -> tuple[int, ...]:
        """Channels with unknown noise level, sampled or integrated out."""
        return tuple(np.flatnonzero(~np.array(self.problem.layout.known_noise, bool)).tolist())

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Names of the coordinates, for messages and files."""
        layout = self.problem.layout
        logs = [i for indices in self.problem.order for i in indices]
        own = [f"initial.{name}" for name in layout.starts]
        own += [f"per_log.{name}" for name, _ in layout.per_log]
        every = [*layout.free, *(f"{name}[{i}]" for i in logs for name in own)]
        levels = [f"sigma.{layout.channels[i]}" for i in self.sampled]
        return (*(every[i] for i in self.moved), *levels)

    def batch(self, points: np.ndarray, together: int = LANES) -> tuple[np.ndarray, np.ndarray]:
        """Log densities ``(W,)`` and noise levels ``(W, C)`` at points ``(W, d)``.

        Points are evaluated in portions of ``together``, the last one padded, so that any number of
        points shares one compilation; portions run in parallel on the cores.
        """
        count = points.shape[0]
        padded = -(-count // together) * together
        filled = np.concatenate([points, np.repeat(points[-1:], padded - count, axis=0)])
        portions = np.split(filled, padded // together)

        def evaluate(portion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            density, level = run_program(
                log_densities, self.shape, (self.data, portion), rows=together
            )
            return np.asarray(density), np.asarray(level)

        # Use threads, unless `many` already fills the cores: its members wait for their programs in
        # one thread each.
        alone = shared_runs() is None and padded > together
        results = list(_POOL.map(evaluate, portions) if alone else map(evaluate, portions))
        density, level = (np.concatenate(column)[:count] for column in zip(*results, strict=True))
        return density, level

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance of the coordinates by the fit's information, ``(d, d)``.

        Directions that the logs do not determine get the width of their bounds.
        """
        information = solve(self.problem, self.base, budget=1).quadratic.information
        informed = np.zeros((self.dim, self.dim))
        informed[: self.moved.size, : self.moved.size] = information[np.ix_(self.moved, self.moved)]
        counts, law = np.asarray(self.problem.numbers.counts), self.problem.layout.likelihood.law
        for row, channel in enumerate(self.sampled, start=self.moved.size):
            informed[row, row] = counts[channel] * law.level_information
        width = 0.25 * (self.high - self.low)
        width = np.where(np.isfinite(width), np.minimum(width, 10.0), 10.0)
        informed += np.diag(1.0 / width**2)  # a weak prior: nothing is wider than its bounds
        length = np.sqrt(np.diagonal(informed))
        values, vectors = np.linalg.eigh(informed / np.outer(length, length))
        values = np.maximum(values, 1e-13 * values.max())
        return (vectors / values) @ vectors.T / np.outer(length, length)

    def values(self, points: np.ndarray) -> dict[str, np.ndarray]:
        """Values of sampled parameters, including those of the noise, at points ``(..., d)``."""
        names = self.problem.free
        columns = {names[i]: points[..., k] for k, i in enumerate(self.moved) if i < len(names)}
        described = ((n, x, self.problem.named[n]) for n, x in columns.items())
        return {n: np.exp(x) if p.transform == "log" else x * p.scale for n, x, p in described}

    def initial(self, points: np.ndarray) -> dict[str, np.ndarray]:
        """Initial states at points ``(..., d)``: ``(..., logs)`` for each state."""
        own = self._own(points)
        return {state: own[state] for state in self.problem.layout.starts if state in own}

    def per_log(self, points: np.ndarray) -> dict[str, np.ndarray]:
        """Values of parameters that differ by log, at points ``(..., d)``: ``(..., logs)`` each."""
        own, means, out = self._own(points), self.values(points), {}
        for name, transform in self.problem.layout.per_log:
            kind, p = self.problem.numbers.varying[name], self.problem.named[name]
            mean = np.asarray(means.get(name, p.value))[..., None]
            away = own[name]
            value = mean * np.exp(away) if transform == "log" else mean + away * float(kind.scale)
            out[name] = np.clip(value, kind.low, kind.high)
        return out

    def _own(self, points: np.ndarray) -> dict[str, np.ndarray]:
        """The sampled coordinates of the logs by name, ``(..., logs)``."""
        problem, shared = self.problem, self.problem.shared
        coordinates = np.broadcast_to(self.base, (*points.shape[:-1], self.base.size)).copy()
        coordinates[..., self.moved] = points[..., : self.moved.size]
        logs = np.array([i for indices in problem.order for i in indices], int)
        own = coordinates[..., shared:].reshape(*points.shape[:-1], logs.size, problem.each)
        moving = set(self.moved[self.moved >= shared] - shared)
        return {
            name: own[..., np.argsort(logs), k]
            for k, name in enumerate(problem.layout.local)
            if any(row * problem.each + k in moving for row in range(logs.size))
        }


_POOL = ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="diffthrust")


def posterior_of(fit: Fit, logs: Log | Sequence[Log]) -> Posterior:
    """The posterior of a fit that converged, over its training logs in their order."""
    if not fit.status.ok:
        raise InputError(
            f"A posterior needs a fit that converged; this one says '{fit.status}'. {fit.message}",
            "Mend the fit first.",
        )
    problem, z = problem_of(fit, logs)
    low, high = problem.limits()
    local = solve(problem, z, budget=1).quadratic
    place = np.arange(z.size)
    # an initial state that nothing depends on would be a direction without end for the walkers
    unseen = (place >= problem.shared) & ~(np.diagonal(local.information) > 0)
    moved = np.flatnonzero((low < high) & ~unseen)
    layout, law = problem.layout, problem.layout.likelihood.law
    sampled = tuple(
        i for i, is_known in enumerate(layout.known_noise) if not is_known and not law.closed
    )
    levels = np.log(local.sigma[list(sampled)])
    flat = np.full(len(sampled), np.inf)
    # the reported optimum may exceed its bounds by rounding
    centre = np.concatenate([np.clip(z, low, high)[moved], levels])
    low, high = np.concatenate([low[moved], -flat]), np.concatenate([high[moved], flat])
    posterior = Posterior(fit, problem, np.asarray(z), moved, sampled, centre, low, high)
    _refuse(posterior)
    return posterior


def _contradiction(fit: Fit, name: str, value: float, prior: Normal) -> float:
    """Distance between a prior and the likelihood alone, in standard deviations.

    The fit includes the prior, and a narrow prior drags the estimate along, so that their distance
    says nothing. Both are taken as Gaussian, and the prior is divided out of the product.
    """
    column = fit.free.index(name) if name in fit.free else None
    variance = math.nan if column is None else float(fit.covariance[column, column])
    if not variance > 0:
        return abs(value - prior.mean) / prior.std
    information = max(1 / variance - 1 / prior.std**2, 1e-12 / variance)  # information of the logs
    # the posterior mean is a weighted mean: dividing the prior out moves it back to the logs' own
    # value
    apart = abs(value - prior.mean) * (1 + 1 / (information * prior.std**2))
    return apart / math.sqrt(prior.std**2 + 1 / information)


def _refuse(posterior: Posterior) -> None:
    """Raise `InputError` if the posterior is improper, contradictory, or not finite at the fit."""
    problem = posterior.problem
    values = problem.values(posterior.base)
    for name, p in ((name, problem.named[name]) for name in problem.free):
        value = values[name]
        if p.prior and (away := _contradiction(posterior.fit, name, value, p.prior)) > _FAR:
            raise InputError(
                f"Parameter '{name}': its prior, {p.prior.mean:g} +- {p.prior.std:g} {p.unit}, "
                f"excludes what the logs say (the fit: {value:.5g} within {p.range_text()}), by "
                f"{away:.0f} standard deviations.",
                "Widen the prior, correct its unit, or correct the bounds.",
            )
        start = posterior.fit.guess.get(name, p.value)
        vanished = p.transform == "log" and value < start * np.exp(-VANISHED) and p.limits[0] <= 0
        if vanished and not p.prior and name not in problem.nuisance:
            raise InputError(
                f"Parameter '{name}' ran to zero in the fit ({value:.3g} {p.unit}), where a "
                "prior flat in the logarithm is unbounded.",
                "Give it a Normal prior or a lower bound above zero, or fix it.",
            )
    density, _ = posterior.batch(posterior.centre[None])
    if not np.isfinite(density[0]):
        raise InputError(
            "The likelihood at the fit is not a finite number.",
            "Fit again with more substeps, or look for samples that the model cannot produce.",
        )
