"""Learn what no effect explains: the likeliest term, fitted to whole runs and named.

One-step evidence is linearised; simulation decides close calls. Effects that were found without the
term may only have imitated it: they are put beside it, and eliminated if it does their work.
"""

from __future__ import annotations

import math
from dataclasses import replace

from diffthrust._support.errors import InputError
from diffthrust.diagnosis._admission import drop
from diffthrust.diagnosis._candidates import DrivingPort
from diffthrust.diagnosis._equivalence import SearchResult
from diffthrust.diagnosis._explained_share import matters
from diffthrust.diagnosis._innovations_fit import (
    CandidateFitter,
    TrialFit,
    side_by_side,
    with_values,
)
from diffthrust.diagnosis._learned import LearnedLaw
from diffthrust.diagnosis._residual_structure import place_of
from diffthrust.diagnosis._search_start import compiled_fitter, trial_substeps
from diffthrust.diagnosis._search_state import LEARNING, CurrentModel, SearchContext, SearchState
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._simulation_fit import change_between, fitted_from
from diffthrust.diagnosis._stage_fit import refitted_stage
from diffthrust.diagnosis._unknown_term.evidence import (
    LikelyCurve,
    likely_curves,
    tune_memory,
    with_jump,
)
from diffthrust.diagnosis._unknown_term.fit import (
    error_within,
    fit_curve,
    reaches_noise_floor,
    refined,
    term_of,
)
from diffthrust.diagnosis._unknown_term.form_fits import try_closed_forms
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

_SAME_EVIDENCE = 0.1
"""Numerics: terms whose evidence is this close are one term in two notations, and no rivals."""


def learned_law(
    context: SearchContext, search: SearchResult, first: TrialFit
) -> tuple[SearchResult, LearnedLaw] | None:
    """The law that no known effect expresses, if structure is proven; ``None`` if none is sure.

    Whole runs must surely be better with it, by the rule for effects (`matters`). Effects that were
    found without it are sought again beside it.

    Returns:
        What is missing beside the law, and the law.
    """
    state = search.state
    if state.current.remaining is None:
        return None
    place, trial = place_of(context.fitter, state.current.remaining.port), state.current.trial
    assert place is not None  # the structure was found there
    initial, last = state.stages[0], state.stages[-1]
    base, law = initial, None
    if trial.effects:  # do they only imitate a law? then it gains as much beside the given model
        imitated = SETTINGS.unknown_term.imitated_share * (first.cost - trial.cost)
        law = _learned_beside(context, initial.fit, first, place, imitated, last.fit)
        if law and not error_within(law.reported, last.fit, SETTINGS.unknown_term.replacing_error):
            law = None
    if law is None:
        base, law = last, _learned_beside(context, last.fit, trial, place)
    if law is None:
        return None
    if trial.effects:
        reduced, relearned = backward_elimination(context, search, first, law)
        stage = reduced.state.stages[-1]
        if {*stage.effects} != {*base.effects}:
            relearned = _relearned_beside(
                context, stage.fit, reduced.state.current.trial, relearned
            )
        if relearned and relearned.helps and error_within(relearned.reported, last.fit, 1.0):
            search, law = reduced, relearned
        elif base is not last:
            return None  # it was learned in the place of the effects, and loses against them
    return search, law


def _learned_beside(
    context: SearchContext,
    baseline: Fit,
    trial: TrialFit,
    place: DrivingPort,
    least_evidence: float = 0.0,
    instead: Fit | None = None,
) -> LearnedLaw | None:
    """The law of the likeliest term beside a model, or of its rival; if whole runs surely improve.

    ``instead`` is the fit in the place of which it would stand: a curve that errs far more is not
    followed. Of a boat with five effects, brought by them from an NRMSE of 1.25 to 0.008, three
    curves were fitted, with their closed forms, none below 1.2: a third of the diagnosis.

    A closed form is judged in the place of its curve: unseen logs may go where the training logs
    say nothing of the curve. But what a curve of any shape hardly lowers, no closed form does: of a
    BlueBoat the likeliest curves took the training error from 0.605 to 0.602, and their closed
    forms a ninth of the diagnosis.
    """
    likely = rank_terms(context, trial, place)
    if not likely or likely[0].evidence < least_evidence:
        return None
    likeliest = fit_curve(context, baseline, trial, likely[0])
    explained = likeliest is not None and reaches_noise_floor(context, trial, likeliest.fit)
    sure = likeliest is not None and likeliest.helps
    rival = None if explained else rival_of(likely, sure)
    challenger = fit_curve(context, baseline, trial, rival, likeliest) if rival else None
    fitted = [law for law in (likeliest, challenger) if law is not None]
    if not fitted:
        return None
    best = min(fitted, key=_doubt)
    if instead and not error_within(best.fit, instead, SETTINGS.unknown_term.hopeless_error):
        return None
    if _changes_little(best, baseline):
        return None
    law = try_closed_forms(context, baseline, trial, best)
    plain = None if explained else memoryless_variant(likely, law.curve)
    if plain and plain is not rival and (memoryless := fit_curve(context, baseline, trial, plain)):
        law = min(law, try_closed_forms(context, baseline, trial, memoryless), key=_doubt)
    law = refined(context, baseline, law)
    return law if law.helps else None


def _changes_little(law: LearnedLaw, baseline: Fit) -> bool:
    """Whether neither training nor unseen runs lose a share of squared error that counts.

    In all, or of a channel.
    """
    before, after, limits = baseline.train, law.fit.train, SETTINGS.whole_runs
    trained = 1.0 - (after.nrmse / before.nrmse) ** 2
    channels = [
        1.0 - (after.channels[n].nrmse / error.nrmse) ** 2 if error.nrmse > 0 else 0.0
        for n, error in before.channels.items()
    ]
    channels += [channel.share for channel in law.worth.channels.values()]
    return (
        max(trained, law.worth.share) <= limits.negligible_share
        and max(channels) <= limits.one_channel_share
    )


def _relearned_beside(
    context: SearchContext, baseline: Fit, trial: TrialFit, law: LearnedLaw
) -> LearnedLaw | None:
    """A law fitted again beside other effects; ``None`` if one-step errors do not support it.

    Coefficients of its curve were fixed where the effects that are now dropped could replace them.
    """
    likely = likely_curves(context.fitter, trial, [term_of(context, trial, law.curve)])
    relearned = fit_curve(context, baseline, trial, likely[0]) if likely else None
    if relearned is None:
        return None
    relearned = replace(relearned, superfluous=law.superfluous)
    return refined(context, baseline, try_closed_forms(context, baseline, trial, relearned))


def _doubt(law: LearnedLaw) -> tuple[bool, float]:
    """Sort key: laws that surely remove error first, then the least error over whole runs."""
    return not law.helps, law.reported.train.nrmse


def rank_terms(context: SearchContext, trial: TrialFit, place: DrivingPort) -> list[LikelyCurve]:
    """The terms that are worth a fit, the likeliest first; of equals the plainest first."""
    fitter, space = context.fitter, term_space(context.fitter, trial, place)
    curves = likely_curves(fitter, trial, single_signal_terms(space))
    if not curves:
        return []
    likeliest = [curve.term for curve in curves[: SETTINGS.unknown_term.most_multiplied]]
    curves += likely_curves(fitter, trial, product_terms(space, likeliest))
    curves.sort(key=lambda curve: -curve.evidence)
    # one signal has several first guesses of its memory: the likeliest comes last, and stays
    distinct = {curve.term[:3]: curve for curve in reversed(curves)}.values()
    least = SETTINGS.unknown_term.sharpened_evidence * curves[0].evidence
    near = [curve for curve in distinct if curve.evidence > least]
    curves = [curve for curve in distinct if curve.evidence <= least]

    def sharpened(curve: LikelyCurve) -> LikelyCurve:
        tuned = tune_memory(trial, space.regressors, curve)
        return with_jump(trial, space.regressors, tuned)

    curves += side_by_side(sharpened, near)
    tied = max(curve.evidence for curve in curves) - SETTINGS.unknown_term.indifferent_evidence
    curves = [c for c in curves if c.evidence > SETTINGS.unknown_term.least_evidence]
    curves.sort(key=lambda curve: (_plainness(curve.term), -curve.evidence))
    # of those tied with the likeliest the plainest is first
    curves.sort(key=lambda c: -c.evidence if c.evidence < tied else -math.inf)
    return curves


def rival_of(likely: list[LikelyCurve], sure: bool) -> LikelyCurve | None:
    """The likeliest term of another signal, if it is so close that whole runs may prefer it.

    It must be closer where these are ``sure`` of the likeliest.
    """
    first = likely[0]
    rivals = (curve for curve in likely[1:] if curve.term.signal != first.term.signal)
    apart = [curve for curve in rivals if abs(curve.evidence - first.evidence) >= _SAME_EVIDENCE]
    rival = max(apart, key=lambda curve: curve.evidence, default=None)
    rule = SETTINGS.unknown_term
    least = (rule.close_evidence if sure else rule.rival_evidence) * first.evidence
    return rival if rival and rival.evidence > least else None


def memoryless_variant(likely: list[LikelyCurve], curve: Curve) -> LikelyCurve | None:
    """The term of the plain signal where a curve's signal has a memory.

    A memory wins one-step errors easily, by a little; over whole runs the plain signal may do.
    """
    law = expression_of(curve.signal)
    signals = {*law.places} if law.memories else set()
    for candidate in likely:
        term = candidate.term
        if (term.port, term.times) == (curve.port, curve.times) and term.signal in signals:
            return candidate
    return None


def _plainness(term: Term) -> tuple[int, bool, int]:
    """Sorts sums before factors of what arrives, and these before other products."""
    factor = ("", ARRIVING, term.times).index(term.times)
    return factor, ARRIVING in expression_of(term.signal).places, len(term.signal)


def backward_elimination(
    context: SearchContext, search: SearchResult, first: TrialFit, law: LearnedLaw
) -> tuple[SearchResult, LearnedLaw]:
    """The effects that are missing beside a law, and the law with its superfluous effects recorded.

    All effects that were found without the law are put beside it. An effect is dropped if the
    information criterion does not support it or if it changes nothing over whole runs: the law is
    an estimate, and its small errors look like small effects.
    """
    context.say("what is missing beside what was learned", LEARNING)
    state = search.state
    names = state.current.trial.effects
    started = _start_elimination(context, law, state.current.trial)
    if started is None:
        return search, law
    fitter, current = started
    current = drop(fitter, SearchState(current, state.stages[:1], {})).current
    trial = current.trial
    if trial.effects:
        trial = fitted_from(fitter, trial.values, trial.effects, trial.effects)
    relevant = {n for n in trial.effects if n in fitter.constants or _matters(fitter, trial, n)}
    kept = tuple(n for n in names if n in relevant)
    superfluous = tuple(n for n in names if n not in relevant)
    reduced = _restrict_to(context, state, first, kept)
    by_effect = {group[0]: group for group in (*search.groups, *search.detectable_groups)}
    groups = tuple(by_effect[n] for n in reduced.stages[-1].effects if n in by_effect)
    return SearchResult(reduced, groups, ()), replace(law, superfluous=superfluous)


def _start_elimination(
    context: SearchContext, law: LearnedLaw, trial: TrialFit
) -> tuple[CandidateFitter, CurrentModel] | None:
    """The effects of a trial beside a law, fitted together; ``None`` if that cannot be fitted."""
    fitter, fit, names = context.fitter, law.reported, trial.effects
    values = {n: p.value for n, p in fit.model.parameters.items()}
    model = context.given + fit.model.effects[-1]
    # a constant that effects freed keeps its given value, to which eliminating it goes back
    free = {n for n, p in model.parameters.items() if not p.fixed}
    model = with_values(model, {n: value for n, value in values.items() if n in free})
    start = replace(fit, model=model, substeps=trial_substeps(fit, context.records))
    effects = [fitter.candidates[n] for n in names if n in fitter.candidates]
    constants = [n for n in names if n in fitter.constants]
    trial = replace(trial, values={**trial.values, **values})
    try:
        beside, fitted = compiled_fitter(
            start, effects, constants, context.records, context.unseen, fitter.records, trial
        )
    except InputError:  # the law simulates only without the effects
        return None
    return beside, CurrentModel(beside, fitted)


def _matters(fitter: CandidateFitter, trial: TrialFit, name: str) -> bool:
    """Whether whole runs are surely better by an effect beside all others of a trial."""
    others = tuple(n for n in trial.effects if n != name)
    without = fitted_from(fitter, trial.values, trial.effects, others)
    return matters(change_between(fitter, without, trial))


def _restrict_to(
    context: SearchContext, state: SearchState, first: TrialFit, kept: tuple[str, ...]
) -> SearchState:
    """The state of the search without the law, with some of its effects only."""
    fitter, current = context.fitter, state.current.trial
    dropped = tuple(n for n in current.effects if n not in kept)
    trial = fitter.settled_without(current, dropped) if kept else first
    state = replace(
        state,
        current=CurrentModel(fitter, trial),
        stages=tuple(stage for stage in state.stages if {*stage.effects} <= {*kept}),
        detectable=(),
        dropped=(*state.dropped, *dropped),
        beside={} if dropped else state.beside,
    )
    if {*state.stages[-1].effects} == {*kept}:
        return state
    return replace(state, stages=(*state.stages, refitted_stage(context, state)))
