"""Accept or refuse an effect that was tried, and drop the effects that it makes superfluous."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TypeGuard

from diffthrust.diagnosis._criteria import criterion, missed, no_better, price_of, unseen_gain
from diffthrust.diagnosis._explained_share import matters, negligible, surely_less
from diffthrust.diagnosis._findings import Refusal, Stage
from diffthrust.diagnosis._innovations_fit import CandidateFitter
from diffthrust.diagnosis._rating import Tried
from diffthrust.diagnosis._residual_structure import gain_of
from diffthrust.diagnosis._screening import does_nothing
from diffthrust.diagnosis._search_start import few_substeps
from diffthrust.diagnosis._search_state import CurrentModel, FittedStage, SearchContext, SearchState
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._simulation_fit import change_between, fitted_beside, fitted_to_runs
from diffthrust.diagnosis._stage_fit import (
    compared_stage,
    fitted_to_its_end,
    refitted_stage,
    stage_effects,
    worth_between,
)


def admit(
    context: SearchContext, state: SearchState, tried: Tried, proven: bool = False
) -> SearchState | Refusal:
    """Add an effect, or return the reason for its refusal.

    An effect that matters over whole runs gets a stage of its own, any other that is accepted is
    recorded as detectable. A state with neither means that the effect proved superfluous. Where
    whole unseen runs support it (``proven``), their one-step errors, in which random forces can
    take its place, are not consulted.
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
    swapped = fewer.dropped != state.dropped and candidate.effect in fewer.current.trial.effects
    return _fitted_and_recorded(context, fewer, candidate.effect, added if swapped else None)


def _fitted_and_recorded(
    context: SearchContext, state: SearchState, name: str, undropped: SearchState | None
) -> SearchState | Refusal:
    """Fit the model with a new effect to whole runs, and record it unless these refuse it.

    Where the last stage needs many integrator steps, with few first, and to its end only if it is
    kept: beside the dead band of a Kingfisher, which needs 16 a sample, five effects were found
    detectable in a minute or two each, as 2 show as well. Where effects were dropped, and runs err
    more without them, the search with all (``undropped``) goes on.
    """
    last = state.stages[-1]
    few = few_substeps(last.fit, context.records)
    fit = refitted_stage if few == last.fit.substeps else partial(compared_stage, anew=True)
    fitted = fit(context, state)
    if undropped and missed(last, fitted):
        state, fitted = undropped, fit(context, undropped)
    outcome = _recorded(context, state, fitted, name)
    if few == fitted.fit.substeps < last.fit.substeps and _is_kept(outcome, fitted):
        # what few steps made of it must not count
        fitted = fitted_to_its_end(context, fitted)
        outcome = _recorded(context, state, fitted, name)
    return without_idle(context, outcome) if _is_kept(outcome, fitted) else outcome


def _recorded(
    context: SearchContext, state: SearchState, fitted: FittedStage, name: str
) -> SearchState | Refusal:
    """The search with a fit as a stage or as detectable, or why whole runs refuse it."""
    return no_better(state.stages[-1], fitted) or record_stage(context, state, fitted, name)


def _is_kept(outcome: SearchState | Refusal, fitted: FittedStage) -> TypeGuard[SearchState]:
    """Whether a fit became a stage."""
    return isinstance(outcome, SearchState) and outcome.stages[-1] is fitted


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
    settled = fitter.settled_without(trial, idle)
    why = {name: (Refusal.IDLE, settled.effects) for name in idle}
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
    names = stage_effects(state)
    if name in fitter.constants or name not in names or not {*last.effects} <= {*names}:
        return None
    with context.clock("whole runs"):
        baseline = fitted_to_runs(fitter, last)
        change = change_between(fitter, baseline, fitted_beside(fitter, last, present, names))
    if not negligible(change):
        return None
    return replace(state, detectable=(*state.detectable, name))


def reject_if_unborne(context: SearchContext, state: SearchState, name: str) -> Refusal | None:
    """The refusal of a constant whose suggested value whole runs do not bear out, else ``None``.

    They are fitted with the constant held at the value that one-step errors want, and must err
    surely less than at the given one. On the static maps of a T200 one-step errors wanted a rate of
    0.03 1/s, fixed at 0.1, and whole runs err the same from 0.1 to 0.75.
    """
    fitter, last, names = context.fitter, state.stages[-1], stage_effects(state)
    if name not in fitter.constants or name not in names or not {*last.effects} <= {*names}:
        return None
    with context.clock("whole runs"):
        baseline = fitted_to_runs(fitter, last)
        moved = fitted_beside(fitter, last, state.current.trial, names, still=[name])
        change = change_between(fitter, baseline, moved)
    return None if surely_less(change.of_all) else Refusal.NO_BETTER_RUNS


def record_stage(
    context: SearchContext, state: SearchState, fitted: FittedStage, name: str
) -> SearchState:
    """Record the newly fitted effect as a stage, or as only detectable."""
    last = state.stages[-1]
    without = [share for share in state.stages if {*share.effects} <= {*fitted.effects} - {name}]
    worth = worth_between(without[-1], fitted)
    constant = name in context.fitter.constants  # a wrong constant biases all effects
    in_place_of_others = not {*last.effects} <= {*fitted.effects}
    if constant or matters(worth) or in_place_of_others:
        return replace(state, stages=(*state.stages, fitted))
    return replace(state, detectable=(*state.detectable, name))


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
    return kept > max(SETTINGS.admission.least_share_kept * candidate.likelihood_ratio, price)


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
