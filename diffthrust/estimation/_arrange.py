"""Records arranged for estimation: padded arrays in batches, and where simulations begin anew."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from diffthrust._support._running.batching import is_unbatched, padded, padded_length
from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.estimation._laws import at_rails
from diffthrust.estimation._numbers import Batch, ProblemNumbers, Restart, Varying
from diffthrust.estimation._problem import Layout, Problem
from diffthrust.estimation._residuals import Likelihood, SimulationError
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Parameter
from diffthrust.simulation._errors import unwrapped
from diffthrust.simulation._record import Record, measured_outputs
from diffthrust.simulation._starts import following
from diffthrust.simulation._step_size import sensor_noise
from diffthrust.simulation._trajectory import Grid, Key, is_large, starting_states

_WASTE = 1.0
"""Logs share a batch while what they are padded with is at most this share of their samples: each
batch has its own part in the compiled code, and takes seconds, and what is padded is left out of
the simulation."""


def build(
    model: Model,
    records: Sequence[Record],
    *,
    substeps: int = 1,
    initial: str = "estimate",
    segmented: bool = False,
    likelihood: Likelihood | None = None,
    width: int | None = None,
    compact: bool = False,
) -> Problem:
    """Arrange a model and its records for estimation.

    The likelihood is that of the simulation error, white and Gaussian, where none is given.

    Raises:
        InputError: no measured channel that the model puts out, or noise levels that differ.
    """
    likelihood = SimulationError() if likelihood is None else likelihood
    channels = _channels(model, records)
    nuisance = likelihood.parameters(channels, records)
    named = {**model.parameters, **nuisance}
    free = tuple(name for name, p in named.items() if not p.fixed)
    follow = following(model, records)
    starts = tuple(n for n in likelihood.starts(model, records) if n not in follow)
    if initial != "estimate":
        # a quaternion's start follows from the first angles
        measured = {n for r in records for n in (*r.measured_states, *r.start)}
        starts = tuple(n for n in starts if n not in measured)
    noise = _known_noise(records, channels)
    if likelihood.corrects or likelihood.noise.lasts:  # a given level is the sensor's alone
        noise = [None] * len(noise)
    grids, batches, order = [], [], []
    for indices, hold in _grouped(model, records):
        group = [records[i] for i in indices]
        anew = [_restart_values(model, record) if segmented else {} for record in group]
        restarted = tuple(n for n in model.states if any(n in series for series in anew))
        uniform = all(record.even for record in group)
        in_loop = compact or is_large(model)
        grids.append(Grid(hold, 1, restarted, uniform, in_loop, padded=is_unbatched()))
        batch = _batch(model, group, channels, starts, follow)
        batch = replace(batch, restarts=_restarts(restarted, anew, group, batch.time.shape[1]))
        if likelihood.law.censors:
            batch = at_rails(batch, group, channels)
        batches.append(batch)
        order.append(tuple(indices))
    counts = _counts(batches)
    spread = [_spread(records, n) for n in channels]
    layout = Layout(
        key=Key(model.bind({})),
        free=free,
        transforms=tuple(named[n].transform for n in free),
        channels=channels,
        known_noise=tuple(s is not None for s in noise),
        starts=starts,
        per_log=tuple((n, named[n].transform) for n in model.per_log),
        grids=tuple(grids),
        likelihood=likelihood,
        width=width,
    )
    numbers = ProblemNumbers(
        batches=batches,
        values={name: np.asarray(p.value, float) for name, p in named.items()},
        scales=np.array([named[n].scale for n in free], float),
        noise=np.array([1.0 if s is None else s for s in noise]),
        floor=np.array([(1e-8 * s) ** 2 for s in spread]),
        counts=counts,
        clip=np.full(len(channels), np.inf),
        reach=np.ones(()),
        prior={
            n: (np.asarray(p.mean, float), np.asarray(p.std, float))
            for n in free
            if (p := named[n].prior)
        },
        varying={n: varying(named[n]) for n in model.per_log},
    )
    problem = Problem(model, tuple(records), layout, numbers, tuple(order), nuisance=nuisance)
    return _for_noise(problem.stepped(substeps))


def _channels(model: Model, records: Sequence[Record]) -> tuple[str, ...]:
    """The outputs that are measured; an error where there are none."""
    channels = measured_outputs(model, records)
    if not channels:
        measured = sorted({name for record in records for name in record.log.measured})
        raise InputError(
            f"No log measures an output of '{model.name}': expected one of "
            f"{listing(model.outputs)}, found {listing(measured)}.",
            "Map a column to one of these channels.",
        )
    return channels


def varying(parameter: Parameter) -> Varying:
    """A parameter that differs by log; until its width is estimated it is a moderate change."""
    scale = 1.0 if parameter.transform == "log" else parameter.scale
    width = 1.0 if parameter.width is None else parameter.width / scale
    return Varying(*(np.asarray(v, float) for v in (scale, width, *parameter.limits)))


def restarts(problem: Problem, horizon: float | None, *, hold: bool = False) -> Problem:
    """The same problem with segments of another length; `None` simulates whole runs.

    With ``hold`` the first segment begins at the measured state like every other.

    Only numbers change, so the compiled code is used again. A restart falls on the first sample
    at or after each multiple of the horizon at which every restarted state was measured.
    """
    if not any(grid.restarted for grid in problem.layout.grids) and hold == problem.held:
        return problem
    batches = []
    for batch, indices in zip(problem.numbers.batches, problem.order, strict=True):
        series = {name: np.array(restart.series) for name, restart in batch.restarts.items()}
        for row, index in enumerate(indices):
            time = problem.records[index].time
            read = {*problem.records[index].measured_states}
            names = [n for n in series if n in read] or [*series]  # the others where they are told
            ours = [np.isfinite(series[n][row, : time.size]) for n in names]
            ours = [finite for finite in ours if finite.any()]
            finite = np.all(ours, axis=0) if ours else np.zeros(time.size, bool)
            chosen = np.zeros(batch.time.shape[1], bool)
            begins = () if horizon is None else np.arange(time[0] + horizon, time[-1], horizon)
            for begin in begins:
                later = np.flatnonzero(finite & (time >= begin))
                if later.size:
                    chosen[later[0]] = True
            for s in series.values():
                s[row, ~chosen] = np.nan
        anew = {name: replace(r, value=series[name]) for name, r in batch.restarts.items()}
        batches.append(replace(batch, restarts=anew))
    numbers = replace(problem.numbers, batches=batches)
    return _for_noise(replace(problem, numbers=numbers, held=hold, horizon=horizon))


def rearranged(problem: Problem, batches: Sequence[Batch]) -> Problem:
    """The same problem with other measurements in its batches."""
    numbers = replace(problem.numbers, batches=list(batches), counts=_counts(batches))
    return _for_noise(replace(problem, numbers=numbers))


def _counts(batches: Sequence[Batch]) -> np.ndarray:
    """Samples that each channel was measured at."""
    return np.asarray(sum(np.isfinite(b.measured).sum(axis=(0, 2)) for b in batches), float)


def _for_noise(problem: Problem) -> Problem:
    """The problem with what its noise needs to know of the samples."""
    step = min(record.step for record in problem.records)
    return replace(problem, numbers=problem.layout.likelihood.noise.arranged(problem.numbers, step))


def trusted(model: Model) -> tuple[str, ...]:
    """States that a sensor reads as they are: no effect acts between the state and its channel."""
    return tuple(n for n in model.states if all(n not in effect.ports for effect in model.effects))


@np.errstate(over="ignore", invalid="ignore")  # numbers of wrong units are reported elsewhere
def _spread(records: Sequence[Record], name: str) -> float:
    """Standard deviation of what all records measured of a channel; 1 for a constant."""
    values = np.concatenate([r.measured[name] for r in records if name in r.measured])
    values = values[np.isfinite(values)]
    return (float(np.std(values)) if values.size else float("nan")) or 1.0


def _known_noise(records: Sequence[Record], channels: Sequence[str]) -> list[float | None]:
    """The noise level of each channel, where the logs state it."""
    stated: list[float | None] = []
    for name in channels:
        levels = {record.noise[name] for record in records if name in record.measured}
        if len(levels) > 1:
            raise InputError(
                f"Channel '{name}': the logs give different noise levels "
                f"({', '.join(map(str, sorted(levels, key=str)))}).",
                "Give every log the same noise, or none to have it estimated.",
            )
        stated.append(levels.pop())
    return stated


def _grouped(
    model: Model, records: Sequence[Record]
) -> list[tuple[list[int], tuple[tuple[str, str], ...]]]:
    """Records of the same inputs and of similar length, which are simulated as one batch."""
    groups: list[tuple[list[int], tuple[tuple[str, str], ...]]] = []
    for index in sorted(range(len(records)), key=lambda i: (-len(records[i]), i)):
        hold = records[index].holds(records[index].inputs_for(model))
        for members, group_hold in groups:
            samples = sum(len(records[i]) for i in (*members, index))
            padded = len(records[members[0]]) * (len(members) + 1)
            if group_hold == hold and padded - samples <= _WASTE * samples:
                members.append(index)
                break
        else:
            groups.append(([index], hold))
    return groups


def _batch(
    model: Model,
    records: Sequence[Record],
    channels: Sequence[str],
    starts: Sequence[str],
    follow: Sequence[str],
) -> Batch:
    length = padded_length(max(len(record) for record in records))
    count = len(records)
    inputs = [record.inputs_for(model) for record in records]
    measured = np.full((count, len(channels), length), np.nan)
    for row, record in enumerate(records):
        for column, name in enumerate(channels):
            if name in record.measured:
                measured[row, column, : len(record)] = record.measured[name]
    first = [starting_states(model, record) for record in records]
    at_means = [0.0] * len(model.per_log)
    return Batch(
        # a padded step has no length: the state rests
        time=np.stack([padded(record.time, length) for record in records]),
        inputs={n: np.stack([padded(g[n], length) for g in inputs]) for n in inputs[0]},
        measured=measured,
        start=np.array([[*(f[n] for n in starts), *at_means] for f in first]).reshape(count, -1),
        held={n: np.array([f[n] for f in first]) for n in first[0] if n not in {*starts, *follow}},
        unsigned=np.array([[n in record.unsigned for n in channels] for record in records]),
        restarts={},
    )


def _restart_values(model: Model, record: Record) -> dict[str, np.ndarray]:
    """At what each state may begin anew: as it is measured, or as it follows from outputs.

    Where a quaternion ran on, whose angles are measured, the heading of eight thrusters was
    anywhere after a few segments, and 300 steps did not bring a search to where ten do.
    """
    sound = [n for n in trusted(model) if n not in record.inputs]

    def read(name: str, values: np.ndarray) -> np.ndarray:
        return smoothed(unwrapped(values) if name in model.angles else values)

    measured = {n: read(n, v) for n, v in record.measured_states.items() if n in sound}
    telling = model._telling(record.measured)
    if not telling or any(name in effect.ports for name in telling for effect in model.effects):
        return measured
    outputs = {n: _between(read(n, record.measured[n])) for n in telling}
    follow = {n: v for n, v in model.start_from(outputs).items() if n in sound}
    return {**follow, **measured}


def _between(values: np.ndarray) -> np.ndarray:
    """The series, straight between readings that are no further apart than is usual.

    An attitude that is read at other samples than the velocities would begin no segment.
    """
    at = np.flatnonzero(np.isfinite(values))
    if at.size < 2:
        return values
    apart, every = np.diff(at), np.arange(values.size)
    inside = np.clip(np.searchsorted(at, every, "right") - 1, 0, apart.size - 1)
    near = (every >= at[0]) & (every <= at[-1]) & (apart[inside] <= 2 * np.median(apart))
    return np.where(near, np.interp(every, at, values[at]), values)


def _restarts(
    names: Sequence[str],
    anew: Sequence[Mapping[str, np.ndarray]],
    records: Sequence[Record],
    length: int,
) -> dict[str, Restart]:
    """By state, at what the logs of a batch may begin anew; none of them does yet."""
    restarts = {}
    for name in names:
        series = np.full((len(records), length), np.nan)
        for row, values in enumerate(anew):
            if name in values:
                series[row, : len(values[name])] = values[name]
        restarts[name] = Restart(
            series=series,
            value=np.full_like(series, np.nan),
            unsigned=np.array([name in record.unsigned for record in records]),
        )
    return restarts


_HALF = 3
"""Neighbours to either side over whose median a restart begins."""


def smoothed(values: np.ndarray) -> np.ndarray:
    """Running median of the neighbours, so that a restart does not begin on a spike."""
    if sensor_noise(values) <= 2e-4 * np.nanstd(values):  # no noise to be rid of
        return values
    wide = np.pad(values, _HALF, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(wide, 2 * _HALF + 1)
    out = np.full(values.shape, np.nan)
    finite = np.isfinite(values)
    out[finite] = np.nanmedian(windows[finite], axis=1)
    return out
