"""Partial pooling of a fleet, sampled by NUTS."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.progress import Progress
from diffthrust.many._fleet.estimates import Estimates
from diffthrust.many._fleet.evidence import Ruler, VehicleEvidence, gather_evidence
from diffthrust.many._fleet.pooled import Pooled
from diffthrust.uncertainty._sampling.sample import check_sampling

_FEWEST = 3
"""Fewest vehicles from which their spread can be estimated."""


def pool_vehicles(
    fleet: Estimates,
    parameters: Sequence[str] | None,
    logs: Mapping[str, Any],
    *,
    correlated: bool,
    draws: int,
    warmup: int,
    chains: int,
    seed: int,
    level: float,
    progress: Progress,
) -> Pooled:
    """See `Fleet.pool`."""
    from diffthrust.many._fleet.hierarchy import arrange
    from diffthrust.uncertainty._sampling import nuts  # slow to import, as BlackJAX is

    check_sampling("nuts", draws, warmup, chains, seed, None, None)
    nuts.available("Pooling", "use the separate fits")
    names, notes = _chosen(fleet, parameters)
    ruler = _ruler(fleet, names)
    evidence, more = gather_evidence(fleet, ruler, logs)
    for i, name in enumerate(names):
        lacking = [vehicle.vehicle for vehicle in evidence if not vehicle.present[i]]
        if lacking:
            notes.append(f"{name}: {listing(lacking)} did not estimate it and are left out of it.")
    target, data = arrange(evidence, correlated)
    walked = nuts.sample_target(
        target,
        data,
        target.dim,
        draws=draws,
        warmup=warmup,
        chains=chains,
        seed=seed,
        progress=progress,
    )
    progress("done", 1.0)
    post = _posterior(ruler, evidence, walked.kept, walked.stats, correlated, seed)
    weight = np.mean(walked.kept["weight"], axis=(0, 1))
    return Pooled(fleet, ruler, tuple(evidence), post, weight, level, (*notes, *more))


def _chosen(fleet: Estimates, wanted: Sequence[str] | None) -> tuple[list[str], list[str]]:
    """The parameters to pool, and a note on parameters that too few vehicles have."""
    counts = {
        name: sum(fleet.series(vehicle, name)[1].size > 0 for vehicle in fleet.vehicles)
        for name in fleet.axes
    }
    names = list(counts) if wanted is None else [wanted] if isinstance(wanted, str) else [*wanted]
    for name in names:
        if name not in counts:
            raise InputError(
                f"parameters: no fit of the fleet estimated '{name}'; there are {listing(counts)}.",
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
    notes = (
        [f"{listing(few)}: not pooled, for fewer than {_FEWEST} vehicles have it."] if few else []
    )
    return kept, notes


def _ruler(fleet: Estimates, names: Sequence[str]) -> Ruler:
    middle = []
    for name in names:
        every = [fleet.series(vehicle, name)[1] for vehicle in fleet.vehicles]
        # A median: one vehicle whose fit ran away must not move the origin of the scale.
        middle.append(float(np.median([np.mean(values) for values in every if values.size])))
    return Ruler(tuple(fleet.axes[name] for name in names), np.array(middle))


def _posterior(
    ruler: Ruler,
    evidence: Sequence[VehicleEvidence],
    kept: Mapping[str, np.ndarray],
    stats: Mapping[str, np.ndarray],
    correlated: bool,
    seed: int,
) -> Any:
    """The draws as ArviZ data: ``alpha`` by vehicle, ``alpha.mean`` and ``alpha.between``."""
    import xarray as xr

    from diffthrust.uncertainty._sampling.arviz import arviz

    draw, series = ("chain", "draw"), {}
    vehicles = [vehicle.vehicle for vehicle in evidence]
    theta, mean = ruler.values(kept["theta"]), ruler.values(kept["mean"])
    for i, axis in enumerate(ruler.axes):
        spread = axis.typical * kept["spread"][..., i]
        unit = "of the logarithm" if axis.log else axis.unit
        series[axis.name] = ((*draw, "vehicle"), theta[..., i], {"unit": axis.unit})
        series[f"{axis.name}.mean"] = (draw, mean[..., i], {"unit": axis.unit})
        series[f"{axis.name}.between"] = (draw, spread, {"unit": unit})
        for j in range(i if correlated else 0):
            name = f"correlation.{ruler.axes[j].name}.{axis.name}"
            series[name] = (draw, kept["correlation"][..., j, i], {"unit": ""})
    chains, count = theta.shape[:2]
    coords = {"chain": np.arange(chains), "draw": np.arange(count)}
    attrs = {"method": "nuts", "seed": seed}
    return arviz().InferenceData(
        attrs=attrs,
        posterior=xr.Dataset(series, {**coords, "vehicle": vehicles}, attrs),
        sample_stats=xr.Dataset({k: (draw, v) for k, v in stats.items()}, coords),
    )
