"""One stage of a search: a force that is periodic in time, found by its line in the errors.

Such a force is no candidate like others: no signal of the model tells of it, and without its
frequency no trial promises anything. The line gives the frequency, the logs their own amplitudes
and phases, and the search then treats it as any candidate. Of an unseen log amplitude and phase
come from its first half, so that its second half is predicted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain, count

import numpy as np

from diffthrust.diagnosis._admission import admit
from diffthrust.diagnosis._candidates import DrivingPort, words_and_unit
from diffthrust.diagnosis._innovations_fit import TrialFit
from diffthrust.diagnosis._rating import Tried, rate
from diffthrust.diagnosis._search_start import compiled_fitter
from diffthrust.diagnosis._search_state import CurrentModel, FittedStage, SearchContext, SearchState
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._spectral_line import (
    Series,
    SpectralLine,
    height_at,
    height_over_turns,
    strongest_line,
)
from diffthrust.effects._periodic import PeriodicForce
from diffthrust.estimation._result import Fit
from diffthrust.simulation._record import Record, are_tables
from diffthrust.simulation._runs import Run
from diffthrust.simulation._starts import estimated_start

_TURNING = {"rad/s": 1.0, "rev/s": 2.0 * np.pi}
"""Numerics: units of angular velocities, in radians a second."""


def add_periodic_force(
    context: SearchContext, state: SearchState
) -> tuple[SearchContext, SearchState]:
    """The search with a periodic force, where the errors have a line that no signal explains.

    Where they have none, where the logs are static tables, and where the force is refused as any
    other effect may be, both come back as they are.
    """
    if are_tables(context.fitter.records):
        return context, state
    with context.clock("lines"):
        line = unexplained_line(context, state)
    if line is None:
        return context, state
    context.say(f"trying a periodic force of {line.frequency:.3g} Hz", state.share(0.5))
    last, name = state.stages[-1], free_name(context)
    for place in _places(context, line.channel):
        force = _sized(_first_guess(context, place, line, name), last)
        if force is None:
            continue
        wider, begun = _with_candidate(context, state, force)
        trial = _trial_with(wider, begun, force)
        candidate = rate(wider.fitter, begun, trial, begun.current.criterion)
        if candidate.delta_bic > -SETTINGS.admission.least_bic_gain:
            continue
        outcome = admit(wider, begun, Tried(candidate, trial))
        if isinstance(outcome, SearchState) and outcome.accepted != state.accepted:
            ranking = sorted([*outcome.ranking, candidate], key=lambda c: (c.stage, c.delta_bic))
            outcome = replace(outcome, ranking=tuple(ranking), exhausted=False)
            # beside the force the model's parameters are others, and so is where the force begins
            return _with_candidate(wider, outcome, force)
    return context, state


def unexplained_line(context: SearchContext, state: SearchState) -> SpectralLine | None:
    """The clearest line in the one-step errors that neither a signal nor a shaft has as clearly."""
    fitter, runs = context.fitter, state.stages[-1].runs
    passed = state.current.trial.passed
    lines: list[tuple[SpectralLine, list[Series]]] = []
    for c, channel in enumerate(fitter.channels):
        logs = [(p.path["time"], p.errors[c]) for p in passed]
        if line := strongest_line(channel, logs):
            lines.append((line, logs))
    clear = [pair for pair in lines if pair[0].p_value * len(lines) < SETTINGS.line.level]
    for line, logs in sorted(clear, key=lambda pair: -pair[0].height):
        least = SETTINGS.line.signal_share * line.height
        if any(height_at(s, line.frequency) >= least for s in _signals(runs, fitter.records)):
            continue
        turning = (_at_times_of(logs, shaft) for shaft in _shafts(runs))
        over_turns = (height_over_turns(logs, rates, line.frequency) for rates in turning)
        if all(height < line.height for height in over_turns):
            return line
    return None


def _signals(runs: Sequence[Run], records: Sequence[Record]) -> list[list[Series]]:
    """What missing physics may depend on: inputs, states and outputs as simulated, and their like.

    The square of a sine has a line at twice its frequency, the slope of a staircase one at the
    beat of its steps. Of the records' times alone: a line stands the higher the longer a log is.
    """
    ends = [(record.time[0], record.time[-1]) for record in records]
    passed = [(low <= r.time) & (r.time <= high) for r, (low, high) in zip(runs, ends, strict=True)]
    names = [n for n in runs[0].signals if n != "time" and all(n in run.signals for run in runs)]
    like = (lambda x: x, np.abs, lambda x: x * np.abs(x), lambda x: np.abs(np.gradient(x)))
    return [
        [(r.time[at], form(r.signals[name])[at]) for r, at in zip(runs, passed, strict=True)]
        for name in names
        for form in like
    ]


def _shafts(runs: Sequence[Run]) -> list[list[Series]]:
    """The angular velocities of the model at the samples of each log [rad/s], as measured.

    Over a run the simulated speed adds up to turns that never were: it serves where none is
    measured.
    """
    names = [n for n, unit in runs[0].units.items() if unit in _TURNING and n in runs[0].signals]
    return [[(run.time, _turning(run, name)) for run in runs] for name in names]


def _at_times_of(logs: Sequence[Series], shaft: Sequence[Series]) -> list[np.ndarray]:
    """A shaft's velocity where errors are passed: in a window of a log, and where it has a gap."""
    return [np.interp(time, *run) for (time, _), run in zip(logs, shaft, strict=True)]


def _turning(run: Run, name: str) -> np.ndarray:
    modelled = run.signals[name]
    rate = modelled
    if name in run.channels:
        measured = run.channels[name].measured
        finite = np.isfinite(measured)
        if finite.any():
            rate = np.interp(run.time, run.time[finite], measured[finite])
        if name in run.record.unsigned:
            rate = np.copysign(rate, modelled)
    return _TURNING[run.units[name]] * rate


def _places(context: SearchContext, channel: str) -> list[DrivingPort]:
    """The places at which a force may make the line of a channel, the nearest first."""
    places = context.fitter.places
    return [p for p in places if p.target == channel] or [p for p in places if p.state]


def free_name(context: SearchContext) -> str:
    """A name that neither a candidate nor an effect of the given model has."""
    taken = {*context.fitter.candidates, *(effect.name for effect in context.given.effects)}
    names = chain(["periodic_force"], (f"periodic_force_{k}" for k in count(2)))
    return next(name for name in names if name not in taken)


def _first_guess(
    context: SearchContext, place: DrivingPort, line: SpectralLine, name: str
) -> PeriodicForce:
    """The force of a line: through a state its swing is what integrates to that of the channel."""
    size = line.amplitude * (2.0 * np.pi * line.frequency if place.state else 1.0)
    unit = words_and_unit(context.given, place.port)[1]
    return PeriodicForce(place.port, line.frequency, size, unit=unit, name=name)


def _sized(force: PeriodicForce, stage: FittedStage) -> PeriodicForce | None:
    """The force in units of its root mean square over the training logs; ``None`` without any."""
    starts = _training_starts(force, stage, [run.record for run in stage.runs])
    swings = [np.hypot(s[f"{force.name}.sine"], s[f"{force.name}.cosine"]) for s in starts]
    factor = float(np.sqrt(np.mean(np.square(swings))))
    if not np.isfinite(factor) or factor == 0:
        return None
    return PeriodicForce(
        force.port, force.frequency, force.amplitude * factor, unit=force.unit, name=force.name
    )


def _training_starts(
    force: PeriodicForce, stage: FittedStage, records: Sequence[Record]
) -> list[dict[str, float]]:
    """Where a force begins in each training log or window of it, beside a stage or part of it."""
    starts = []
    for run, initial, record in zip(stage.runs, stage.fit.initial, records, strict=True):
        whole = len(record) == len(run.record)
        start = {**run.start, **initial} if whole else record.start
        starts.append(_start_in(force, stage.fit, run, record, start))
    return starts


def _start_in(
    force: PeriodicForce, fit: Fit, run: Run, record: Record, start: Mapping[str, float]
) -> dict[str, float]:
    model = fit.model if force.name in {e.name for e in fit.model.effects} else fit.model + force
    names = [f"{force.name}.{name}" for name in force.free_starts]
    others = {n: value for n, value in start.items() if n not in names}
    unsettled = replace(record, start={n: v for n, v in record.start.items() if n not in names})
    return estimated_start(model, unsettled, others, names, run.substeps)


def _first_half(record: Record) -> Record:
    """A record without the measurements of its second half."""
    early = record.time <= 0.5 * (record.time[0] + record.time[-1])
    measured = {n: np.where(early, values, np.nan) for n, values in record.measured.items()}
    return replace(record, measured=measured)


def _with_candidate(
    context: SearchContext, state: SearchState, force: PeriodicForce
) -> tuple[SearchContext, SearchState]:
    """The search with a force among its candidates, which begins as it does at the last stage."""
    fitter, last = context.fitter, state.stages[-1]
    with context.clock("compile"):
        train = _begun(context.records, _training_starts(force, last, context.records))
        windows = train
        if any(len(w) < len(r) for w, r in zip(fitter.records, context.records, strict=True)):
            windows = _begun(fitter.records, _training_starts(force, last, fitter.records))
        halves = [(run, _first_half(run.record)) for run in last.unseen_runs]
        starts = [_start_in(force, last.fit, run, half, run.start) for run, half in halves]
        unseen = _begun(context.unseen, starts)
        candidates = {**fitter.candidates, force.name: force}
        wider, trial = compiled_fitter(
            state.stages[0].fit,
            [*candidates.values()],
            fitter.constants,
            train,
            unseen,
            windows,
            state.current.trial,
            (fitter.substeps, last.fit.substeps),
        )
    refit = replace(context.refit, train=train)
    context = replace(context, fitter=wider, unseen=unseen, refit=refit)
    return context, replace(state, current=CurrentModel(wider, trial))


def _begun(records: Sequence[Record], starts: Sequence[Mapping[str, float]]) -> tuple[Record, ...]:
    """Records that say where a force begins in them."""
    return tuple(
        replace(record, start={**record.start, **start})
        for record, start in zip(records, starts, strict=True)
    )


def _trial_with(context: SearchContext, state: SearchState, force: PeriodicForce) -> TrialFit:
    """The current model with the force, fitted in the innovations form."""
    current = state.current.trial
    values = {f"{force.name}.{n}": getattr(force, n) for n in ("frequency", "amplitude")}
    with context.clock("screen"):
        return context.fitter.settled(
            (*current.effects, force.name),
            {**current.values, **values},
            current.initial_states,
            current.clip,
        )
