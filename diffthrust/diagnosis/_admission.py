"""Whether an effect that was tried is added: what it makes superfluous, and whether it matters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from diffthrust.diagnosis._criteria import (
    CLEAR,
    MARGIN,
    criterion,
    missed,
    no_better,
    price_of,
    unseen_gain,
)
from diffthrust.diagnosis._explained_share import BeforeAfter, explained_share, matters
from diffthrust.diagnosis._findings import Refusal, Stage
from diffthrust.diagnosis._held import with_candidates
from diffthrust.diagnosis._innovations_fit import CandidateFitter, with_values
from diffthrust.diagnosis._rating import Tried
from diffthrust.diagnosis._residual_structure import gain_of
from diffthrust.diagnosis._search_state import CurrentModel, SearchContext, SearchState
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._simulation_fit import change_between, fitted_beside, fitted_to_runs
from diffthrust.simulation._record import Record
from diffthrust.simulation._runs import runs_over

_PART = 0.3
"""An effect that explains less than this part of what an unknown signal does is not it."""
_OWN = 0.5
"""It is something else, and missing as well, if it keeps so much of its gain beside that signal."""


def admit(
    tools: SearchContext, known: SearchState, tried: Tried, proven: bool = False
) -> SearchState | Refusal:
    """Add an effect, with a stage of its own if it matters over whole runs, or say why not.

    Without a stage, a refusal, or a mention among the detectable it has turned out superfluous.

    Args:
        tools: what the search works with.
        known: what it knows.
        tried: the effect.
        proven: whole unseen runs speak for it: then their one-step errors, in which random forces
            may do the same, are not asked.
    """
    trials, before, (candidate, trial) = tools.fitter, known.current, tried
    if not comparable(tools, before, tried):
        return Refusal.SMALL_PART
    with tools.clock("screen"):
        settled = trials.settled(trial.effects, trial.values, trial.begin, trial.limit)
    unseen = unseen_gain(trials, before.trial, settled)
    if not proven and candidate.delta_bic - 2 * min(unseen, 0.0) > -MARGIN:
        return Refusal.UNSEEN_LOGS
    added = replace(known, current=CurrentModel(trials, settled))
    with tools.clock("remaining"):  # a constant may take up anything
        if candidate.effect in trials.constants and added.current.remaining is not None:
            return Refusal.TAKES_UP
    fewer = drop(trials, added)
    if {*fewer.current.trial.effects} == {*before.trial.effects}:
        return fewer
    outcome = reject_if_negligible(tools, fewer, candidate.effect)
    if outcome is not None:
        return outcome
    tools.say(f"refitting with {candidate.effect}", known.share(0.7))
    last, fitted = known.stages[-1], refitted_stage(tools, fewer)
    swapped = fewer.dropped != known.dropped and candidate.effect in fewer.current.trial.effects
    if swapped and missed(last, fitted):
        fewer, fitted = added, refitted_stage(tools, added)
    refusal = no_better(last, fitted)
    return refusal or record_stage(tools, fewer, fitted, candidate.effect)


def reject_if_negligible(
    tools: SearchContext, known: SearchState, name: str
) -> SearchState | Refusal | None:
    """What becomes of an effect that does nothing to whole runs, by trials: it is not refitted.

    ``None`` where it does, and where trials cannot tell: the stage that it leads to decides.
    """
    trials, last, present = tools.fitter, known.stages[-1], known.current.trial
    names = _of_stage(known)
    if name in trials.constants or name not in names or not {*last.effects} <= {*names}:
        return None
    with tools.clock("whole runs"):
        before = fitted_to_runs(trials, last)
        change = change_between(trials, before, fitted_beside(trials, last, present, names))
    if not math.isfinite(change.after.train.nrmse):
        return None
    if refusal := no_better(change.before, change.after):
        return refusal
    if matters(change.worth, change.everywhere):
        return None
    told = change.worth.of(remaining_share(known, last))
    return replace(known, worth={**known.worth, name: told}, detectable=(*known.detectable, name))


def remaining_share(known: SearchState, stage: Stage) -> float:
    """The share of the squared error of the model as given that is left at a stage."""
    begun, now = (s.holdout or s.train for s in (known.stages[0], stage))
    return (now.nrmse / begun.nrmse) ** 2 if begun.nrmse > 0 else 1.0


def _of_stage(known: SearchState) -> tuple[str, ...]:
    """The effects that a stage of the present model has: not those that are only detectable."""
    return tuple(n for n in known.current.trial.effects if n not in known.detectable)


def record_stage(tools: SearchContext, known: SearchState, fitted: Stage, name: str) -> SearchState:
    """The search with an effect that was just fitted: a stage more, or one more detectable."""
    last = known.stages[-1]
    without = [one for one in known.stages if {*one.effects} <= {*fitted.effects} - {name}]
    trained = errors_between(without[-1], fitted, tools.fitter.records, trained=True)
    unseen = errors_between(without[-1], fitted, tools.unseen)
    worth, everywhere = explained_share(unseen or trained), explained_share([*trained, *unseen])
    told = worth.of(remaining_share(known, without[-1]))
    known = replace(known, worth={**known.worth, name: told})
    in_place_of_others = not {*last.effects} <= {*fitted.effects}
    constant = name in tools.fitter.constants  # the others are wrong beside it, whatever runs say
    if constant or matters(worth, everywhere) or in_place_of_others:
        return replace(known, stages=(*known.stages, fitted))
    return replace(known, detectable=(*known.detectable, name))


def errors_between(
    before: Stage, after: Stage, records: Sequence[Record], trained: bool = False
) -> list[dict[str, BeforeAfter]]:
    """The errors of two stages over whole runs, log by log."""
    if not records:
        return []
    early, late = (
        runs_over(
            stage.fit.model,
            records,
            initial=stage.fit.initial if trained else None,
            substeps=stage.fit.substeps,
        )
        for stage in (before, after)
    )
    return [
        {
            name: BeforeAfter(trace.measured, trace.residual, new.channels[name].residual)
            for name, trace in old.channels.items()
        }
        for old, new in zip(early, late, strict=True)
    ]


def comparable(tools: SearchContext, present: CurrentModel, tried: Tried) -> bool:
    """Whether an effect explains what is missing, not a small part that it happens to touch.

    A function of one signal that no known effect is like may explain far more. What an effect
    explains is its own where that function explains as much beside it as it did alone.
    """
    trials, (candidate, trial) = tools.fitter, tried
    with tools.clock("remaining"):
        left = present.remaining
    if left is None:
        return True
    unknown = left.gain - SETTINGS.structure.knots * math.log(trials.samples)
    if -candidate.delta_bic > _PART * unknown:
        return True
    with tools.clock("remaining"):
        beside = gain_of(trials, trial, left)
    kept = candidate.likelihood_ratio - (left.gain - beside)
    return kept > max(_OWN * candidate.likelihood_ratio, price_of(trials, trial) + MARGIN)


def drop(trials: CandidateFitter, known: SearchState) -> SearchState:
    """Take out every effect without which the criterion is no worse.

    The last one too: on its way to the optimum the fit may have found a better noise.
    """
    effects = known.current.trial.effects
    for name in effects:
        present = known.current
        without = present.without(name)
        loss = 2 * (without.cost - present.trial.cost) - price_of(trials, present.trial, name)
        if loss < CLEAR:
            loss = criterion(trials, without) - present.criterion
        if loss < MARGIN:
            dropped = known.dropped if name == effects[-1] else (*known.dropped, name)
            detectable = tuple(n for n in known.detectable if n != name)
            known = replace(
                known, current=CurrentModel(trials, without), dropped=dropped, detectable=detectable
            )
    return known


def refitted_stage(tools: SearchContext, known: SearchState) -> Stage:
    """The present model without what is only detectable, fitted to whole runs.

    It begins at the values of its trial, and where the last stage ended with the new effects at
    their nulls, so that it ends no worse than that.
    """
    last, values = known.stages[-1].fit.model, known.current.trial.values
    names = _of_stage(known)
    candidates = tools.fitter.candidates
    model = with_values(with_candidates(tools.given, names, candidates), values)
    start = {n: p.value for n, p in last.parameters.items()}
    for name in ({*names} & {*candidates}) - {effect.name for effect in last.effects}:
        null = candidates[name].at_null()._parameters
        start |= {f"{name}.{n}": p.value for n, p in null.items() if math.isfinite(p.value)}
    free = {n for n, p in model.parameters.items() if not p.fixed}
    return Stage(names, tools.refit(model, [{n: v for n, v in start.items() if n in free}]))
