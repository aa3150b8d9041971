"""Which effects are missing beside a learned law: those found without it may only imitate it."""

from __future__ import annotations

from dataclasses import replace

from diffthrust._support.errors import InputError
from diffthrust.diagnosis._admit import drop, refitted_stage
from diffthrust.diagnosis._equivalence import SearchResult
from diffthrust.diagnosis._explained_share import Worth, matters
from diffthrust.diagnosis._findings import Stage
from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit, with_values
from diffthrust.diagnosis._learned import LearnedLaw
from diffthrust.diagnosis._search_state import (
    LEARNING,
    CurrentModel,
    SearchContext,
    SearchState,
    compiled_fitter,
    few_substeps,
)
from diffthrust.diagnosis._simulation_fit import change_between, fitted_without


def kept_beside(
    tools: SearchContext, search: SearchResult, first: TrialFit, law: LearnedLaw
) -> tuple[SearchResult, LearnedLaw]:
    """The effects that are missing beside a law, and the law, told which are not.

    All that were found without it are put beside it, and those taken out that the information
    criterion does not ask for, or that change nothing over whole runs: the law is only learned, and
    small errors of it look like small effects.

    Args:
        tools: what the search worked with.
        search: what it found without the law.
        first: the trial of the model as given.
        law: as it was learned, beside the model as given or beside all that was found.
    """
    tools.say("what is missing beside what was learned", LEARNING)
    state = search.state
    names = state.current.trial.effects
    started = _begun(tools, law, state.current.trial)
    if started is None:
        return search, law
    trials, present = started
    present = drop(trials, SearchState(present, state.stages[:1], {})).current
    worth, trial = {}, present.trial
    if trial.effects:
        trial = fitted_without(trials, trial, trial.effects)
    for name in trial.effects:
        share, relevant = _worth_of(trials, trial, name, state.stages[0])
        if relevant or name in trials.constants:
            worth[name] = share
    kept = tuple(n for n in names if n in worth)
    superfluous = tuple(n for n in names if n not in worth)
    without_law = _without_law(tools, replace(state, worth=worth), first, kept)
    rivals = {g[0]: g for g in (*search.groups, *search.detectable_groups)}
    groups = tuple(rivals[n] for n in without_law.stages[-1].effects if n in rivals)
    return SearchResult(without_law, groups, ()), replace(law, superfluous=superfluous)


def _begun(
    tools: SearchContext, law: LearnedLaw, present: TrialFit
) -> tuple[CandidateFitter, CurrentModel] | None:
    """The effects of a trial put beside a law, fitted together; ``None`` where that cannot be."""
    trials, fit, names = tools.fitter, law.told, present.effects
    values = {n: p.value for n, p in fit.model.parameters.items()}
    model = tools.given + fit.model.effects[-1]
    # a constant that effects freed keeps its given value, to which taking it out goes back
    free = {n for n, p in model.parameters.items() if not p.fixed}
    model = with_values(model, {n: value for n, value in values.items() if n in free})
    start = replace(fit, model=model, substeps=few_substeps(fit, trials.logs))
    effects = [trials.candidates[n] for n in names if n in trials.candidates]
    held = [n for n in names if n in trials.constants]
    present = replace(present, values={**present.values, **values})
    try:
        beside, together = compiled_fitter(start, effects, held, trials.logs, tools.unseen, present)
    except InputError:  # the law goes with effects alone
        return None
    return beside, CurrentModel(beside, together)


def _worth_of(
    trials: CandidateFitter, trial: TrialFit, name: str, baseline: Stage
) -> tuple[Worth, bool]:
    """What an effect of a fit to whole runs removes of the first errors, and if it matters."""
    without = tuple(n for n in trial.effects if n != name)
    change = change_between(trials, fitted_without(trials, trial, without), trial)
    initial = baseline.holdout or baseline.train
    reduced = change.before.holdout or change.before.train
    remaining = (reduced.nrmse / initial.nrmse) ** 2 if initial.nrmse > 0 else 1.0
    return change.worth.of(remaining), matters(change.worth, change.everywhere)


def _without_law(
    tools: SearchContext, state: SearchState, first: TrialFit, kept: tuple[str, ...]
) -> SearchState:
    """What is known, with some of the effects alone."""
    trials, present = tools.fitter, state.current.trial
    dropped = tuple(n for n in present.effects if n not in kept)
    trial, values = first, dict(present.values)
    if kept:
        for name in dropped:
            values = trials.absent(name, values)
        trial = trials.settled(kept, values, present.begin, present.limit)
    state = replace(
        state,
        present=CurrentModel(trials, trial),
        stages=tuple(s for s in state.stages if {*s.effects} <= {*kept}),
        detectable=(),
        dropped=(*state.dropped, *dropped),
    )
    if {*state.stages[-1].effects} == {*kept}:
        return state
    return replace(state, stages=(*state.stages, refitted_stage(tools, state)))
