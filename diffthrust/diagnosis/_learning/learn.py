"""Learn what no known effect explains: the likeliest law as a curve, and its closed form."""

from __future__ import annotations

from dataclasses import replace

from diffthrust.diagnosis._admit import remaining_share
from diffthrust.diagnosis._equivalence import SearchResult
from diffthrust.diagnosis._findings import Remaining
from diffthrust.diagnosis._innovations_fit import TrialFit
from diffthrust.diagnosis._learned import LearnedLaw
from diffthrust.diagnosis._learning.beside import kept_beside
from diffthrust.diagnosis._learning.curves import hypothesis_of, law_of, with_fine_steps
from diffthrust.diagnosis._learning.evidence import likely_curves
from diffthrust.diagnosis._learning.fits import all_explained, as_good
from diffthrust.diagnosis._learning.naming import named
from diffthrust.diagnosis._learning.ranking import forgetful, likeliest, rival_law
from diffthrust.diagnosis._ports import DrivingPort
from diffthrust.diagnosis._search_state import SearchContext
from diffthrust.diagnosis._structure import behind
from diffthrust.estimation._result import Fit

_IMITATED = 0.5
"""A law may be what effects only imitated where one-step errors ask for it with at least so much of
what these effects gained,"""
_BETTER = 0.95
"""and it is, where whole runs err by no more than so many times as much with the law in their
place."""


def learned_law(
    tools: SearchContext, search: SearchResult, first: TrialFit
) -> tuple[SearchResult, LearnedLaw] | None:
    """The law that no known effect expresses, where structure is proven; ``None`` if none is sure.

    It must make whole unseen runs surely better (training runs, where no log is unseen). Effects
    that were found without it may only have imitated it: they are sought again beside it.

    Args:
        tools: what the search worked with.
        search: what it found without a law.
        first: the trial of the model as given.

    Returns:
        The law, and what else is missing.
    """
    state = search.state
    if state.current.remaining is None:
        return None
    place, trial = _place(tools, state.current.remaining), state.current.trial
    first_stage, last = state.stages[0], state.stages[-1]
    base, law = first_stage, None
    if trial.effects:
        law = _learned_beside(
            tools, first_stage.fit, first, place, _IMITATED * (first.cost - trial.cost)
        )
        law = law if law and as_good(law.told, last.fit, _BETTER) else None
    if law is None:
        base, law = last, _learned_beside(tools, last.fit, trial, place)
    if law is None:
        return None
    if trial.effects:
        beside, learned = kept_beside(tools, search, first, law)
        updated = beside.state
        if {*updated.stages[-1].effects} != {*base.effects}:
            learned = _beside_others(tools, updated.stages[-1].fit, updated.current.trial, learned)
        if learned and learned.worth.sure and as_good(learned.told, last.fit, 1.0):
            search, law = beside, learned
        elif base is not last:
            return None  # else it goes with all of them alone
    return search, replace(
        law, worth=law.worth.of(remaining_share(search.state, search.state.stages[-1]))
    )


def _beside_others(
    tools: SearchContext, baseline: Fit, trial: TrialFit, law: LearnedLaw
) -> LearnedLaw | None:
    """A law learned anew beside other effects; ``None`` where errors do not ask for it there."""
    likely = likely_curves(tools.fitter, trial, [hypothesis_of(tools, trial, law.curve)])
    relearned = law_of(tools, baseline, trial, likely[0]) if likely else None
    if relearned is None:
        return None
    relearned = replace(relearned, superfluous=law.superfluous)
    return with_fine_steps(tools, baseline, named(tools, baseline, trial, relearned))


def _learned_beside(
    tools: SearchContext, baseline: Fit, trial: TrialFit, place: DrivingPort, least: float = 0.0
) -> LearnedLaw | None:
    """The likeliest law beside a model, or its rival, with its name; if whole runs surely improve.

    Unseen logs may go where the training logs tell nothing of a curve, and its form all the same.
    """
    likely = likeliest(tools, trial, place)
    if not likely or likely[0].evidence < least:
        return None
    fitted = [law_of(tools, baseline, trial, likely[0])]
    explained = fitted[0] is not None and all_explained(tools, trial, fitted[0].fit)
    sure = fitted[0] is not None and fitted[0].worth.sure
    rival = None if explained else rival_law(likely, sure)
    if rival:
        fitted.append(law_of(tools, baseline, trial, rival, fitted[0]))
    better = [law for law in fitted if law is not None]
    if not better:
        return None
    law = named(tools, baseline, trial, min(better, key=_doubt))
    plain = None if explained else forgetful(likely, law.curve)
    if plain and plain is not rival and (memoryless := law_of(tools, baseline, trial, plain)):
        law = min(law, named(tools, baseline, trial, memoryless), key=_doubt)
    law = with_fine_steps(tools, baseline, law)
    return law if law.worth.sure else None


def _doubt(law: LearnedLaw) -> tuple[bool, float]:
    """Whether a law is worth something surely, and then its error over whole runs."""
    return not law.worth.sure, law.told.train.nrmse


def _place(tools: SearchContext, remaining: Remaining) -> DrivingPort:
    """The place whose errors the structure explains."""
    places = tools.fitter.places
    return next(p for p in places if remaining.port in (p.port, *behind(tools.fitter, p)))
