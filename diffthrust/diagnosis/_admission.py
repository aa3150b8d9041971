"""Accept or refuse an effect that was tried, and drop the effects that it makes superfluous."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from diffthrust.diagnosis._candidates import with_candidates
from diffthrust.diagnosis._criteria import criterion, missed, no_better, price_of, unseen_gain
from diffthrust.diagnosis._explained_share import (
    Worth,
    explained_share,
    matters,
    negligible,
    surely_less,
)
from diffthrust.diagnosis._findings import Refusal, Stage
from diffthrust.diagnosis._innovations_fit import CandidateFitter, with_values
from diffthrust.diagnosis._rating import Tried
from diffthrust.diagnosis._residual_structure import gain_of
from diffthrust.diagnosis._screening import does_nothing
from diffthrust.diagnosis._search_start import few_substeps
from diffthrust.diagnosis._search_state import CurrentModel, FittedStage, SearchContext, SearchState
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._simulation_fit import change_between, fitted_beside, fitted_to_runs
from diffthrust.estimation._multistart import NOTICED
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model
from diffthrust.simulation._runs import Run

_MORE_STARTS = 6
"""Numerics: starts of a fit that ended worse than the one that is nested in it."""
_NEAR = 0.1
"""Numerics: a share of their mean. Numbers by log that lie nearer to it are fitted as one, too."""
_UNLIMITED = 100.0
"""Numerics: a limit of so many times its guess limits nothing, as its null, infinity, does: without
it in a fit's first guess a Kingfisher's rate limit ended worse than without, and was fitted again
from six starts, for four minutes."""


def admit(
    context: SearchContext, state: SearchState, tried: Tried, proven: bool = False
) -> SearchState | Refusal:
    """Add an effect, or return the reason for its refusal.

    An effect that matters over whole runs gets a stage of its own, any other that is accepted is
    recorded as detectable. A state with neither means that the effect proved superfluous.

    Args:
        context: what the search works with.
        state: the search so far.
        tried: the effect.
        proven: whole unseen runs support the effect. Their one-step errors, in which random forces
            can take its place, are then not consulted.
    """
    fitter, current, (candidate, trial) = context.fitter, state.current, tried
    context.say(f"stage {state.number + 1}: {candidate.effect} in whole runs", state.share(0.5))
    if not comparable(context, current, tried):
        return Refusal.SMALL_PART
    with context.clock("screen"):
        settled = fitter.settled(trial.effects, trial.values, trial.initial_states, trial.clip)
    unseen = unseen_gain(fitter, current.trial, settled)
    if not proven and candidate.delta_bic - 2 * min(unseen, 0.0) > -fitter.least_gain:
        return Refusal.UNSEEN_LOGS
    added = replace(state, current=CurrentModel(fitter, settled))
    with context.clock("remaining"):  # a freed constant may absorb any error
        if candidate.effect in fitter.constants and added.current.remaining is not None:
            return Refusal.TAKES_UP
    fewer = drop(fitter, added)
    if {*fewer.current.trial.effects} == {*current.trial.effects}:
        return fewer
    outcome = reject_if_negligible(context, fewer, candidate.effect)
    outcome = outcome or reject_if_unborne(context, fewer, candidate.effect)
    if outcome is not None:
        return outcome
    context.say(f"stage {state.number + 1}: fitting with {candidate.effect}", state.share(0.7))
    last, fitted = state.stages[-1], refitted_stage(context, fewer)
    swapped = fewer.dropped != state.dropped and candidate.effect in fewer.current.trial.effects
    if swapped and missed(last, fitted):
        fewer, fitted = added, refitted_stage(context, added)
    if refusal := no_better(last, fitted):
        return refusal
    recorded = record_stage(context, fewer, fitted, candidate.effect)
    return without_idle(context, recorded) if recorded.stages[-1] is fitted else recorded


def idle_effects(stage: Stage, names: Sequence[str]) -> tuple[str, ...]:
    """Those of some effects of a stage that its fit has returned to their nulls.

    One-step errors may still ask for them: on the maps of a T200 an axial flow was kept beside a
    dead band and a reverse asymmetry, of 0.0 N s^2/(m rad) in whole runs, with a mass of 6e155 kg.
    """
    values = {name: e.value for name, e in stage.fit.parameters.items()}
    effects = (e for e in stage.fit.model.effects if e.name in names)
    return tuple(e.name for e in effects if does_nothing(e, values))


def without_idle(context: SearchContext, state: SearchState) -> SearchState:
    """The search without the older effects that do nothing in the fit of its last stage.

    The model without them is fitted again, from that fit, which is its own optimum. Where it ends
    worse all the same, they stay.
    """
    fitter, trial, stage = context.fitter, state.current.trial, state.stages[-1]
    idle = idle_effects(stage, state.stages[-2].effects)
    if not idle:
        return state
    values = trial.values
    for name in idle:
        values = fitter.absent(name, values)
    kept = tuple(n for n in trial.effects if n not in idle)
    settled = fitter.settled(kept, values, trial.initial_states, trial.clip)
    why = {name: (Refusal.IDLE, kept) for name in idle}
    fewer = replace(
        state,
        current=CurrentModel(fitter, settled),
        turned_down={**state.turned_down, **why},
    )
    fitted = refitted_stage(context, fewer)
    if no_better(state.stages[-2], fitted) or missed(stage, fitted):
        return state
    return replace(fewer, stages=(*state.stages[:-1], fitted))


def reject_if_negligible(
    context: SearchContext, state: SearchState, name: str
) -> SearchState | None:
    """Record an effect that changes next to nothing over whole runs as detectable.

    Trials fitted to whole runs decide, which saves a refit. ``None`` where they show any change,
    for better or worse: a fit from several starts then decides, because a trial may have ended
    early. On the logs of a boat one lowered the surge error by a third, and raised that of the yaw
    rate by half.
    """
    fitter, last, present = context.fitter, state.stages[-1], state.current.trial
    names = _of_stage(state)
    if name in fitter.constants or name not in names or not {*last.effects} <= {*names}:
        return None
    with context.clock("whole runs"):
        baseline = fitted_to_runs(fitter, last)
        change = change_between(fitter, baseline, fitted_beside(fitter, last, present, names))
    if not negligible(change.worth, change.everywhere):
        return None
    return replace(state, detectable=(*state.detectable, name))


def reject_if_unborne(context: SearchContext, state: SearchState, name: str) -> Refusal | None:
    """The refusal of a constant whose suggested value whole runs do not bear out, else ``None``.

    They are fitted with the constant held at the value that one-step errors want, and must err
    surely less than at the given one. On the static maps of a T200 one-step errors wanted a rate of
    0.03 1/s, fixed at 0.1, and whole runs err the same from 0.1 to 0.75.
    """
    fitter, last, names = context.fitter, state.stages[-1], _of_stage(state)
    if name not in fitter.constants or name not in names or not {*last.effects} <= {*names}:
        return None
    with context.clock("whole runs"):
        baseline = fitted_to_runs(fitter, last)
        moved = fitted_beside(fitter, last, state.current.trial, names, still=[name])
        change = change_between(fitter, baseline, moved)
    return None if surely_less(change.everywhere) else Refusal.NO_BETTER_RUNS


def _of_stage(state: SearchState) -> tuple[str, ...]:
    """The effects of the current model, without those that are only detectable."""
    return tuple(n for n in state.current.trial.effects if n not in state.detectable)


def record_stage(
    context: SearchContext, state: SearchState, fitted: FittedStage, name: str
) -> SearchState:
    """Record the newly fitted effect as a stage, or as only detectable."""
    last = state.stages[-1]
    without = [share for share in state.stages if {*share.effects} <= {*fitted.effects} - {name}]
    worth, everywhere = worths_between(without[-1], fitted)
    constant = name in context.fitter.constants  # a wrong constant biases all effects
    in_place_of_others = not {*last.effects} <= {*fitted.effects}
    if constant or matters(worth, everywhere) or in_place_of_others:
        return replace(state, stages=(*state.stages, fitted))
    return replace(state, detectable=(*state.detectable, name))


def worths_between(before: FittedStage, after: FittedStage) -> tuple[Worth, Worth]:
    """What the second of two stages removes, on unseen logs if there are any, and on all."""
    trained = errors_between(before.runs, after.runs)
    unseen = errors_between(before.unseen_runs, after.unseen_runs)
    return explained_share(unseen or trained), explained_share([*trained, *unseen])


def errors_between(*models: Sequence[Run]) -> list[dict[str, tuple[np.ndarray, ...]]]:
    """By log and channel what was measured, and the errors of each model over whole runs."""
    return [
        {
            name: (trace.measured, *(run.channels[name].residual for run in runs))
            for name, trace in runs[0].channels.items()
        }
        for runs in zip(*models, strict=True)
    ]


def comparable(context: SearchContext, present: CurrentModel, tried: Tried) -> bool:
    """Whether an effect explains enough of what an unknown function of one signal would explain.

    An effect that explains only a small share of it is refused, unless most of the effect's gain is
    independent: the function then gains nearly as much beside the effect as without it.
    """
    fitter, (candidate, trial) = context.fitter, tried
    with context.clock("remaining"):
        remaining = present.remaining
    if remaining is None:
        return True
    unknown = remaining.gain - SETTINGS.structure.knots * math.log(fitter.samples)
    if -candidate.delta_bic > SETTINGS.admission.least_share_of_unknown * unknown:
        return True
    with context.clock("remaining"):
        gain_beside = gain_of(fitter, trial, remaining)
    price = price_of(fitter, trial) + fitter.least_gain
    kept = candidate.likelihood_ratio - (remaining.gain - gain_beside)
    return kept > max(
        SETTINGS.admission.least_share_kept * candidate.likelihood_ratio,
        price,
    )


def drop(fitter: CandidateFitter, state: SearchState) -> SearchState:
    """Backward elimination of every effect without which the criterion is no worse.

    This includes the last one: its gain may have come from a better noise that its fit found.
    """
    effects = state.current.trial.effects
    for name in effects:
        present = state.current
        without = present.without(name)
        loss = 2 * (without.cost - present.trial.cost) - price_of(fitter, present.trial, name)
        if loss < SETTINGS.admission.clear_bic_gain:
            loss = criterion(fitter, without) - present.criterion
        if loss < fitter.least_gain:
            dropped = state.dropped if name == effects[-1] else (*state.dropped, name)
            detectable = tuple(n for n in state.detectable if n != name)
            state = replace(
                state, current=CurrentModel(fitter, without), dropped=dropped, detectable=detectable
            )
    return state


def refitted_stage(
    context: SearchContext, state: SearchState, starts: int = 0, substeps: int = 0
) -> FittedStage:
    """The current model without the effects that are only detectable, fitted to whole runs.

    What may differ by log is one value for all logs at first, and differs where that matters as an
    effect does: a steady current that each of a boat's logs had its own of stood in for a weak
    thruster, at an NRMSE of 0.69 where one current for all left 0.28.

    Args:
        context: what the search works with.
        state: the search, with the trial.
        starts: the trial's and random ones, if not the default number.
        substeps: integrator steps per sample of a fit that is only compared, which is made once; as
            many as it needs if not given.
    """
    if not substeps:
        return _alike_or_apart(context, state, starts, substeps)
    rivals, key = state.stages[-1].rivals, (_of_stage(state), substeps)
    if key not in rivals:
        rivals[key] = _alike_or_apart(context, state, starts, substeps)
    return rivals[key]


def _alike_or_apart(
    context: SearchContext, state: SearchState, starts: int, substeps: int
) -> FittedStage:
    """The fit with one value for all logs, or with a value each where that matters."""
    last, names = state.stages[-1], _of_stage(state)
    candidates = context.fitter.candidates
    refit = partial(context.refit, like=last.fit if substeps else None, substeps=substeps)
    model = with_candidates(context.given, names, candidates, like=last.fit.model)
    present = {effect.name for effect in last.fit.model.effects}
    new = [e for e in model.effects if e.differs and e.name not in present]
    if not new:
        apart = _refitted(context, state, model, starts, substeps)
        near = [e for e in apart.fit.model.effects if e.differs and _nearly_alike(e, apart)]
        if not near:
            return apart
        effects = {e.name: e.differing(False) if e in near else e for e in apart.fit.model.effects}
        values = {n: e.value for n, e in apart.fit.parameters.items()}
        model = with_values(with_candidates(context.given, names, effects), values)
        alike = FittedStage(names, *refit(model, starts=1))
        return _apart_where_it_matters(alike, apart)
    shared = {**candidates, **{e.name: e.differing(False) for e in new}}
    alike = with_candidates(context.given, names, shared, like=last.fit.model)
    fitted = _refitted(context, state, alike, starts, substeps)
    if not math.isfinite(fitted.train.nrmse):
        return _refitted(context, state, model, starts, substeps)
    values = {n: e.value for n, e in fitted.fit.parameters.items()}
    model = with_values(model, values)
    apart = FittedStage(names, *refit(model, starts=1))
    return _apart_where_it_matters(fitted, apart)


def _apart_where_it_matters(alike: FittedStage, apart: FittedStage) -> FittedStage:
    """Of two stages that with numbers by log, where these remove as much as an effect must."""
    better = no_better(alike, apart) is None and matters(*worths_between(alike, apart))
    return apart if better or not math.isfinite(alike.train.nrmse) else alike


def _nearly_alike(effect: Effect, stage: FittedStage) -> bool:
    """Whether an effect's numbers by log lie near their mean: one value may do, and is asked.

    While two drags were missing a current of its own in each log did a little for a boat; beside
    them the same current was left in all logs, to 2 %, told as "0.18 to 0.18 m/s".
    """
    numbers = [[log[f"{effect.name}.{n}"] for n in effect.by_log] for log in stage.fit.initial]
    mean = np.mean(numbers, axis=0)
    away = np.linalg.norm(numbers - mean, axis=1)
    return bool(np.all(away < _NEAR * np.linalg.norm(mean)))


def _refitted(
    context: SearchContext, state: SearchState, model: Model, starts: int, substeps: int
) -> FittedStage:
    """A model fitted to whole runs, as the next stage.

    The fit starts from the values of the trial, and from the last stage with the new effects at
    their nulls. Where it ends worse than that stage all the same, which is nested in it, it has not
    reached its optimum, and is made again from several starts.
    """
    last, names = state.stages[-1], _of_stage(state)
    candidates = context.fitter.candidates
    model = with_values(model, state.current.trial.values)
    start = {n: p.value for n, p in last.fit.model.parameters.items()}
    for name in ({*names} & {*candidates}) - {effect.name for effect in last.fit.model.effects}:
        start |= _at_null(candidates[name])
    free = {n for n, p in model.parameters.items() if not p.fixed}
    guess = {n: v for n, v in start.items() if n in free}
    if substeps:
        refit = partial(context.refit, like=last.fit, substeps=substeps)
    else:
        # the search goes by the steps that suffice for the last stage: those of the model as given
        # were 2 a sample for an NGS thruster, whose duct's water, once added, needs 16
        few = few_substeps(last.fit, context.records)
        refit = replace(context.refit, first_substeps=few)
    fitted = FittedStage(names, *refit(model, [guess], starts=starts))
    if ended_worse(fitted, last) and {*last.effects} <= {*names}:
        guesses = [guess, {n: v for n, v in context.guess.items() if n in free}]
        again = FittedStage(names, *refit(model, guesses, starts=_MORE_STARTS, segments=True))
        fitted = fitted if ended_worse(again, fitted, by=0.0) else again
    return fitted


def _at_null(effect: Effect) -> dict[str, float]:
    """The values of an effect by full name, each at its null, or where it does as good as that."""
    guess, null = effect._parameters, effect.at_null()._parameters
    return {
        f"{effect.name}.{n}": p.value if math.isfinite(p.value) else _UNLIMITED * guess[n].value
        for n, p in null.items()
    }


def ended(context: SearchContext, stage: FittedStage) -> FittedStage:
    """A stage that was only compared, fitted to its end with the integrator steps it needs."""
    model = stage.fit.model
    values = {n: p.value for n, p in model.parameters.items() if not p.fixed}
    fitted = FittedStage(stage.effects, *context.refit(model, [values], starts=1))
    return stage if ended_worse(fitted, stage) else fitted


def ended_worse(stage: FittedStage, other: FittedStage, by: float = NOTICED) -> bool:
    """Whether a fit ended worse than another of the same logs: by what both of them maximise.

    Errors by channel may grow where a likelihood rises, which weighs a channel by its readings: a
    boat whose north and east are read half as often as its heading gained 248 of log-likelihood
    while the mean of its errors grew, and was searched anew from six starts, for nothing. Fits on
    segments, or with other integrator steps, may maximise something else: their whole runs decide.
    """
    if not math.isfinite(stage.train.nrmse):
        return True
    ways = {(fit.horizon, fit.substeps) for fit in (stage.fit, other.fit)}
    if stage.fit.horizon is None and len(ways) == 1:
        return stage.fit.log_likelihood < other.fit.log_likelihood - by
    return missed(other, stage)
