"""The posterior of a fit: what is sampled, where it begins, and whether there is one."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.batching import run_program, shared_runs
from diffthrust._support.errors import InputError
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._rebuild import problem_of
from diffthrust.estimation._result import Fit
from diffthrust.estimation._solver import solve
from diffthrust.logs._log import Log
from diffthrust.models._base.parameter import Normal
from diffthrust.uncertainty._sampling.density import DensityShape, log_densities
from diffthrust.uncertainty._sandwich import VANISHED

LANES = 16
"""Points evaluated at a time: the loop over the log runs through so many in vector registers."""
_FAR = 8.0
"""A prior whose mean is more than this many standard deviations from the fit excludes it."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """The posterior of a fit: likelihood of its logs times the priors of its parameters.

    The coordinates are those of the fit (see `Problem`): logarithms or scaled values of the free
    parameters, then parameters of the noise, then initial states of the logs. Coordinates that the
    fit held, and initial states that nothing measured depends on, are left out.

    Noise of unknown level: for the Gaussian law the fit's cost, N log(rms) in each channel, is
    exactly the likelihood with the level integrated out under the prior 1 / level. For other laws
    no such form exists; the logarithms of the levels are further coordinates, with a flat prior,
    which is the same one.

    A `Normal` prior is a density in the parameter's value. Without one the prior is flat in the
    coordinate, so for a "log" parameter in its logarithm, between the bounds.

    Args:
        fit: the fit it belongs to.
        problem: its estimation problem.
        base: all coordinates of the problem at the fit.
        moved: which of them are sampled.
        sampled: channels whose noise level is sampled.
        centre: the sampled coordinates at the fit, ``(d,)``.
        low: their lower limits.
        high: their upper limits.

    Example:
        >>> posterior = posterior_of(fit, logs)
        >>> density, level = posterior.batch(posterior.centre[None])
    """

    fit: Fit
    problem: Problem
    base: np.ndarray
    moved: np.ndarray
    sampled: tuple[int, ...]
    centre: np.ndarray
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
        """Channels whose noise level is not known, sampled or integrated out."""
        return tuple(i for i, known in enumerate(self.problem.layout.known_noise) if not known)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Names of the coordinates, for messages and files."""
        layout = self.problem.layout
        logs = [i for indices in self.problem.order for i in indices]
        states = [f"initial.{state}[{i}]" for i in logs for state in layout.starts]
        every = [*layout.free, *states]
        levels = [f"sigma.{layout.channels[i]}" for i in self.sampled]
        return (*(every[i] for i in self.moved), *levels)

    def batch(self, points: np.ndarray, together: int = LANES) -> tuple[np.ndarray, np.ndarray]:
        """Log densities ``(W,)`` and noise levels ``(W, C)`` at points ``(W, d)``.

        The points go through in portions of ``together``, the last one filled up, so that any
        number of them shares one compilation; portions run side by side on the cores.
        """
        count = points.shape[0]
        whole = -(-count // together) * together
        filled = np.concatenate([points, np.repeat(points[-1:], whole - count, axis=0)])
        portions = np.split(filled, whole // together)

        def one(portion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            density, level = run_program(
                log_densities, self.shape, (self.data, portion), rows=together
            )
            return np.asarray(density), np.asarray(level)

        # in threads, unless other members fill the cores: these wait for programs in one thread
        alone = shared_runs() is None and whole > together
        parts = list(_POOL.map(one, portions) if alone else map(one, portions))
        density, level = (np.concatenate(part)[:count] for part in zip(*parts, strict=True))
        return density, level

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance of the coordinates by the fit's information, ``(d, d)``: where to look.

        Directions of which the logs say nothing get the width of their bounds.
        """
        information = solve(self.problem, self.base, budget=1).quadratic.information
        informed = np.zeros((self.dim, self.dim))
        informed[: self.moved.size, : self.moved.size] = information[np.ix_(self.moved, self.moved)]
        counts, law = np.asarray(self.problem.numbers.counts), self.problem.layout.likelihood.law
        for row, channel in enumerate(self.sampled, start=self.moved.size):
            informed[row, row] = counts[channel] * law.level_information
        width = 0.25 * (self.high - self.low)
        width = np.where(np.isfinite(width), np.minimum(width, 10.0), 10.0)
        informed += np.diag(1.0 / width**2)  # a faint prior: nothing is wider than its bounds
        length = np.sqrt(np.diagonal(informed))
        values, vectors = np.linalg.eigh(informed / np.outer(length, length))
        values = np.maximum(values, 1e-13 * values.max())
        return (vectors / values) @ vectors.T / np.outer(length, length)

    def values(self, points: np.ndarray) -> dict[str, np.ndarray]:
        """Values of the sampled parameters, noise's included, at points ``(..., d)``."""
        out = {}
        for column, i in enumerate(self.moved):
            if i >= len(self.problem.free):
                break
            p = self.problem.named[self.problem.free[i]]
            x = points[..., column]
            out[self.problem.free[i]] = np.exp(x) if p.transform == "log" else x * p.scale
        return out

    def initial(self, points: np.ndarray) -> dict[str, np.ndarray]:
        """Initial states at points ``(..., d)``: ``(..., logs)`` for each state."""
        layout, shared = self.problem.layout, self.problem.shared
        whole = np.broadcast_to(self.base, (*points.shape[:-1], self.base.size)).copy()
        whole[..., self.moved] = points[..., : self.moved.size]
        logs = np.array([i for indices in self.problem.order for i in indices], int)
        states = whole[..., shared:].reshape(*points.shape[:-1], logs.size, len(layout.starts))
        moving = set(self.moved[self.moved >= shared] - shared)
        return {
            state: states[..., np.argsort(logs), k]
            for k, state in enumerate(layout.starts)
            if any(row * len(layout.starts) + k in moving for row in range(logs.size))
        }


_POOL = ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="diffthrust")


def posterior_of(fit: Fit, logs: Log | Sequence[Log]) -> Posterior:
    """The posterior of a fit.

    Args:
        fit: a fit that converged.
        logs: its training logs, in their order.

    Raises:
        InputError: a fit that did not converge, logs that are not those of the fit, a parameter
            without a proper posterior, or a likelihood that cannot be computed at the fit.
    """
    if not fit.status.ok:
        raise InputError(
            f"A posterior needs a fit that converged; this one says '{fit.status}'. {fit.message}",
            "Mend the fit first.",
        )
    problem, z = problem_of(fit, logs)
    low, high = problem.limits()
    local = solve(problem, z, budget=1).quadratic
    place = np.arange(z.size)
    unseen = (place >= problem.shared) & ~(np.diagonal(local.information) > 0)
    moved = np.flatnonzero((low < high) & ~unseen)
    layout, law = problem.layout, problem.layout.likelihood.law
    sampled = tuple(i for i, known in enumerate(layout.known_noise) if not known and not law.closed)
    levels = np.log(local.sigma[list(sampled)])
    flat = np.full(len(sampled), np.inf)
    # a fit's optimum lies within its bounds but for the rounding of its own report
    centre = np.concatenate([np.clip(z, low, high)[moved], levels])
    posterior = Posterior(
        fit,
        problem,
        np.asarray(z),
        moved,
        sampled,
        centre,
        np.concatenate([low[moved], -flat]),
        np.concatenate([high[moved], flat]),
    )
    _refuse(posterior)
    return posterior


def _contradiction(fit: Fit, name: str, value: float, prior: Normal) -> float:
    """How many standard deviations lie between a prior and what the logs alone say.

    A fit counts its prior as a measurement: a narrow one drags the estimate along, and then their
    distance says nothing. Both are taken as Gaussian, and the prior is taken out of their product.
    """
    known = fit.free.index(name) if name in fit.free else None
    variance = math.nan if known is None else float(fit.covariance[known, known])
    if not variance > 0:
        return abs(value - prior.mean) / prior.std
    information = max(1 / variance - 1 / prior.std**2, 1e-12 / variance)  # information of the logs
    apart = abs(value - prior.mean) * (1 + 1 / (information * prior.std**2))
    return apart / math.sqrt(prior.std**2 + 1 / information)


def _refuse(posterior: Posterior) -> None:
    """Raise `InputError` where there is no posterior to sample, or not at the fit."""
    problem = posterior.problem
    for name, p in problem.named.items():
        if name not in problem.free:
            continue
        value = problem.values(posterior.base)[name]
        away = 0.0 if p.prior is None else _contradiction(posterior.fit, name, value, p.prior)
        if p.prior is not None and away > _FAR:
            raise InputError(
                f"Parameter '{name}': its prior, {p.prior.mean:g} +- {p.prior.std:g} {p.unit}, "
                f"excludes what the logs say (the fit: {value:.5g} within {p.range_text()}), by "
                f"{away:.0f} standard deviations.",
                "Widen the prior, correct its unit, or correct the bounds.",
            )
        start = posterior.fit.guess.get(name, p.value)
        gone = p.transform == "log" and value < start * np.exp(-VANISHED) and p.limits[0] <= 0
        if gone and p.prior is None and name not in problem.nuisance:
            raise InputError(
                f"Parameter '{name}' ran to zero in the fit ({value:.3g} {p.unit}), where the "
                "logarithm that a flat prior goes by has no end.",
                "Give it a Normal prior or a lower bound above zero, or fix it.",
            )
    density, _ = posterior.batch(posterior.centre[None])
    if not np.isfinite(density[0]):
        raise InputError(
            "The likelihood at the fit is not a finite number.",
            "Fit again with more substeps, or look for samples that the model cannot produce.",
        )
