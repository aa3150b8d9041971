"""Partial pooling of a fleet, sampled by NUTS: vehicles, their law, and a prior for a new one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.figures import showing
from diffthrust._support.names import listing
from diffthrust._support.progress import Progress
from diffthrust._support.report import Report
from diffthrust._support.results import Result
from diffthrust.many._fleet.evidence import Ruler, VehicleEvidence, gather_evidence
from diffthrust.many._fleet.figures import pooled_figure
from diffthrust.many._fleet.hierarchy import arrange
from diffthrust.many._fleet.statistics import Estimates, vehicle_means
from diffthrust.many._fleet.tables import pooled_report
from diffthrust.models._base.parameter import Normal
from diffthrust.uncertainty._sampling import nuts
from diffthrust.uncertainty._sampling.convergence import Convergence, convergence
from diffthrust.uncertainty._sampling.nuts import Walked
from diffthrust.uncertainty._sampling.sample import check_sampling

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


_ONE_SD = 0.682689492137
"""Probability within one standard deviation of a Gaussian."""
_FEWEST = 3
"""Fewest vehicles from which their spread can be estimated."""


@dataclass(frozen=True, eq=False, repr=False)
class Pooled(Result):
    """A fleet whose vehicles were estimated jointly; made by `Fleet.pool`.

    Args:
        fleet: the fleet.
        ruler: the pooled parameters and their coordinates.
        evidence: the likelihood of each vehicle.
        post: all draws as ArviZ data: ``alpha`` by ``vehicle``, ``alpha.mean`` the fleet's median,
            ``alpha.between`` the standard deviation between vehicles (for a "log" parameter, of its
            logarithm).
        weight: share of the fleet in each estimate, ``(vehicles, parameters)``.
        level: probability of the intervals.
        notes: remarks for the user.

    Example:
        >>> pooled = fleet.pool(["ct"], draws=2000)
        >>> pooled.table.shape[0], pooled.population.shape[0]
        (3, 1)
        >>> pooled.convergence.status.value, pooled.exact
        ('converged', ())
        >>> figure = pooled.plot()
    """

    fleet: Estimates = field(repr=False)
    ruler: Ruler = field(repr=False)
    evidence: tuple[VehicleEvidence, ...] = field(repr=False)
    post: Any = field(repr=False)
    weight: np.ndarray = field(repr=False)
    level: float
    notes: tuple[str, ...]

    @cached_property
    def convergence(self) -> Convergence:
        """Convergence of the draws; check its ``status`` first."""
        return convergence(self.post)

    @property
    def exact(self) -> tuple[str, ...]:
        """Vehicles whose logs entered by their exact likelihood."""
        return tuple(vehicle.vehicle for vehicle in self.evidence if vehicle.exact is not None)

    @cached_property
    def table(self) -> pd.DataFrame:
        """A row for each vehicle and parameter that it has.

        Columns: ``separate`` and ``separate_std_error`` from the vehicle's own fits (NaN if none);
        ``median``, ``sd``, ``low`` and ``high`` of the pooled estimate; ``shrinkage``, the weight
        of the fleet in it (0: only the vehicle, 1: only the fleet); ``likelihood``, the kind of
        likelihood used.
        """
        import pandas as pd

        rows = []
        for i, axis in enumerate(self.ruler.axes):
            separate = vehicle_means(self.fleet, axis.name)
            for j, vehicle in enumerate(self.evidence):
                if not vehicle.present[i]:
                    continue
                fitted, error = self._fitted(vehicle.vehicle, axis.name), np.nan
                if vehicle.vehicle in separate.vehicles:
                    at = separate.vehicles.index(vehicle.vehicle)
                    fitted = float(axis.value(separate.values[at]))
                    error = separate.errors[at] * float(axis.slope(fitted))
                drawn = self.post.posterior[axis.name].values[..., j]
                low, median, high = _quantiles(drawn, self.level)
                row = {"vehicle": vehicle.vehicle, "parameter": axis.name, "unit": axis.unit}
                row |= {"separate": fitted, "separate_std_error": error}
                row |= {"median": median, "sd": float(np.std(drawn)), "low": low, "high": high}
                row |= {"shrinkage": float(self.weight[j, i])}
                kind = "exact" if vehicle.exact is not None else "quadratic"
                rows.append({**row, "likelihood": kind})
        return pd.DataFrame(rows)

    def _fitted(self, vehicle: str, parameter: str) -> float:
        """The value of a vehicle's fit, even without a standard error; NaN with several fits."""
        fits = [e.estimates for e in self.fleet.entries if e.vehicle == vehicle and e.usable]
        return fits[0][parameter][0] if len(fits) == 1 and parameter in fits[0] else np.nan

    @cached_property
    def population(self) -> pd.DataFrame:
        """A row for each parameter: the fleet's median and how far vehicles lie from it.

        ``between_sd``, ``between_low`` and ``between_high`` are in the parameter's unit; for a
        "log" parameter, those of its logarithm times the median.
        """
        import pandas as pd

        rows = []
        posterior = self.post.posterior
        for i, axis in enumerate(self.ruler.axes):
            low, median, high = _quantiles(posterior[f"{axis.name}.mean"].values, self.level)
            spread = _quantiles(posterior[f"{axis.name}.between"].values, self.level)
            # The spread is that of a logarithm: times the median it has the parameter's unit.
            per = float(axis.slope(np.asarray(median)))
            have = sum(bool(vehicle.present[i]) for vehicle in self.evidence)
            row = {"parameter": axis.name, "unit": axis.unit, "vehicles": have}
            row |= {"median": median, "low": low, "high": high, "between_sd": spread[1] * per}
            row |= {"between_low": spread[0] * per, "between_high": spread[2] * per}
            rows.append(row)
        return pd.DataFrame(rows)

    def new_vehicle(self, *, seed: int = 0) -> dict[str, np.ndarray]:
        """Parameters of new vehicles of the fleet, one for each draw of its law.

        Returns:
            Values by parameter, ``(draws,)``.

        Example:
            >>> pooled = fleet.pool(["ct"])
            >>> pooled.new_vehicle(seed=0)["ct"].ndim
            1
        """
        posterior, axes = self.post.posterior, self.ruler.axes
        means, spreads = (
            np.stack([posterior[f"{axis.name}.{what}"].values.ravel() for axis in axes], -1)
            for what in ("mean", "between")
        )
        moved = spreads * np.random.default_rng(seed).standard_normal(spreads.shape)
        return {
            axis.name: axis.value(axis.coordinate(means[:, i]) + moved[:, i])
            for i, axis in enumerate(axes)
        }

    def predict_new(self, *, seed: int = 0) -> dict[str, Normal]:
        """A prior for each parameter of a new vehicle.

        Its mean is the median over `new_vehicle`, its standard deviation half the width of the
        central 68 %. Moments are not used: with few vehicles, the standard deviation between them
        has a heavy tail that would dominate.

        Example:
            >>> pooled = fleet.pool(["ct"])
            >>> list(pooled.predict_new(seed=0))
            ['ct']
        """
        out = {}
        for name, values in self.new_vehicle(seed=seed).items():
            low, median, high = _quantiles(values, _ONE_SD)
            out[name] = Normal(mean=median, std=0.5 * (high - low))
        return out

    @showing
    def plot(self) -> Figure:
        """Plot each vehicle's separate and pooled estimates with intervals."""
        return pooled_figure(
            self.fleet, self.ruler.axes, self.post.posterior, self.table, self.level
        )

    def _line(self) -> str:
        return f"{len(self.evidence)} vehicles, {self.convergence.status.value}"

    def _report(self) -> Report:
        notes = [self.convergence.message, *(f"Note: {note}" for note in self.notes)]
        return pooled_report(self.population, self.table, self.level, notes)


def _quantiles(values: np.ndarray, level: float) -> tuple[float, float, float]:
    low, median, high = np.quantile(values, [0.5 - level / 2, 0.5, 0.5 + level / 2])
    return float(low), float(median), float(high)


def pool_vehicles(
    fleet: Estimates,
    parameters: Sequence[str] | None,
    logs: Mapping[str, Any],
    level: float,
    sampling: Mapping[str, int],
    progress: Progress,
) -> Pooled:
    """See `Fleet.pool`; ``sampling`` are the numbers of draws and chains, and the seed."""
    check_sampling("nuts", **sampling, walkers=None, file=None)
    nuts.available("Pooling", "use the separate fits")
    names, notes = _chosen(fleet, parameters)
    ruler = _ruler(fleet, names)
    evidence, more = gather_evidence(fleet, ruler, logs)
    for i, name in enumerate(names):
        lacking = [vehicle.vehicle for vehicle in evidence if not vehicle.present[i]]
        if lacking:
            notes.append(f"{name}: {listing(lacking)} did not estimate it and are left out of it.")
    target, data = arrange(evidence)
    walked = nuts.sample_target(target, data, target.dim, progress=progress, **sampling)
    progress("done", 1.0)
    post = _posterior(ruler, evidence, walked, sampling["seed"])
    weight = np.mean(walked.kept["weight"], axis=(0, 1))
    return Pooled(fleet, ruler, tuple(evidence), post, weight, level, (*notes, *more))


def _chosen(fleet: Estimates, wanted: Sequence[str] | None) -> tuple[list[str], list[str]]:
    """The parameters to pool, and a note on parameters that too few vehicles have."""
    counts = {name: len(vehicle_means(fleet, name).vehicles) for name in fleet.axes}
    names = list(counts) if wanted is None else [wanted] if isinstance(wanted, str) else [*wanted]
    if unknown := [name for name in names if name not in counts]:
        raise InputError(
            f"parameters: no fit of the fleet estimated '{unknown[0]}'; there are "
            f"{listing(counts)}.",
            "Correct the name.",
        )
    # Without a list the parameters that too few vehicles have are noted and left out; one that the
    # user names is an error.
    few = [name for name in names if counts[name] < _FEWEST]
    kept = [name for name in names if counts[name] >= _FEWEST]
    if not kept or (few and wanted is not None):
        what = few[0] if few else "any parameter"
        raise InputError(
            f"Pooling needs {_FEWEST} vehicles with an estimate of {what} and its standard error, "
            f"found {counts.get(what, 0)}.",
            "Leave the parameter out, or add fits of more vehicles.",
        )
    for entry in fleet.entries:
        described = entry.fit.model.parameters if entry.fit is not None else {}
        # A prior in each of ten fits would enter the pooled estimate ten times.
        prior = [n for n in kept if n in described and described[n].prior is not None]
        if prior:
            raise InputError(
                f"{entry.name}: the fit of '{prior[0]}' has a prior, which would count once for "
                "each vehicle.",
                f"Fit without it, or leave {prior[0]} out of the parameters: the fleet is a prior.",
            )
    note = f"{listing(few)}: not pooled, for fewer than {_FEWEST} vehicles have it."
    return kept, [note] if few else []


def _ruler(fleet: Estimates, names: Sequence[str]) -> Ruler:
    middle = []
    for name in names:
        every = [fleet.series(vehicle, name)[1] for vehicle in fleet.vehicles]
        # A median: one vehicle whose fit ran away must not move the origin of the scale.
        middle.append(float(np.median([np.mean(values) for values in every if values.size])))
    return Ruler(tuple(fleet.axes[name] for name in names), np.array(middle))


def _posterior(ruler: Ruler, evidence: Sequence[VehicleEvidence], walked: Walked, seed: int) -> Any:
    """The draws as ArviZ data: ``alpha`` by vehicle, ``alpha.mean`` and ``alpha.between``."""
    import xarray as xr

    from diffthrust.uncertainty._sampling.arviz import arviz

    draw, series = ("chain", "draw"), {}
    kept = walked.kept
    vehicles = [vehicle.vehicle for vehicle in evidence]
    theta, mean = ruler.values(kept["theta"]), ruler.values(kept["mean"])
    for i, axis in enumerate(ruler.axes):
        spread = axis.typical * kept["spread"][..., i]
        unit = "of the logarithm" if axis.log else axis.unit
        series[axis.name] = ((*draw, "vehicle"), theta[..., i], {"unit": axis.unit})
        series[f"{axis.name}.mean"] = (draw, mean[..., i], {"unit": axis.unit})
        series[f"{axis.name}.between"] = (draw, spread, {"unit": unit})
    chains, count = theta.shape[:2]
    coords = {"chain": np.arange(chains), "draw": np.arange(count)}
    attrs = {"method": "nuts", "seed": seed}
    return arviz().InferenceData(
        attrs=attrs,
        posterior=xr.Dataset(series, {**coords, "vehicle": vehicles}, attrs),
        sample_stats=xr.Dataset({k: (draw, v) for k, v in walked.stats.items()}, coords),
    )
