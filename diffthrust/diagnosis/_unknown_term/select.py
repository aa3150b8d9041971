"""Laws that may be missing, by how likely one-step errors make them.

Learn what no known effect explains: the likeliest law as a curve, and its closed form.

Which effects are missing beside a learned law: those found without it may only imitate it.
"""

from __future__ import annotations

from dataclasses import replace

from diffthrust._support.errors import InputError
from diffthrust.diagnosis._admission import drop, refitted_stage, remaining_share
from diffthrust.diagnosis._equivalence import SearchResult
from diffthrust.diagnosis._explained_share import Worth, matters
from diffthrust.diagnosis._findings import Remaining, Stage
from diffthrust.diagnosis._innovations_fit import (
    CandidateFitter,
    TrialFit,
    side_by_side,
    with_values,
)
from diffthrust.diagnosis._learned import LearnedLaw
from diffthrust.diagnosis._ports import DrivingPort
from diffthrust.diagnosis._residual_structure import downstream_ports
from diffthrust.diagnosis._search_state import (
    LEARNING,
    CurrentModel,
    SearchContext,
    SearchState,
    compiled_fitter,
    few_substeps,
)
from diffthrust.diagnosis._simulation_fit import change_between, fitted_without
from diffthrust.diagnosis._unknown_term.evidence import LikelyCurve, likely_curves, tune_memory
from diffthrust.diagnosis._unknown_term.fit import (
    error_within,
    fit_curve,
    reaches_noise_floor,
    refine_steps,
    term_of,
    try_closed_forms,
)
from diffthrust.diagnosis._unknown_term.terms import (
    Term,
    product_terms,
    single_signal_terms,
    term_space,
)
from diffthrust.effects._curve import Curve
from diffthrust.effects._grammar import expression_of
from diffthrust.estimation._result import Fit
from diffthrust.models._base.made_effect import ARRIVING

_MOST_FACTORED = 8
"""The signals of so many of the likeliest laws are tried times another."""
_RIVAL_OF_SURE, _RIVAL_OF_UNSURE = 0.8, 0.6
"""Another law is fitted to whole runs as well, where its evidence is no less than so much of the
likeliest's, or so much where that is not surely worth anything there: to what errors from one
sample to the next say, laws answer straight, and whole runs decide."""
_TUNED = 0.6
"""What a law remembers is looked at closely, where its evidence is no less than so much of it."""
_TIED_EVIDENCE = 1.0
"""Of laws whose evidence is no further apart than this the plainer one is taken."""
_SAME_EVIDENCE = 0.1
"""One law in two ways of writing it is as likely but for so much."""
_LEAST_EVIDENCE = 10.0
"""Less evidence than this is not worth a fit."""


def rank_terms(tools: SearchContext, trial: TrialFit, place: DrivingPort) -> list[LikelyCurve]:
    """The laws that are worth a fit, the likeliest first; of equals the plainest."""
    trials, at = tools.fitter, term_space(tools.fitter, trial, place)
    curves = likely_curves(trials, trial, single_signal_terms(at))
    if not curves:
        return []
    curves += likely_curves(
        trials, trial, product_terms(at, [curve.law for curve in curves[:_MOST_FACTORED]])
    )
    curves.sort(key=lambda curve: -curve.evidence)
    distinct = {
        curve.law[:3]: curve for curve in reversed(curves)
    }  # of several guesses the likeliest
    least = _TUNED * curves[0].evidence
    near = [curve for curve in distinct.values() if curve.evidence > least]
    curves = [curve for curve in distinct.values() if curve.evidence <= least]
    curves += side_by_side(lambda curve: tune_memory(trials, trial, at.seen, curve), near)
    best = max(curve.evidence for curve in curves)
    curves.sort(
        key=lambda curve: (
            curve.evidence < best - _TIED_EVIDENCE,
            _plainness(curve.law),
            -curve.evidence,
        )
    )
    first = [curve for curve in curves if curve.evidence >= best - _TIED_EVIDENCE]
    remaining = sorted(curves[len(first) :], key=lambda curve: -curve.evidence)
    return [curve for curve in (*first, *remaining) if curve.evidence > _LEAST_EVIDENCE]


def rival_of(likely: list[LikelyCurve], sure: bool) -> LikelyCurve | None:
    """The likeliest law of another signal, where whole runs may choose that.

    Args:
        likely: the laws, the likeliest first.
        sure: whether that is surely worth something over whole runs.
    """
    first = likely[0]
    rivals = (curve for curve in likely[1:] if curve.law.signal != first.law.signal)
    # the same law in other words is as likely
    apart = [curve for curve in rivals if abs(curve.evidence - first.evidence) >= _SAME_EVIDENCE]
    rival = max(apart, key=lambda curve: curve.evidence, default=None)
    least = (_RIVAL_OF_SURE if sure else _RIVAL_OF_UNSURE) * first.evidence
    return rival if rival and rival.evidence > least else None


def memoryless_variant(likely: list[LikelyCurve], curve: Curve) -> LikelyCurve | None:
    """The law of the same signal as it is, where a law remembers: over whole runs it may do."""
    plain = expression_of(curve.signal).memories and {*expression_of(curve.signal).places}
    same = (
        candidate
        for candidate in likely
        if (candidate.law.port, candidate.law.times) == (curve.port, curve.times)
    )
    return next((candidate for candidate in same if candidate.law.signal in (plain or ())), None)


def _plainness(law: Term) -> tuple[int, bool, int]:
    times = ("", ARRIVING, law.times).index(law.times)
    return times, ARRIVING in expression_of(law.signal).places, len(law.signal)


_IMITATED = 0.5
"""A law may be what effects only imitated where one-step errors ask for it with at least so much of
what these effects gained,"""
_REPLACING_ERROR = 0.95
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
        law = law if law and error_within(law.told, last.fit, _REPLACING_ERROR) else None
    if law is None:
        base, law = last, _learned_beside(tools, last.fit, trial, place)
    if law is None:
        return None
    if trial.effects:
        beside, learned = backward_elimination(tools, search, first, law)
        updated = beside.state
        if {*updated.stages[-1].effects} != {*base.effects}:
            learned = _relearned_beside(
                tools, updated.stages[-1].fit, updated.current.trial, learned
            )
        if learned and learned.worth.sure and error_within(learned.told, last.fit, 1.0):
            search, law = beside, learned
        elif base is not last:
            return None  # else it goes with all of them alone
    return search, replace(
        law, worth=law.worth.of(remaining_share(search.state, search.state.stages[-1]))
    )


def _relearned_beside(
    tools: SearchContext, baseline: Fit, trial: TrialFit, law: LearnedLaw
) -> LearnedLaw | None:
    """A law learned anew beside other effects; ``None`` where errors do not ask for it there."""
    likely = likely_curves(tools.fitter, trial, [term_of(tools, trial, law.curve)])
    relearned = fit_curve(tools, baseline, trial, likely[0]) if likely else None
    if relearned is None:
        return None
    relearned = replace(relearned, superfluous=law.superfluous)
    return refine_steps(tools, baseline, try_closed_forms(tools, baseline, trial, relearned))


def _learned_beside(
    tools: SearchContext, baseline: Fit, trial: TrialFit, place: DrivingPort, least: float = 0.0
) -> LearnedLaw | None:
    """The likeliest law beside a model, or its rival, with its name; if whole runs surely improve.

    Unseen logs may go where the training logs tell nothing of a curve, and its form all the same.
    """
    likely = rank_terms(tools, trial, place)
    if not likely or likely[0].evidence < least:
        return None
    fitted = [fit_curve(tools, baseline, trial, likely[0])]
    explained = fitted[0] is not None and reaches_noise_floor(tools, trial, fitted[0].fit)
    sure = fitted[0] is not None and fitted[0].worth.sure
    rival = None if explained else rival_of(likely, sure)
    if rival:
        fitted.append(fit_curve(tools, baseline, trial, rival, fitted[0]))
    better = [law for law in fitted if law is not None]
    if not better:
        return None
    law = try_closed_forms(tools, baseline, trial, min(better, key=_doubt))
    plain = None if explained else memoryless_variant(likely, law.curve)
    if plain and plain is not rival and (memoryless := fit_curve(tools, baseline, trial, plain)):
        law = min(law, try_closed_forms(tools, baseline, trial, memoryless), key=_doubt)
    law = refine_steps(tools, baseline, law)
    return law if law.worth.sure else None


def _doubt(law: LearnedLaw) -> tuple[bool, float]:
    """Whether a law is worth something surely, and then its error over whole runs."""
    return not law.worth.sure, law.told.train.nrmse


def _place(tools: SearchContext, remaining: Remaining) -> DrivingPort:
    """The place whose errors the structure explains."""
    places = tools.fitter.places
    return next(p for p in places if remaining.port in (p.port, *downstream_ports(tools.fitter, p)))


def backward_elimination(
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
    started = _start_search(tools, law, state.current.trial)
    if started is None:
        return search, law
    trials, present = started
    present = drop(trials, SearchState(present, state.stages[:1], {})).current
    worth, trial = {}, present.trial
    if trial.effects:
        trial = fitted_without(trials, trial, trial.effects)
    for name in trial.effects:
        share, relevant = _share_of(trials, trial, name, state.stages[0])
        if relevant or name in trials.constants:
            worth[name] = share
    kept = tuple(n for n in names if n in worth)
    superfluous = tuple(n for n in names if n not in worth)
    without_law = _restrict_to(tools, replace(state, worth=worth), first, kept)
    rivals = {g[0]: g for g in (*search.groups, *search.detectable_groups)}
    groups = tuple(rivals[n] for n in without_law.stages[-1].effects if n in rivals)
    return SearchResult(without_law, groups, ()), replace(law, superfluous=superfluous)


def _start_search(
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


def _share_of(
    trials: CandidateFitter, trial: TrialFit, name: str, baseline: Stage
) -> tuple[Worth, bool]:
    """What an effect of a fit to whole runs removes of the first errors, and if it matters."""
    without = tuple(n for n in trial.effects if n != name)
    change = change_between(trials, fitted_without(trials, trial, without), trial)
    initial = baseline.holdout or baseline.train
    reduced = change.before.holdout or change.before.train
    remaining = (reduced.nrmse / initial.nrmse) ** 2 if initial.nrmse > 0 else 1.0
    return change.worth.of(remaining), matters(change.worth, change.everywhere)


def _restrict_to(
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
        current=CurrentModel(trials, trial),
        stages=tuple(s for s in state.stages if {*s.effects} <= {*kept}),
        detectable=(),
        dropped=(*state.dropped, *dropped),
    )
    if {*state.stages[-1].effects} == {*kept}:
        return state
    return replace(state, stages=(*state.stages, refitted_stage(tools, state)))
