"""The exact likelihood of a vehicle's logs, and its quadratic approximation within the fleet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.programs import program
from diffthrust.estimation._result import Fit
from diffthrust.estimation._status import Status
from diffthrust.many._fleet.entries import Axis
from diffthrust.uncertainty._sampling.nuts import Box, smooth
from diffthrust.uncertainty._sampling.posterior import DensityShape, Posterior, posterior_of

_STEPS = 50
"""Most Newton steps towards the point of expansion."""


class Normals(NamedTuple):
    """Independent Gaussian laws, ``(q,)`` each."""

    mean: np.ndarray
    spread: np.ndarray


@dataclass(frozen=True)
class Exact:
    """The likelihood of a vehicle's logs over the coordinates of its fit.

    Pooled parameters are in units of the fleet's ruler: coordinate = shift + scale * z.

    Args:
        posterior: the likelihood, times the priors of unpooled parameters.
        pooled: columns of the pooled parameters among its coordinates, ``(q,)``.
        unpooled: other columns: unpooled parameters, initial states, noise, ``(r,)``.
        shift: coordinates of the pooled parameters at z = 0.
        scale: coordinates per unit of z.
        top: maximum of the quadratic approximation: pooled (z), then unpooled, ``(q + r,)``.
        covariance: of the quadratic approximation, in the same order.
    """

    posterior: Posterior
    pooled: np.ndarray
    unpooled: np.ndarray
    shift: np.ndarray
    scale: np.ndarray
    top: np.ndarray
    covariance: np.ndarray

    @property
    def order(self) -> np.ndarray:
        """Columns of the pooled parameters, then of the unpooled ones."""
        return np.concatenate([self.pooled, self.unpooled])

    @property
    def numbers(self) -> dict[str, Any]:
        """The numbers of `likelihood`, a pytree of arrays."""
        d = self.posterior.dim
        return {**self.posterior.data, "origin": jnp.zeros(d), "root": jnp.eye(d)}


def likelihood(shape: DensityShape, dim: int, numbers: Any, x: Any) -> Any:
    """Log likelihood at coordinates ``(d,)``, with its derivative by one forward-mode pass."""
    return smooth(shape, Box((False,) * dim, (False,) * dim), numbers, x)


@program(2)
def _slope(shape: DensityShape, dim: int, numbers: Any, x: Any) -> Any:
    return jax.value_and_grad(likelihood, argnums=3)(shape, dim, numbers, x)


def expand(
    fit: Fit,
    logs: Any,
    axes: Sequence[Axis],
    middle: np.ndarray,
    towards: np.ndarray,
    law: Normals,
) -> Exact:
    """The likelihood of a fit's logs, expanded at the maximum of likelihood times a guessed law.

    An expansion at the fit itself would be of little use: with poor logs, a parameter may have run
    to zero there.

    Args:
        fit: the fit.
        logs: its training logs.
        axes: its pooled parameters.
        middle: their coordinates at z = 0.
        towards: start of the search, in z.
        law: of the fleet, in z.
    """
    names = [axis.name for axis in axes]
    # `posterior_of` refuses a fit that is not identifiable, whose posterior is improper. The law of
    # the fleet makes it proper, hence the status.
    near = {n: fit.parameters[n].value for n in names}
    posterior = posterior_of(
        replace(fit, status=Status.CONVERGED, guess={**fit.guess, **near}), logs
    )
    labels = list(posterior.labels)
    pooled = np.array([labels.index(name) for name in names], int)
    unpooled = np.setdiff1d(np.arange(posterior.dim), pooled)
    described = [posterior.problem.named[name] for name in names]
    low, high = posterior.low.copy(), posterior.high.copy()
    for column, axis, p in zip(pooled, axes, described, strict=True):
        # The bounds of a fit are decades around its guess, which is here the estimate itself: an
        # estimate that ran to zero would have no way back.
        if axis.log:
            with np.errstate(divide="ignore"):
                low[column], high[column] = np.log(p.limits)
    posterior = replace(posterior, low=low, high=high)
    per = np.array([1.0 if axis.log else 1.0 / p.scale
                    for axis, p in zip(axes, described, strict=True)])  # fmt: skip
    typical = np.array([axis.typical for axis in axes])
    size = np.concatenate([per * typical, np.ones(unpooled.size)])
    begin = np.concatenate([towards, posterior.centre[unpooled]])
    bare = Exact(posterior, pooled, unpooled, per * middle, per * typical, begin, np.diag(size))
    return _with_parabola(bare, size, law)


def _with_parabola(bare: Exact, size: np.ndarray, law: Normals) -> Exact:
    """Expand at the maximum of likelihood times law, found by damped Newton steps."""
    q, shape, numbers = bare.pooled.size, bare.posterior.shape, bare.numbers
    precision = np.zeros(size.size)
    precision[:q] = 1.0 / law.spread**2
    mean = np.zeros(size.size)
    mean[:q] = law.mean

    def at(y: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        x = np.empty(y.size)
        x[bare.order] = y * size + np.concatenate([bare.shift, np.zeros(y.size - q)])
        value, gradient = _slope(shape, y.size, numbers, x)
        return float(value), np.asarray(gradient)[bare.order] * size, x

    def covariance(x: np.ndarray) -> np.ndarray:
        base = bare.posterior.base.copy()
        base[bare.posterior.moved] = x[: bare.posterior.moved.size]
        shifted = replace(bare.posterior, base=base, centre=x)
        return shifted.covariance[np.ix_(bare.order, bare.order)] / np.outer(size, size)

    y = bare.top.copy()
    value, slope, x = at(y)
    for _ in range(_STEPS):
        total = slope - precision * (y - mean)
        curvature = np.linalg.inv(covariance(x)) + np.diag(precision)
        step = np.linalg.solve(curvature, total)
        share, here = 1.0, value - 0.5 * float(np.sum(precision * (y - mean) ** 2))
        # The information is that of Gauss and Newton, and the likelihood may be far from a
        # parabola: the step is halved until the posterior density does not fall.
        while share > 1e-4:
            trial = y + share * step
            updated, inclined, shifted = at(trial)
            if updated - 0.5 * float(np.sum(precision * (trial - mean) ** 2)) >= here:
                y, value, slope, x = trial, updated, inclined, shifted
                break
            share *= 0.5
        if share <= 1e-4 or float(total @ step) < 1e-6:
            break
    result = covariance(x)
    result = 0.5 * (result + result.T)
    # The parabola of the likelihood alone: its maximum lies a Newton step from the expansion point,
    # which is the maximum of likelihood times law.
    return replace(bare, top=y + result @ slope, covariance=result)
