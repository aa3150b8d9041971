"""Learn what no known effect explains: the likeliest law as a curve, and its closed form."""

from __future__ import annotations

from dataclasses import replace

from diffthrust.diagnosis._admit import left_of
from diffthrust.diagnosis._findings import Remaining
from diffthrust.diagnosis._groups import Grouped
from diffthrust.diagnosis._learned import LearnedLaw
from diffthrust.diagnosis._learning.beside import kept_beside
from diffthrust.diagnosis._learning.curves import hypothesis_of, law_of, with_fine_steps
from diffthrust.diagnosis._learning.evidence import likely_curves
from diffthrust.diagnosis._learning.fits import all_explained, as_good
from diffthrust.diagnosis._learning.naming import named
from diffthrust.diagnosis._learning.ranking import forgetful, likeliest, rival_law
from diffthrust.diagnosis._ports import DrivingPort
from diffthrust.diagnosis._search import Tools
from diffthrust.diagnosis._structure import behind
from diffthrust.diagnosis._trials import TrialFit
from diffthrust.estimation._result import Fit

_IMITATED = 0.5
"""A law may be what effects only imitated where one-step errors ask for it with at least so much of
what these effects gained,"""
_BETTER = 0.95
"""and it is, where whole runs err by no more than so many times as much with the law in their
place."""


def learned_law(tools: Tools, found: Grouped, first: TrialFit) -> tuple[Grouped, LearnedLaw] | None:
    """The law that no known effect expresses, where structure is proven; ``None`` if none is sure.

    It must make whole unseen runs surely better (training runs, where no log is unseen). Effects
    that were found without it may only have imitated it: they are sought again beside it.

    Args:
        tools: what the search worked with.
        found: what it found without a law.
        first: the trial of the model as given.

    Returns:
        The law, and what else is missing.
    """
    known = found.known
    if known.present.remaining is None:
        return None
    place, trial = _place(tools, known.present.remaining), known.present.trial
    begun, last = known.stages[0], known.stages[-1]
    base, law = begun, None
    if trial.effects:
        law = _learned_beside(tools, begun.fit, first, place, _IMITATED * (first.cost - trial.cost))
        law = law if law and as_good(law.told, last.fit, _BETTER) else None
    if law is None:
        base, law = last, _learned_beside(tools, last.fit, trial, place)
    if law is None:
        return None
    if trial.effects:
        beside, told = kept_beside(tools, found, first, law)
        now = beside.known
        if {*now.stages[-1].effects} != {*base.effects}:
            told = _beside_others(tools, now.stages[-1].fit, now.present.trial, told)
        if told and told.worth.sure and as_good(told.told, last.fit, 1.0):
            found, law = beside, told
        elif base is not last:
            return None  # else it goes with all of them alone
    return found, replace(law, worth=law.worth.of(left_of(found.known, found.known.stages[-1])))


def _beside_others(
    tools: Tools, before: Fit, trial: TrialFit, law: LearnedLaw
) -> LearnedLaw | None:
    """A law learned anew beside other effects; ``None`` where errors do not ask for it there."""
    likely = likely_curves(tools.trials, trial, [hypothesis_of(tools, trial, law.curve)])
    again = law_of(tools, before, trial, likely[0]) if likely else None
    if again is None:
        return None
    again = replace(again, superfluous=law.superfluous)
    return with_fine_steps(tools, before, named(tools, before, trial, again))


def _learned_beside(
    tools: Tools, before: Fit, trial: TrialFit, place: DrivingPort, least: float = 0.0
) -> LearnedLaw | None:
    """The likeliest law beside a model, or its rival, with its name; if whole runs surely improve.

    Unseen logs may go where the training logs tell nothing of a curve, and its form all the same.
    """
    likely = likeliest(tools, trial, place)
    if not likely or likely[0].evidence < least:
        return None
    found = [law_of(tools, before, trial, likely[0])]
    explained = found[0] is not None and all_explained(tools, trial, found[0].fit)
    sure = found[0] is not None and found[0].worth.sure
    rival = None if explained else rival_law(likely, sure)
    if rival:
        found.append(law_of(tools, before, trial, rival, found[0]))
    better = [law for law in found if law is not None]
    if not better:
        return None
    law = named(tools, before, trial, min(better, key=_doubt))
    plain = None if explained else forgetful(likely, law.curve)
    if plain and plain is not rival and (other := law_of(tools, before, trial, plain)):
        law = min(law, named(tools, before, trial, other), key=_doubt)
    law = with_fine_steps(tools, before, law)
    return law if law.worth.sure else None


def _doubt(law: LearnedLaw) -> tuple[bool, float]:
    """Whether a law is worth something surely, and then its error over whole runs."""
    return not law.worth.sure, law.told.train.nrmse


def _place(tools: Tools, left: Remaining) -> DrivingPort:
    """The place whose errors the structure explains."""
    places = tools.trials.places
    return next(p for p in places if left.port in (p.port, *behind(tools.trials, p)))
