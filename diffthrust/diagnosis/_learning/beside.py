"""The search once more with a learned law in the model: which effects are missing beside it.

What was found without the law may only have imitated it.
"""

from __future__ import annotations

from dataclasses import replace

from diffthrust._support.errors import InputError
from diffthrust.diagnosis._admit import refitted
from diffthrust.diagnosis._findings import Stage
from diffthrust.diagnosis._groups import Grouped, grouped
from diffthrust.diagnosis._held import of_effect
from diffthrust.diagnosis._learned import LearnedLaw
from diffthrust.diagnosis._rounds import searched
from diffthrust.diagnosis._search import LEARNING, Present, SearchState, Tools, compiled
from diffthrust.diagnosis._trials import TrialFit


def sought_beside(
    tools: Tools, found: Grouped, first: TrialFit, law: LearnedLaw
) -> tuple[Grouped, LearnedLaw]:
    """The effects that are missing beside a law, and the law, told which only imitated it.

    Sought are those that were found without it, and those that the logs could not tell from them.

    Args:
        tools: what the search worked with.
        found: what it found without the law.
        first: the trial of the model as given.
        law: as it was learned, beside the model as given or beside all that was found.
    """
    names = {*found.known.present.trial.effects}.union(*found.groups, *found.detectable_groups)
    tools.say("what is missing beside what was learned", LEARNING)
    begun = _begun(tools, law, sorted(names))
    if begun is None:
        return found, law
    again, beside = begun
    with_law = beside.present.trial
    beside = searched(again, beside)
    left = _without_law(tools, found.known, first, beside)
    kept = {*beside.present.trial.effects}
    gone = tuple(n for n in found.known.present.trial.effects if n not in kept)
    return grouped(again, beside, with_law)._replace(known=left), replace(law, superfluous=gone)


def _begun(tools: Tools, law: LearnedLaw, names: list[str]) -> tuple[Tools, SearchState] | None:
    """The search for some effects beside a law; ``None`` where no trial can be begun."""
    trials, told = tools.trials, law.form.fit if law.form else law.fit
    model = tools.given + told.model.effects[-1]
    own = [n for n, p in model.parameters.items() if not p.fixed]
    if {*told.free} != {*own}:  # it was learned beside effects
        told = tools.refit(model, [{n: told.model.parameters[n].value for n in own}], starts=1)
    effects = [trials.candidates[n] for n in names if n in trials.candidates]
    held = [n for n in names if n in trials.held]
    try:
        alone, trial = compiled(told, effects, held, trials.logs, tools.unseen)
    except InputError:  # the law goes with effects alone
        return None
    again = replace(tools, given=told.model, trials=alone)
    return again, SearchState(Present(alone, trial), (Stage((), told),), {})


def _without_law(
    tools: Tools, known: SearchState, first: TrialFit, beside: SearchState
) -> SearchState:
    """What is known, with those effects alone that are missing beside a law."""
    trials, present = tools.trials, known.present.trial
    effects, kept = beside.present.trial.effects, {*beside.stages[-1].effects}
    gone = tuple(n for n in present.effects if n not in effects)
    trial, values = first, dict(present.values)
    if effects:
        for name in gone:
            values = trials.absent(name, values)
        theirs = beside.present.trial.values
        values |= {n: v for n, v in theirs.items() if any(of_effect(n, one) for one in effects)}
        trial = trials.settled(effects, values, present.begin, present.limit)
    known = replace(
        known,
        present=Present(trials, trial),
        stages=tuple(s for s in known.stages if {*s.effects} <= kept),
        detectable=beside.detectable,
        dropped=(*known.dropped, *gone),
        worth=beside.worth,
    )
    if {*known.stages[-1].effects} == kept:
        return known
    return replace(known, stages=(*known.stages, refitted(tools, known)))
