"""The density of a fleet: likelihoods of the vehicles under a common population law."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import cho_solve, solve_triangular

from diffthrust.many._fleet.evidence import Exact, VehicleEvidence, first_guess, likelihood
from diffthrust.uncertainty._sampling.posterior import DensityShape

_TAIL = 4.0
"""Degrees of freedom of the half Student-t prior of a standard deviation."""


class ExactKind(NamedTuple):
    """Exact likelihoods that share compiled code."""

    shape: DensityShape
    pooled: int
    unpooled: int
    vehicles: int


class Hierarchy(NamedTuple):
    """The joint density of a fleet's law and its vehicles' parameters, as a target of NUTS.

    The coordinates are those of the law (mean, logarithm of the standard deviations), then each
    vehicle's parameters, then further coordinates of exact likelihoods. A vehicle's coordinates are
    whitened by the product of its quadratic likelihood and the law: in effect centred for a vehicle
    with much data, non-centred for one with little (Papaspiliopoulos, Roberts & Sköld 2007). With
    quadratic likelihoods only, they are exactly independent and standard normal, which removes the
    funnel between the spread and the vehicles' parameters; an exact likelihood enters by its ratio
    to the quadratic one.
    """

    parameters: int  # how many are pooled
    vehicles: int
    kinds: tuple[ExactKind, ...]

    @property
    def law(self) -> int:
        """Number of the law's coordinates."""
        return 2 * self.parameters

    @property
    def dim(self) -> int:
        """Number of all coordinates."""
        unpooled = sum(kind.unpooled * kind.vehicles for kind in self.kinds)
        return self.law + self.vehicles * self.parameters + unpooled

    def density(self, data: Any, v: Any) -> Any:
        """See `diffthrust.uncertainty._sampling.nuts.Target`."""
        mean, root, prior = self._law(data, v)
        eta, at = self._whitened(v)
        theta, fitting, _ = _vehicles(data, mean, root, eta)
        total = prior + jnp.sum(fitting) - 0.5 * jnp.sum(eta**2)
        for kind, group in zip(self.kinds, data["exact"], strict=True):
            size = kind.unpooled * kind.vehicles
            unpooled = v[at : at + size].reshape(kind.vehicles, kind.unpooled)
            at += size
            total += jnp.sum(_exact(kind, group, theta, unpooled))
        return total

    def kept(self, data: Any, v: Any) -> Any:
        """Mean and spread of the law, the vehicles' parameters, and the law's weight."""
        mean, root, _ = self._law(data, v)
        theta, _, weight = _vehicles(data, mean, root, self._whitened(v)[0])
        return {"mean": mean, "spread": jnp.diagonal(root), "theta": theta, "weight": weight}

    def _whitened(self, v: Any) -> tuple[Any, int]:
        """The vehicles' coordinates, ``(vehicles, parameters)``, and where those behind begin."""
        end = self.law + self.vehicles * self.parameters
        return v[self.law : end].reshape(self.vehicles, self.parameters), end

    def _law(self, data: Any, v: Any) -> tuple[Any, Any, Any]:
        """Mean ``(p,)``, root of the covariance ``(p, p)``, and the log density of the prior."""
        p = self.parameters
        mean = data["mean"] + data["mean_width"] * v[:p]
        log_spread = data["log_spread"] + 0.5 * v[p : 2 * p]
        spread = jnp.exp(log_spread)
        # log_spread itself is the Jacobian of the logarithm, in which the standard deviation is
        # sampled.
        prior = jnp.sum(log_spread - 0.5 * (_TAIL + 1) * jnp.log1p(spread**2 / _TAIL))
        return mean, jnp.diag(spread), prior


def _vehicles(data: Any, mean: Any, root: Any, eta: Any) -> tuple[Any, Any, Any]:
    """Parameters of each vehicle, their marginal log density, and the law's weight."""
    # The root of the law's covariance, not its inverse: a standard deviation may go to zero.
    eye = jnp.eye(mean.shape[0])

    def condition(value: Any, information: Any, eta: Any) -> Any:
        # I + R' A R is positive definite whatever the information A, also singular, and for a law
        # of width zero.
        chol = jnp.linalg.cholesky(eye + root.T @ information @ root)
        away = value - mean
        pull = root.T @ (information @ away)
        step = cho_solve((chol, True), pull)
        theta = mean + root @ (step + solve_triangular(chol, eta, trans=1, lower=True))
        misfit = away @ information @ away - pull @ step
        weight = eye - root @ cho_solve((chol, True), root.T @ information)
        return theta, -0.5 * misfit - jnp.sum(jnp.log(jnp.diagonal(chol))), jnp.diagonal(weight)

    return jax.vmap(condition)(data["values"], data["information"], eta)


def _exact(kind: ExactKind, group: Any, theta: Any, etas: Any) -> Any:
    """Log ratio of exact to quadratic likelihood for each vehicle of a kind, ``(vehicles,)``."""
    dim = kind.pooled + kind.unpooled

    def log_ratio(vehicle: Any) -> Any:
        numbers, eta = vehicle
        z = theta[numbers["row"]][numbers["which"]]
        away = z - numbers["top"]
        unpooled = numbers["rest_top"] + numbers["rest_slope"] @ away + numbers["rest_root"] @ eta
        x = jnp.zeros(dim).at[numbers["pooled"]].set(numbers["shift"] + numbers["scale"] * z)
        exact = likelihood(kind.shape, dim, numbers["numbers"], x.at[numbers["rest"]].set(unpooled))
        return exact + 0.5 * away @ numbers["information"] @ away

    if kind.vehicles == 1:  # a loop of one turn would keep the compiler from fusing
        return log_ratio(jax.tree.map(lambda a: a[0], (group, etas)))[None]
    return jax.lax.map(log_ratio, (group, etas))


def arrange(evidence: Sequence[VehicleEvidence]) -> tuple[Hierarchy, dict[str, Any]]:
    """Build the density of a fleet, and its arrays."""
    groups: dict[tuple[DensityShape, int, int], list[Any]] = {}
    for row, vehicle in enumerate(evidence):
        if e := vehicle.exact:
            key = (e.posterior.shape, e.pooled.size, e.unpooled.size)
            groups.setdefault(key, []).append(_numbers(row, vehicle, e))
    kinds = tuple(ExactKind(*key, len(group)) for key, group in groups.items())
    begin = first_guess(evidence)
    data = {
        "values": np.stack([vehicle.values for vehicle in evidence]),
        "information": np.stack([vehicle.information for vehicle in evidence]),
        "mean": begin.mean,
        "mean_width": begin.mean_error,
        "log_spread": np.log(begin.spread),
        "exact": [jax.tree.map(lambda *a: jnp.stack(a), *group) for group in groups.values()],
    }
    return Hierarchy(begin.mean.size, len(evidence), kinds), data


def _numbers(row: int, vehicle: VehicleEvidence, e: Exact) -> dict[str, Any]:
    """The arrays of an exact likelihood."""
    # Unpooled coordinates are whitened conditionally on the pooled ones, by the quadratic
    # likelihood.
    q = e.pooled.size
    inverse = np.linalg.inv(e.covariance[:q, :q])
    slope = e.covariance[q:, :q] @ inverse
    conditional = e.covariance[q:, q:] - slope @ e.covariance[:q, q:]
    numbers = {
        "row": np.asarray(row),
        "which": np.flatnonzero(vehicle.present),
        "top": e.top[:q],
        "information": inverse,
        "pooled": e.pooled,
        "rest": e.unpooled,
        "shift": e.shift,
        "scale": e.scale,
        "rest_top": e.top[q:],
        "rest_slope": slope,
        "rest_root": np.linalg.cholesky(conditional) if e.unpooled.size else conditional,
        "numbers": e.numbers,
    }
    return jax.tree.map(jnp.asarray, numbers)
