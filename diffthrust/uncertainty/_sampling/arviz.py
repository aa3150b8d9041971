"""Posterior draws as ArviZ data; the only module that imports ArviZ."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError, os_errors_as
from diffthrust._support.files import ending, write_whole
from diffthrust.estimation._estimate import shown_unit
from diffthrust.logs._written import ShownUnits, Size
from diffthrust.uncertainty._sampling.ensemble import Chains
from diffthrust.uncertainty._sampling.posterior import Posterior


def arviz() -> Any:
    """Import ArviZ late: it takes over a second, and warns of a new version once a day."""
    with warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", message=r"\s*ArviZ is undergoing a major refactor", category=FutureWarning
        )
        import arviz
    return arviz


def write_posterior(post: Any, path: Path | str) -> None:
    """Write a posterior as netCDF (``post.to_netcdf``), atomically."""
    path = Path(path)
    ending(path, ".nc")
    problem = f"{path}: it is made in a temporary folder first, and cannot be"
    mend = "Make room in the folder for temporary files, or name another: TMPDIR=DIR."
    with os_errors_as(problem, mend), TemporaryDirectory() as folder:
        # netCDF writes in pieces: made elsewhere and moved whole, so that an interrupt leaves no
        # half file
        made = Path(folder) / "posterior.nc"
        post.to_netcdf(str(made))
        data = made.read_bytes()
    write_whole(path, data)


def read_posterior(path: Path) -> Any:
    """Read a posterior from a netCDF file of ArviZ."""
    if not path.is_file():
        raise InputError(f"{path}: expected a posterior, found no such file.", "Correct the name.")
    try:
        # read at once: a lazy file stays open, and cannot be overwritten
        with arviz().rc_context({"data.load": "eager"}):
            post = arviz().from_netcdf(str(path))
        if not post.posterior.data_vars:
            raise ValueError("its posterior is empty")
    except Exception as error:  # the libraries below raise a dozen kinds
        raise InputError(
            f"{path}: expected a posterior in a netCDF file of ArviZ, found a file that is cut "
            f"off, damaged or of another kind ({error}).",
            "Save the posterior again: post.to_netcdf('posterior.nc').",
        ) from None
    for group in (post, *(post[name] for name in post.groups())):
        group.attrs.update(
            {k: v.item() for k, v in group.attrs.items() if isinstance(v, np.generic)}
        )
    return post


def inference_data(posterior: Posterior, chains: Chains, attrs: Mapping[str, Any]) -> Any:
    """Draws, statistics of the sampler and measurements, as `arviz.InferenceData`.

    Initial states are ``initial.<state>`` and what differs by log ``per_log.<parameter>``, both by
    ``log``; unknown noise levels ``sigma`` by ``channel``; measurements ``channel[log name]``, each
    over a time of its own.
    """
    import xarray as xr

    problem, draw = posterior.problem, ("chain", "draw")
    names = _log_names([record.name for record in problem.records])
    units = problem.model.all_states | dict(problem.model.outputs)
    variables: dict[str, Any] = {}
    written = ShownUnits(record.log.written for record in problem.records)
    for name, values in posterior.values(chains.points).items():
        shown = shown_unit(problem.named[name], problem.model, written)
        attrs_of = {"unit": problem.named[name].unit, "per": shown.value, "shown_unit": shown.unit}
        variables[name] = (draw, values, attrs_of)
    for state, values in posterior.initial(chains.points).items():
        variables[f"initial.{state}"] = ((*draw, "log"), values, {"unit": units[state]})
    for name, values in posterior.per_log(chains.points).items():
        unit = {"unit": problem.named[name].unit}
        variables[f"per_log.{name}"] = ((*draw, "log"), values, unit)
    channels = [problem.layout.channels[i] for i in posterior.unknown]
    if channels:
        sigma = _noise_draws(posterior, chains, int(attrs["seed"]))
        listed = ", ".join(f"{name}: {problem.model.outputs[name]}" for name in channels)
        variables["sigma"] = ((*draw, "channel"), sigma, {"unit": listed})
    observed = {}
    for name, record in zip(names, problem.records, strict=True):
        time = f"time[{name}]"
        observed[time] = ((time,), record.time, {"unit": "s"})
        for channel in (c for c in problem.layout.channels if c in record.measured):
            unit = {"unit": problem.model.outputs[channel]}
            observed[f"{channel}[{name}]"] = ((time,), record.measured[channel], unit)
    count = chains.points.shape[:2]
    coords = {"chain": np.arange(count[0]), "draw": np.arange(count[1])}
    used = {dim for entry in variables.values() for dim in entry[0]}
    stats = {"lp": chains.log_prob, **chains.stats}
    groups = {
        "posterior": xr.Dataset(
            variables,
            {**coords, **{k: v for k, v in (("log", names), ("channel", channels)) if k in used}},
            attrs,
        ),
        "sample_stats": xr.Dataset({k: (draw, v) for k, v in stats.items()}, coords),
        "observed_data": xr.Dataset(observed),
    }
    return arviz().InferenceData(attrs=dict(attrs), **groups)


def shown_in(variable: Any) -> Size:
    """The display unit of a variable, and its number per unit of the variable."""
    unit = str(variable.attrs.get("unit", ""))
    return Size(float(variable.attrs.get("per", 1.0)), str(variable.attrs.get("shown_unit", unit)))


def _noise_draws(posterior: Posterior, chains: Chains, seed: int) -> np.ndarray:
    """Draws of unknown noise levels, ``(chains, draws, channels)``.

    For the Gaussian law, whose level was integrated out, they come from the exact conditional:
    given all else, N rms^2 / sigma^2 is chi-square distributed with N degrees of freedom.
    """
    rng = np.random.default_rng([seed, 1])
    counts = np.asarray(posterior.problem.numbers.counts)
    out = []
    for channel in posterior.unknown:
        level = chains.levels[..., channel]
        if channel not in posterior.sampled:
            level = level * np.sqrt(counts[channel] / rng.chisquare(counts[channel], level.shape))
        out.append(level)
    return np.stack(out, axis=-1)


def _log_names(names: list[str]) -> list[str]:
    """Names of the logs without slashes; duplicates are numbered."""
    names = [name.replace("/", "|") for name in names]
    return [
        f"{name} {names[: i + 1].count(name)}" if names.count(name) > 1 else name
        for i, name in enumerate(names)
    ]
