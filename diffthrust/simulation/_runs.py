"""A model simulated over whole logs, beside what was measured."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.results import Brief
from diffthrust.logs._log import Log
from diffthrust.logs._written import ShownUnits
from diffthrust.models._base.model import Model
from diffthrust.simulation._errors import Errors, errors, unwrapped, wrapped
from diffthrust.simulation._linearise import InfiniteSlope, infinite_slope
from diffthrust.simulation._record import Record, bind
from diffthrust.simulation._starts import FIRST_PART, estimated_start, unknown_starts, unusual
from diffthrust.simulation._step_size import (
    StepChoice,
    fewest_steps,
    simulate_chosen,
    sufficient_steps,
    warn_if_coarse,
)
from diffthrust.simulation._trajectory import simulate_fixed


class SimulationFailedWarning(RuntimeWarning):
    """A simulation left the finite numbers.

    Example:
        >>> issubclass(dft.simulation.SimulationFailedWarning, Warning)
        True
    """


@dataclass(frozen=True, repr=False)
class Trace(Brief):
    """One channel of one run: measured and modelled, ``(n,)`` each, in ``unit``."""

    measured: np.ndarray
    modelled: np.ndarray
    residual: np.ndarray
    unit: str


@dataclass(frozen=True, repr=False)
class Run(Brief):
    """One log with the simulation over the whole of it.

    Args:
        name: of the log.
        time: time stamps [s], ``(n,)``.
        channels: measured and modelled, by channel that the log measures.
        errors: errors by channel.
        record: the log bound to the model, to simulate it again; ``log`` is what to read.
        signals: inputs, and modelled states and outputs, ``(n,)`` each, in the model's units.
        units: unit of each signal.
        start: initial states, and parameters that differ by log, that were given, and those that
            were estimated from the run.
        estimated: names of the latter: no sensor tells where they begin.
        differing: parameters among them, which differ by log.
        substeps: integrator steps per sample.
        noise: standard deviation of each channel, by which the first part of an unseen run counts.
        failure: when and by which state the simulation left the finite numbers; mostly empty.
        choice: how many steps it needs, where that was examined.
    """

    name: str
    time: np.ndarray
    channels: Mapping[str, Trace]
    errors: Errors
    record: Record = field(repr=False)
    signals: Mapping[str, np.ndarray] = field(repr=False)
    units: Mapping[str, str] = field(repr=False)
    start: Mapping[str, float]
    substeps: int
    estimated: tuple[str, ...] = ()
    differing: tuple[str, ...] = ()
    noise: Mapping[str, float] | None = field(default=None, repr=False)
    failure: str = ""
    choice: StepChoice | None = field(default=None, repr=False)

    @property
    def log(self) -> Log:
        """The log with what carries weight: no repeats of held sensors, no samples at a rail."""
        return self.record.counted

    @cached_property
    def shown(self) -> ShownUnits:
        """The display units: those of the log."""
        return ShownUnits((self.log.written,))

    @cached_property
    def shown_channels(self) -> Mapping[str, Trace]:
        """Measured and modelled in the units of the log."""
        return {name: self._shown(name, trace) for name, trace in self.channels.items()}

    def _shown(self, name: str, trace: Trace) -> Trace:
        per, unit = self.shown.size(name, 1.0, trace.unit)
        measured = self.shown.values(name, trace.measured, trace.unit)
        modelled = self.shown.values(name, trace.modelled, trace.unit)
        return Trace(measured, modelled, per * trace.residual, unit)


def runs_over(
    model: Model,
    records: Sequence[Record],
    *,
    initial: Sequence[Mapping[str, float]] | None = None,
    substeps: int | None = None,
    noise: Mapping[str, float] | None = None,
) -> tuple[Run, ...]:
    """Each whole record simulated, beside what it measured.

    Args:
        model: the model at its present parameter values.
        records: the logs, bound to the model.
        initial: initial states for each of them; by default measured states start from their first
            measurement, and others, where an output feels them, where the run errs least.
        substeps: integrator steps per sample; chosen for each record where ``None``.
        noise: standard deviation of each channel, as the fit of the model has found it: by it the
            first part of a run counts that tells of parameters that differ by log.
    """
    starts = [{}] * len(records) if initial is None else initial
    if isinstance(starts, Mapping) or len(starts) != len(records):
        raise InputError(
            f"initial: expected a list with initial states for each of {len(records)} logs.",
            "Give initial=[{'speed': 1.0}, ...].",
        )
    runs = tuple(
        _run(model, record, start, substeps, noise)
        for record, start in zip(records, starts, strict=True)
    )
    if not any(run.channels for run in runs):
        raise InputError(
            f"No log measures an output of '{model.name}', which puts out "
            f"{listing(model.outputs)}.",
            "Map a column to one of these channels.",
        )
    return runs


def with_steps(model: Model, runs: Sequence[Run], substeps: int | None = None) -> tuple[Run, ...]:
    """Whole runs with other integrator steps; a run that has them already is kept."""
    return tuple(_with_steps(model, run, substeps) for run in runs)


def _with_steps(model: Model, run: Run, substeps: int | None) -> Run:
    choice = run.choice
    if substeps is None:
        choice = step_choice(model, run)
        warn_if_coarse(run.record, choice)
        substeps = choice.substeps
    if substeps == run.substeps:
        return replace(run, choice=choice)
    return _run(model, run.record, _given_start(run), substeps, run.noise, choice)


def step_choice(model: Model, run: Run) -> StepChoice:
    """How many integrator steps a run needs; its own simulation is not made again."""
    if run.choice is not None:
        return run.choice
    existing = {} if run.estimated else {run.substeps: run.signals}
    residual = {name: error.rmse for name, error in run.errors.channels.items()}
    return fewest_steps(model, run.record, _given_start(run), existing, residual=residual)


def _given_start(run: Run) -> dict[str, float]:
    """The initial states of a run that were not estimated from it."""
    return {name: value for name, value in run.start.items() if name not in run.estimated}


def _run(
    model: Model,
    record: Record,
    start: Mapping[str, float],
    substeps: int | None,
    noise: Mapping[str, float] | None,
    choice: StepChoice | None = None,
) -> Run:
    if substeps is None:
        choice = sufficient_steps(model, record, start)
        substeps = choice.substeps
    if estimated := unknown_starts(model, record, start):
        start = {**start, **estimated_start(model, record, start, estimated, substeps, noise)}
    if choice and choice.substeps == substeps and not estimated:
        modelled = simulate_chosen(model, record, start, choice)
    else:
        modelled = simulate_fixed(model, record, start, substeps)
    traces = {name: _trace(model, record, name, modelled[name]) for name in record.measured}
    pairs = {n: [(t.measured, t.residual)] for n, t in traces.items()}
    inputs = {n: record.at_samples(v) for n, v in record.inputs_for(model).items()}
    of_effects = {*model.all_states} - {*model.states}
    return Run(
        name=record.name,
        time=record.log.time,
        channels=traces,
        errors=errors(pairs, model.outputs, ShownUnits((record.log.written,))),
        record=record,
        signals={**inputs, **{n: v for n, v in modelled.items() if n not in of_effects}},
        units={**model.inputs, **model.optional_inputs, **model.states, **model.outputs},
        start=start,
        substeps=substeps,
        estimated=estimated,
        differing=tuple(name for name in estimated if name in model.per_log),
        noise=noise,
        failure=overflow(model, record, modelled) or too_large(model, record, modelled),
        choice=choice,
    )


def _trace(model: Model, record: Record, name: str, modelled: np.ndarray) -> Trace:
    """One measured channel beside what the model says of it."""
    measured = record.observed[name]
    if name in record.unsigned:
        modelled = np.abs(modelled)
    residual = measured - modelled
    if name in model.angles:  # a heading that passes north is no error of a full turn
        residual = wrapped(residual)
        measured = unwrapped(measured)
        modelled = _beside(measured, residual, modelled)
    return Trace(measured, modelled, residual, model.outputs[name])


def _beside(measured: np.ndarray, residual: np.ndarray, modelled: np.ndarray) -> np.ndarray:
    """A modelled angle in whole turns from the measured one, also between its readings.

    NaN there ended the doubts of an Otter, whose heading stands still for a while and was left out,
    in "SVD did not converge".
    """
    read = np.flatnonzero(np.isfinite(residual))
    if not read.size:
        return modelled
    modelled = unwrapped(modelled)
    away = (modelled - measured + residual)[read] / (2.0 * np.pi)
    turns = np.round(np.interp(np.arange(modelled.size), read, np.round(away)))
    modelled = modelled - 2.0 * np.pi * turns
    modelled[read] = (measured - residual)[read]
    return modelled


def overflow(model: Model, record: Record, modelled: Mapping[str, np.ndarray]) -> str:
    """A sentence on when and by which state a simulation left the finite numbers; empty if not."""
    units = {**model.all_states, **model.outputs}
    first = {n: int(np.argmin(np.isfinite(modelled[n]))) for n in units if n in modelled}
    # argmin of booleans is 0 both where the first sample fails and where none does: the sample
    # itself decides.
    lost = {n: k for n, k in first.items() if not np.isfinite(modelled[n][k])}
    if not lost:
        return ""
    name = min(lost, key=lambda n: lost[n])  # states come before outputs, which follow from them
    k, series = lost[name], modelled[name]
    shown = [name] if name in model.all_states and k else []
    at = k - 1 if shown else k
    shown = shown or [n for n in model.all_states if n in modelled and n != name]
    values = [f"{n} {modelled[n][at]:.4g} {units[n]}".rstrip() for n in shown]
    when = f" ({'one sample earlier ' * (at < k)}{', '.join(values)})" if values else ""
    return (
        f"{record.name}: the simulation leaves the finite numbers at t = {record.log.time[k]:.6g} "
        f"s, where the {'state' if name in model.all_states else 'output'} '{name}' is "
        f"{'no number' if np.isnan(series[k]) else 'infinite'}{when}."
    )


def too_large(model: Model, record: Record, modelled: Mapping[str, np.ndarray]) -> str:
    """A sentence on a channel of finite numbers too large to be squared; empty if none."""
    for name, unit in model.outputs.items():
        if name not in record.measured:
            continue
        measured = np.abs(record.observed[name])
        with np.errstate(over="ignore", invalid="ignore"):
            if np.isfinite(np.nansum(measured**2) + np.sum(modelled[name] ** 2)):
                continue
        return (
            f"{record.name}: numbers of {name} are too large to be squared: measured up to "
            f"{np.nanmax(measured):.4g} {unit}, simulated up to "
            f"{np.max(np.abs(modelled[name])):.4g} {unit}. Is its unit right?"
        )
    return ""


def start_notes(model: Model, runs: Sequence[Run]) -> tuple[str, ...]:
    """Notes on what was estimated from the very runs that are compared."""
    names = dict.fromkeys(name for run in runs for name in run.estimated)
    differing = dict.fromkeys(name for run in runs for name in run.differing)
    starts = [name for name in names if name not in differing]
    part = f"the first {100 * FIRST_PART:.0f} % of each run"
    notes = []
    if starts:
        where = f"{part} errs" if differing else "each run errs"
        notes.append(
            f"No sensor tells where {listing(starts)} begins: its initial value is the one with "
            f"which {where} least."
        )
    if differing:
        notes.append(
            f"By log: {listing(differing)}. Estimated from {part}, which the errors count, too; "
            "the remainder is predicted."
        )
    for run in runs:
        for name in run.differing:
            if said := unusual(model, name, run.start[name]):
                notes.append(
                    f"{run.name}: {name} is {run.start[name]:.4g}, {said}: the model may not be "
                    "what this run is of."
                )
    return tuple(notes)


def failures(runs: Sequence[Run]) -> tuple[str, ...]:
    """A sentence for each run whose simulation left the finite numbers."""
    return tuple(run.failure for run in runs if run.failure)


def infinite_slopes(model: Model, runs: Sequence[Run], *, places: bool) -> InfiniteSlope | None:
    """Where the first of some finite runs has an `infinite_slope`, if one has."""
    for run in runs:
        path = simulate_fixed(model, run.record, run.start, run.substeps)
        if slope := infinite_slope(model, run.record, run.start, path, places=places):
            return slope
    return None


def pooled_errors(runs: Sequence[Run]) -> Errors:
    """Errors by channel over the samples of all runs."""
    if len(runs) == 1:
        return runs[0].errors
    pairs: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for run in runs:
        for name, trace in run.channels.items():
            pairs.setdefault(name, []).append((trace.measured, trace.residual))
    units = {name: trace.unit for run in runs for name, trace in run.channels.items()}
    return errors(pairs, units, shown_of(runs))


def shown_of(runs: Sequence[Run]) -> ShownUnits:
    """The display units of several runs."""
    return ShownUnits(run.log.written for run in runs)


def simulate(
    model: Model,
    log: Log,
    *,
    initial: Mapping[str, float] | None = None,
    substeps: int | None = None,
    in_units: bool = False,
) -> dict[str, np.ndarray]:
    """Simulate a model with the inputs of a log.

    Args:
        model: the model, with its effects.
        log: inputs and time stamps; its measurements are used for the initial state only.
        initial: initial states by name, in the model's units. By default measured states start
            from their first measurement, all others from the model's own initial state.
        substeps: integrator steps per sample; ``None`` chooses them (see `choose_substeps`).
        in_units: give channels of the log as it was written, in rpm or kgf, instead of in SI.

    Returns:
        Outputs and states by name at the log's time stamps, ``(n,)`` each, in the model's units,
        which are SI.
        Where they leave the finite numbers a `SimulationFailedWarning` says when and which.

    Raises:
        InputError: the log lacks an input, or a unit has the wrong dimension.

    Example:
        >>> dft.simulate(dft.Thruster(), log)["thrust"].shape
        (240,)
    """
    written = log.written
    if substeps is not None:  # other outputs, in whatever unit, only serve to choose the step
        starting = {*model.states, *model.start_outputs}
        kept = {name: values for name, values in log.measured.items() if name in starting}
        log = log.replaced(measured=kept)
    (record,) = bind(model, [log], compared=False)
    if substeps is None:
        choice = sufficient_steps(model, record, initial)
    else:
        choice = StepChoice(substeps, {})
    modelled = simulate_chosen(model, record, initial, choice)
    if failure := overflow(model, record, modelled):
        warnings.warn(failure, SimulationFailedWarning, stacklevel=2)
    if not in_units:
        return modelled
    display, units = ShownUnits([written]), {**model.all_states, **model.outputs}
    return {n: display.values(n, numbers, units.get(n, "")) for n, numbers in modelled.items()}
