"""Which effects are missing beside a learned law: those found without it may only imitate it."""

from __future__ import annotations

from dataclasses import replace

from diffthrust._support.errors import InputError
from diffthrust.diagnosis._admit import drop, refitted
from diffthrust.diagnosis._findings import Stage
from diffthrust.diagnosis._groups import Grouped
from diffthrust.diagnosis._learned import LearnedLaw
from diffthrust.diagnosis._search import (
    LEARNING,
    Present,
    SearchState,
    Tools,
    compiled,
    few_substeps,
)
from diffthrust.diagnosis._trials import TrialFit, Trials, with_values
from diffthrust.diagnosis._whole_fits import change_between, whole_of
from diffthrust.diagnosis._worth import Worth, matters


def kept_beside(
    tools: Tools, found: Grouped, first: TrialFit, law: LearnedLaw
) -> tuple[Grouped, LearnedLaw]:
    """The effects that are missing beside a law, and the law, told which are not.

    All that were found without it are put beside it, and those taken out that the information
    criterion does not ask for, or that change nothing over whole runs: the law is only learned, and
    small errors of it look like small effects.

    Args:
        tools: what the search worked with.
        found: what it found without the law.
        first: the trial of the model as given.
        law: as it was learned, beside the model as given or beside all that was found.
    """
    tools.say("what is missing beside what was learned", LEARNING)
    known = found.known
    names = known.present.trial.effects
    begun = _begun(tools, law, known.present.trial)
    if begun is None:
        return found, law
    trials, present = begun
    present = drop(trials, SearchState(present, known.stages[:1], {})).present
    worth, whole = {}, present.trial
    if whole.effects:
        whole = whole_of(trials, whole, whole.effects)
    for name in whole.effects:
        told, does = _worth_of(trials, whole, name, known.stages[0])
        if does or name in trials.held:
            worth[name] = told
    kept = tuple(n for n in names if n in worth)
    gone = tuple(n for n in names if n not in worth)
    left = _without_law(tools, replace(known, worth=worth), first, kept)
    rivals = {g[0]: g for g in (*found.groups, *found.detectable_groups)}
    groups = tuple(rivals[n] for n in left.stages[-1].effects if n in rivals)
    return Grouped(left, groups, ()), replace(law, superfluous=gone)


def _begun(tools: Tools, law: LearnedLaw, found: TrialFit) -> tuple[Trials, Present] | None:
    """The effects of a trial put beside a law, fitted together; ``None`` where that cannot be."""
    trials, told, names = tools.trials, law.told, found.effects
    own = {n: p.value for n, p in told.model.parameters.items()}
    alone = tools.given + told.model.effects[-1]
    # a constant that effects freed keeps its given value, to which taking it out goes back
    free = {n for n, p in alone.parameters.items() if not p.fixed}
    alone = with_values(alone, {n: value for n, value in own.items() if n in free})
    begun = replace(told, model=alone, substeps=few_substeps(told, trials.logs))
    effects = [trials.candidates[n] for n in names if n in trials.candidates]
    held = [n for n in names if n in trials.held]
    found = replace(found, values={**found.values, **own})
    try:
        beside, together = compiled(begun, effects, held, trials.logs, tools.unseen, found)
    except InputError:  # the law goes with effects alone
        return None
    return beside, Present(beside, together)


def _worth_of(trials: Trials, whole: TrialFit, name: str, given: Stage) -> tuple[Worth, bool]:
    """What an effect of a fit to whole runs removes of the first errors, and if it matters."""
    rest = tuple(n for n in whole.effects if n != name)
    change = change_between(trials, whole_of(trials, whole, rest), whole)
    begun = given.holdout or given.train
    now = change.before.holdout or change.before.train
    part = (now.nrmse / begun.nrmse) ** 2 if begun.nrmse > 0 else 1.0
    return change.worth.of(part), matters(change.worth, change.everywhere)


def _without_law(
    tools: Tools, known: SearchState, first: TrialFit, kept: tuple[str, ...]
) -> SearchState:
    """What is known, with some of the effects alone."""
    trials, present = tools.trials, known.present.trial
    gone = tuple(n for n in present.effects if n not in kept)
    trial, values = first, dict(present.values)
    if kept:
        for name in gone:
            values = trials.absent(name, values)
        trial = trials.settled(kept, values, present.begin, present.limit)
    known = replace(
        known,
        present=Present(trials, trial),
        stages=tuple(s for s in known.stages if {*s.effects} <= {*kept}),
        detectable=(),
        dropped=(*known.dropped, *gone),
    )
    if {*known.stages[-1].effects} == {*kept}:
        return known
    return replace(known, stages=(*known.stages, refitted(tools, known)))
