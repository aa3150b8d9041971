"""Evidence of each vehicle's logs on the pooled parameters: quadratic, or exact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.programs import program
from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.estimation._result import Fit
from diffthrust.estimation._status import Status
from diffthrust.many._fleet.entries import Axis, Entry
from diffthrust.many._fleet.statistics import Estimates, dispersed, weighted_mean
from diffthrust.uncertainty._sampling.nuts import Box, smooth
from diffthrust.uncertainty._sampling.posterior import DensityShape, Posterior, posterior_of

_STEPS = 50
"""Most steps towards the point of expansion."""


@dataclass(frozen=True)
class Ruler:
    """Scales the pooled parameters: distance from the fleet's middle in typical spreads."""

    axes: tuple[Axis, ...]
    middle: np.ndarray

    @property
    def typical(self) -> np.ndarray:
        """Coordinate per unit."""
        return np.array([axis.typical for axis in self.axes])

    def values(self, z: np.ndarray) -> np.ndarray:
        """Parameter values at points ``(..., p)``."""
        x = self.middle + self.typical * z
        return np.stack([axis.value(x[..., i]) for i, axis in enumerate(self.axes)], axis=-1)


@dataclass(frozen=True)
class VehicleEvidence:
    """Likelihood of one vehicle's logs, in units of the ruler.

    Near its fit the logarithm of the likelihood is ``-(z - values) @ information @ (z - values) /
    2``; directions that the logs do not determine have zero information, as have parameters that
    the vehicle does not have (``present``, ``(p,)``).
    """

    vehicle: str
    values: np.ndarray  # maximum of the quadratic log likelihood, (p,)
    information: np.ndarray  # (p, p)
    present: np.ndarray
    exact: Exact | None = None  # replaces the quadratic one


class Guess(NamedTuple):
    """A first guess of the fleet's law, each parameter by itself, ``(p,)`` each."""

    mean: np.ndarray
    mean_error: np.ndarray
    spread: np.ndarray


def first_guess(evidence: Sequence[VehicleEvidence]) -> Guess:
    """First guess of the law by weighted moments.

    The variance 0.1^2 is added to every error, so that no single precise vehicle dominates.
    """
    values = np.stack([vehicle.values for vehicle in evidence])
    information = np.stack([np.diagonal(vehicle.information) for vehicle in evidence])
    # Zero information (a parameter that the vehicle lacks) becomes a huge variance instead of a
    # division by zero.
    variance = 1.0 / np.maximum(information, 1e-12)
    weight = 1.0 / (variance + 0.01)
    total = np.sum(weight, axis=0)
    mean = np.sum(weight * values, axis=0) / total
    excess = np.sum(weight * ((values - mean) ** 2 - variance), axis=0) / total
    spread = np.sqrt(np.clip(excess, 0.05**2, 2.0**2))
    return Guess(mean, np.sqrt(1.0 / np.sum(1.0 / (variance + spread**2), axis=0)), spread)


def gather_evidence(
    fleet: Estimates, ruler: Ruler, logs: Mapping[str, Any]
) -> tuple[list[VehicleEvidence], list[str]]:
    """The evidence of each vehicle that has any of the parameters, and notes."""
    unknown = [name for name in logs if name not in fleet.vehicles]
    if unknown:
        raise InputError(
            f"logs: there is no vehicle '{unknown[0]}' in the fleet ({', '.join(fleet.vehicles)}).",
            "Name the logs by vehicle.",
        )
    out, tabular, uncertain = [], False, []
    fits_of: dict[str, list[Entry]] = {}
    for vehicle in fleet.vehicles:
        # For an exact likelihood fits need not have converged.
        fits = [e for e in fleet.entries if e.vehicle == vehicle and (e.usable or vehicle in logs)]
        present = np.array([any(e.has(a.name) for e in fits) for a in ruler.axes], bool)
        if vehicle in logs and not present.any():
            raise InputError(
                f"logs: '{vehicle}' has no fit with any of the pooled parameters.",
                "Leave it out of logs.",
            )
        if not present.any():
            continue
        fits_of[vehicle] = fits
        values, information = _together([_parabola(entry, ruler) for entry in fits])
        out.append(VehicleEvidence(vehicle, values, information, present))
        if vehicle in logs:
            continue
        tabular |= any(entry.fit is None for entry in fits)
        if np.any(np.diagonal(information)[present] <= 0):
            uncertain.append(vehicle)
    begin = first_guess(out)
    out = [
        _with_exact_likelihood(v, fits_of[v.vehicle], ruler, logs[v.vehicle], begin)
        if v.vehicle in logs
        else v
        for v in out
    ]
    notes = []
    if tabular:
        notes.append(
            "A table has no covariances: the errors of one vehicle's parameters count as "
            "independent of each other. Pool the fits themselves to include the covariances."
        )
    if uncertain:
        notes.append(
            f"{listing(uncertain)}: parameters without a standard error come from the fleet only, "
            "and the other parameters are conditional on the value at which the fit held them. "
            "Give logs={...} to use the information that the logs do have on them."
        )
    return out, notes


def _with_exact_likelihood(
    parabola: VehicleEvidence, entries: Sequence[Entry], ruler: Ruler, logs: Any, begin: Guess
) -> VehicleEvidence:
    """Replace the quadratic likelihood at the fit by the exact likelihood."""
    fits = [entry.fit for entry in entries if entry.fit is not None]
    if len(fits) != 1 or len(entries) != 1:
        raise InputError(
            f"logs: '{parabola.vehicle}' has {len(fits)} fits, an exact likelihood needs one.",
            "Fit all logs of the vehicle at once, or leave it out of logs.",
        )
    which = np.flatnonzero([axis.name in fits[0].free for axis in ruler.axes])
    precision = 1.0 / begin.spread**2
    # The search for the expansion point starts at the fleet's compromise: the vehicle's fit may
    # have run to zero in a parameter that its logs do not determine.
    towards = np.linalg.solve(
        parabola.information + np.diag(precision),
        parabola.information @ parabola.values + precision * begin.mean,
    )
    part = Ruler(tuple(ruler.axes[i] for i in which), ruler.middle[which])
    law = Guess(*(numbers[which] for numbers in begin))
    exact = _expanded(fits[0], logs, part, towards[which], law)
    p = len(ruler.axes)
    values, information = np.zeros(p), np.zeros((p, p))
    values[which] = exact.top[: which.size]
    information[np.ix_(which, which)] = np.linalg.inv(exact.covariance[: which.size, : which.size])
    present = np.isin(np.arange(p), which)
    return VehicleEvidence(parabola.vehicle, values, information, present, exact)


def _parabola(entry: Entry, ruler: Ruler) -> tuple[np.ndarray, np.ndarray]:
    """Maximum and information of one fit, marginal over other parameters and initial states."""
    p = len(ruler.axes)
    values, slopes, errors = np.zeros(p), np.ones(p), np.full(p, np.nan)
    for i, axis in enumerate(ruler.axes):
        value, error = entry.estimates.get(axis.name, (np.nan, None))
        at = float(axis.coordinate(value))
        if entry.usable and error is not None and np.isfinite(at):
            values[i] = (at - ruler.middle[i]) / axis.typical
            slopes[i] = float(axis.slope(value)) * axis.typical
            errors[i] = error
    valid = np.flatnonzero(np.isfinite(errors))
    covariance = np.diag(errors[valid] ** 2)
    if entry.fit is not None:
        place = [entry.fit.free.index(ruler.axes[i].name) for i in valid]
        covariance = entry.fit.covariance[np.ix_(place, place)]
    information = np.zeros((p, p))
    if valid.size:
        scaled = covariance / np.outer(slopes[valid], slopes[valid])
        # Made symmetric: rounding in a covariance of high condition would make the inverse
        # asymmetric.
        information[np.ix_(valid, valid)] = np.linalg.inv(0.5 * (scaled + scaled.T))
    return values, information


def _together(parabolas: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """The product of quadratic likelihoods.

    If fits scatter beyond their errors, as for a vehicle that drifts, errors grow as in
    `vehicle_means`.
    """
    information = np.sum([weight for _, weight in parabolas], axis=0)
    pull = np.sum([weight @ values for values, weight in parabolas], axis=0)
    # A pseudo-inverse: directions that no fit determines have zero information.
    values = np.linalg.pinv(information, hermitian=True) @ pull
    grown = np.ones(values.size)
    for i in range(values.size):
        pairs = [
            (value[i], np.sqrt(np.linalg.pinv(weight, hermitian=True)[i, i]))  # its marginal error
            for value, weight in parabolas
            if weight[i, i]
        ]
        if pairs:
            grown[i] = dispersed(weighted_mean(*np.array(pairs).T))
    return values, information / np.outer(grown, grown)


@dataclass(frozen=True)
class Exact:
    """The likelihood of a vehicle's logs over the coordinates of its fit.

    Pooled parameters are in units of the fleet's ruler: coordinate = shift + scale * z.
    """

    posterior: Posterior  # the likelihood, times the priors of unpooled parameters
    pooled: np.ndarray  # columns of the pooled parameters among its coordinates, (q,)
    unpooled: np.ndarray  # other columns: unpooled parameters, initial states, noise, (r,)
    shift: np.ndarray
    scale: np.ndarray
    top: np.ndarray  # maximum of the quadratic approximation: pooled (z), then unpooled, (q + r,)
    covariance: np.ndarray  # of the quadratic approximation, in the same order

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


def _expanded(fit: Fit, logs: Any, ruler: Ruler, towards: np.ndarray, law: Guess) -> Exact:
    """The likelihood of a fit's logs, expanded at the maximum of likelihood times a guessed law.

    Not at the fit itself, where with poor logs a parameter may have run to zero; the search starts
    at ``towards``.
    """
    names = [axis.name for axis in ruler.axes]
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
    for column, axis, p in zip(pooled, ruler.axes, described, strict=True):
        # The bounds of a fit are decades around its guess, which is here the estimate itself: an
        # estimate that ran to zero would have no way back.
        if axis.log:
            with np.errstate(divide="ignore"):
                low[column], high[column] = np.log(p.limits)
    posterior = replace(posterior, low=low, high=high)
    pairs = zip(ruler.axes, described, strict=True)
    per = np.array([1.0 if axis.log else 1.0 / p.scale for axis, p in pairs])
    begin = np.concatenate([towards, posterior.centre[unpooled]])
    shift, scale = per * ruler.middle, per * ruler.typical
    bare = Exact(posterior, pooled, unpooled, shift, scale, begin, np.empty(0))
    return _with_parabola(bare, law)


def _with_parabola(bare: Exact, law: Guess) -> Exact:
    """Expand at the maximum of likelihood times law."""
    from scipy.optimize import minimize  # slow to import

    order, posterior, numbers = bare.order, bare.posterior, bare.numbers
    count = bare.unpooled.size
    size = np.append(bare.scale, np.ones(count))
    shift, mean, precision = (
        np.append(pooled, np.zeros(count)) for pooled in (bare.shift, law.mean, 1.0 / law.spread**2)
    )

    def coordinates(y: np.ndarray) -> np.ndarray:
        x = np.empty(y.size)
        x[order] = y * size + shift
        return x

    def log_likelihood(y: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = _slope(posterior.shape, y.size, numbers, coordinates(y))
        return float(value), np.asarray(slope)[order] * size

    def covariance(y: np.ndarray) -> np.ndarray:
        x, base = coordinates(y), posterior.base.copy()
        base[posterior.moved] = x[: posterior.moved.size]
        shifted = replace(posterior, base=base, centre=x)
        scaled = shifted.covariance[np.ix_(order, order)] / np.outer(size, size)
        return 0.5 * (scaled + scaled.T)

    def cost(y: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = log_likelihood(y)
        pull = precision * (y - mean)
        total = 0.5 * float(pull @ (y - mean)) - value
        return total if np.isfinite(total) else np.inf, pull - slope

    # The information is that of Gauss and Newton, and the likelihood may be far from a parabola:
    # steps stay within a region in which it is one.
    top: np.ndarray = minimize(
        cost,
        bare.top,
        jac=True,
        hess=lambda y: np.linalg.inv(covariance(y)) + np.diag(precision),
        method="trust-exact",
        options={"maxiter": _STEPS},
    ).x
    # The parabola of the likelihood alone: its maximum lies a Newton step from the expansion point,
    # which is the maximum of likelihood times law.
    result = covariance(top)
    return replace(bare, top=top + result @ log_likelihood(top)[1], covariance=result)
