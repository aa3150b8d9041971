"""A model simulated over whole logs, beside what was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.results import Brief
from diffthrust.logs._log import Log
from diffthrust.logs._written import ShownUnits
from diffthrust.models._base.model import Model
from diffthrust.simulation._errors import Errors, errors, unwrapped, wrapped
from diffthrust.simulation._fixed_step import simulate_fixed
from diffthrust.simulation._inputs import inputs_of
from diffthrust.simulation._overflow import overflow, too_large
from diffthrust.simulation._remembered import simulated_once
from diffthrust.simulation._starts import estimated_start, unknown_starts
from diffthrust.simulation._step_size import choose_substeps


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
        log: the log as it counts: without repeats of held sensors, and samples at a rail.
        signals: inputs, and modelled states and outputs, ``(n,)`` each, in the model's units.
        units: unit of each signal.
        start: initial states that were given, and those that were estimated from the run.
        estimated: names of the latter: no sensor tells where they begin.
        substeps: integrator steps per sample.
        failure: when and by which state the simulation left the finite numbers; mostly empty.
    """

    name: str
    time: np.ndarray
    channels: Mapping[str, Trace]
    errors: Errors
    log: Log = field(repr=False)
    signals: Mapping[str, np.ndarray] = field(repr=False)
    units: Mapping[str, str] = field(repr=False)
    start: Mapping[str, float]
    substeps: int
    estimated: tuple[str, ...] = ()
    failure: str = ""

    @cached_property
    def shown(self) -> ShownUnits:
        """The units in which people are told of it: those of the log."""
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
    logs: Sequence[Log],
    *,
    initial: Sequence[Mapping[str, float]] | None = None,
    substeps: int | None = None,
) -> tuple[Run, ...]:
    """Each whole log simulated, beside what it measured.

    Args:
        model: the model at its present parameter values.
        logs: the logs.
        initial: initial states for each log; by default measured states start from their first
            measurement, and others, where an output feels them, where the run errs least.
        substeps: integrator steps per sample; chosen for each log where ``None``.

    Raises:
        InputError: a log without a channel that the model needs, no log with one that it puts out,
            or initial states of another number of logs.
    """
    starts = [{}] * len(logs) if initial is None else initial
    if isinstance(starts, Mapping) or len(starts) != len(logs):
        raise InputError(
            f"initial: expected a list with initial states for each of {len(logs)} logs.",
            "Give initial=[{'speed': 1.0}, ...].",
        )
    runs = tuple(
        _run(model, log.counted, start, substeps) for log, start in zip(logs, starts, strict=True)
    )
    if not any(run.channels for run in runs):
        raise InputError(
            f"No log measures an output of '{model.name}', which puts out "
            f"{listing(model.outputs)}.",
            "Map a column to one of these channels.",
        )
    return runs


def are_tables(model: Model, runs: Sequence[Run]) -> bool:
    """Whether all runs are tables of readings, without a time of their own."""
    counted = all(np.array_equal(run.time, np.arange(run.time.size)) for run in runs)
    return counted and not model.states


def _run(model: Model, log: Log, start: Mapping[str, float], substeps: int | None) -> Run:
    with simulated_once():  # with the steps that are chosen it is simulated already
        if substeps is None:
            substeps = choose_substeps(model, log, initial=start)
        if estimated := unknown_starts(model, log, start):
            start = {**start, **estimated_start(model, log, start, estimated, substeps)}
        modelled = simulate_fixed(model, log, start, substeps)
    channels = {}
    for name, unit in model.outputs.items():
        if name not in log.measured:
            continue
        ours = np.abs(modelled[name]) if name in log.unsigned else modelled[name]
        theirs = log.values(name, unit)
        rest = theirs - ours
        if name in model.angles:
            rest = wrapped(rest)
            theirs = unwrapped(theirs)
            ours = theirs - rest
        channels[name] = Trace(theirs, ours, rest, unit)
    pairs = {n: [(t.measured, t.residual)] for n, t in channels.items()}
    by_channel = errors(pairs, model.outputs, ShownUnits((log.written,)))
    signals = {**inputs_of(model, log), **{n: v for n, v in modelled.items() if "." not in n}}
    units = {**model.inputs, **model.optional_inputs, **model.states, **model.outputs}
    failure = overflow(model, log, modelled) or too_large(model, log, modelled)
    about = (log, signals, units, start, substeps, estimated, failure)
    return Run(log.name, log.time, channels, by_channel, *about)


def start_notes(runs: Sequence[Run]) -> tuple[str, ...]:
    """A note on initial states that were estimated from the very runs that are compared."""
    names = dict.fromkeys(name for run in runs for name in run.estimated)
    if not names:
        return ()
    return (
        f"No sensor tells where {listing(names)} begins: its initial value is the one with which "
        "each run errs least.",
    )


def failures(runs: Sequence[Run]) -> tuple[str, ...]:
    """A sentence for each run whose simulation left the finite numbers."""
    return tuple(run.failure for run in runs if run.failure)


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
    """The units in which people are told of some runs."""
    return ShownUnits(run.log.written for run in runs)
