"""What follows from a search: its effects, its last model against the logs, laws and changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from diffthrust.diagnosis._changed_size import changed_size
from diffthrust.diagnosis._criteria import held_values
from diffthrust.diagnosis._equivalence import SearchResult
from diffthrust.diagnosis._explained_share import Worth
from diffthrust.diagnosis._findings import (
    Assessment,
    OddLog,
    Selection,
    Stage,
    headroom_between,
    verdict_evidence,
)
from diffthrust.diagnosis._innovations_fit import TrialFit
from diffthrust.diagnosis._learned import LearnedLaw
from diffthrust.diagnosis._missing import (
    Missing,
)
from diffthrust.diagnosis._missing_signal import missing_signals
from diffthrust.diagnosis._outlier_logs import no_longer_odd, odd_logs
from diffthrust.diagnosis._recurrence import recurring_shares
from diffthrust.diagnosis._search_state import LEARNING, SearchContext, SearchState
from diffthrust.diagnosis._set_aside import one_step_sizes, set_aside, upheld
from diffthrust.diagnosis._stage_shares import shares_by_effect
from diffthrust.diagnosis._unknown_term.fit import quick_fit, worth_between_fits
from diffthrust.diagnosis._unknown_term.select import learned_law
from diffthrust.diagnosis._unknown_term.state_terms import state_terms
from diffthrust.estimation._result import Fit
from diffthrust.simulation._runs import Run, runs_over


class Outcome(NamedTuple):
    """A search and what follows from it.

    Args:
        search: where it ended, and what the logs cannot tell apart.
        selection: its effects, as the result lists them.
        assessment: its last model against the logs.
        laws: what no known effect expresses: a curve, or terms of states that are not measured.
    """

    search: SearchResult
    selection: Selection
    assessment: Assessment
    laws: tuple[LearnedLaw, ...] = ()


def assessed(
    context: SearchContext, search: SearchResult, no_longer_odd: Sequence[str] = ()
) -> Outcome:
    """The effects that a search has selected, and its last model against the logs.

    Args:
        context: what the search worked with.
        search: where it ended.
        no_longer_odd: logs that a learned law has shown to agree with the others.
    """
    fitter, unseen, state = context.fitter, context.unseen, search.state
    trial, first, last = state.current.trial, state.stages[0], state.stages[-1]
    runs = (*last.trained.runs, *(last.judged.runs if unseen else ()))
    with context.clock("remaining"):
        remaining = state.current.remaining
    odd = odd_logs(fitter, trial, runs, structure=remaining is not None)
    odd = tuple(log for log in odd if log.log not in no_longer_odd)
    odd, others = upheld(context, last, odd)
    selection = selection_of(context, search)
    assessment = Assessment(
        before=first.judged,
        after=last.judged,
        trained=(first.trained, last.trained),
        one_step=one_step_sizes(fitter, trial),
        remaining=remaining,
        odd_logs=odd,
    )
    is_open = (
        remaining is not None
        or bool(assessment.after.hints)
        or bool(verdict_evidence(selection, assessment).far)
    )
    if is_open:
        assessment = set_aside(context, last, assessment, others)
    return Outcome(search, selection, assessment)


def as_given(context: SearchContext, state: SearchState) -> dict[str, Any]:
    """The model as given against logs in which nothing is sought: fields of `Diagnosis`.

    No log is accused, and no structure is told: both may be the mistake.
    """
    first = state.stages[0]
    selection = selection_of(context, SearchResult(state, (), ()))
    assessment = Assessment(
        before=first.judged,
        after=first.judged,
        trained=(first.trained, first.trained),
        one_step=one_step_sizes(context.fitter, state.current.trial),
        remaining=None,
    )
    return {**vars(selection), **vars(assessment), "verdict": "unexplained"}


def selection_of(context: SearchContext, search: SearchResult) -> Selection:
    """The effects that a search has selected, and what became of the other candidates."""
    state, fitter = search.state, context.fitter
    present, last = state.current.trial.effects, state.stages[-1]
    worth = {
        name: replace(share, beside_others=state.beside.get(name))
        for name, share in shares_by_effect(state.stages).items()
    } | {name: state.beside[name] for name in state.detectable if name in state.beside}
    untestable = untested(state)
    listed = {*present, *state.possible, *untestable, *fitter.constants}
    return Selection(
        best=tuple(last.fit.model.effects[len(context.given.effects) :]),
        groups=search.groups,
        stages=tuple(Stage(stage.effects, stage.fit) for stage in state.stages),
        ranking=state.ranking,
        untestable=untestable,
        dropped=state.dropped,
        exchanged=state.exchanged,
        refused={n: why for n, why in state.refused.items() if n not in present},
        silent=tuple(sorted(state.silent - {c.effect for c in state.ranking} - listed)),
        worth={n: share for n, share in worth.items() if n not in fitter.constants},
        detectable=state.detectable,
        detectable_groups=search.detectable_groups,
        held=held_values(context.given, state.current.trial),
    )


def untested(state: SearchState) -> dict[str, str]:
    """The effects that no stage could test, with the reason.

    What lowers the errors of whole runs is tested by them, though not by one-step errors; and what
    one stage could test, and a later one could not beside more effects, was tried.
    """
    tried = {candidate.effect for candidate in state.ranking}
    tested = {*state.current.trial.effects, *state.possible, *tried}
    return {name: why for name, why in state.untestable.items() if name not in tested}


def add_law(context: SearchContext, outcome: Outcome, baseline: TrialFit) -> Outcome:
    """The outcome with a learned law, where structure remains and a law surely explains it.

    The effects that were found without the law are sought once more beside it. A law that makes odd
    logs agree with the others is what they showed, so that they are set aside no more.
    """
    search, _, assessment, _ = outcome
    remaining = search.state.current.remaining
    if remaining is None:
        return outcome
    context.say("learning what none of the effects tried explains", LEARNING)
    with context.clock("learned"):
        learned = learned_law(context, search, baseline)
    if learned is None:
        return outcome
    updated, law = learned
    odd = [log for log in assessment.odd_logs if log.accused] if assessment.apart else []
    agree = agrees_with_law(context, odd, assessment, law.reported)
    if not agree and assessment.remaining is None:
        return outcome
    if updated is not search or (odd and agree):
        outcome = assessed(context, updated, [log.log for log in odd] if agree else ())
    place = replace(remaining, port=law.curve.port, manner=law.manner)
    return outcome._replace(assessment=replace(outcome.assessment, remaining=place), laws=(law,))


def add_state_terms(context: SearchContext, outcome: Outcome) -> Outcome:
    """The outcome with terms of states that are not measured, where whole runs ask for them.

    They are tried where whole runs err far too much, and against a law of one signal: the recent
    past of an input imitates a level that nobody measures. They must be surely better than it.
    """
    state, laws = outcome.search.state, outcome.laws
    far = verdict_evidence(outcome.selection, outcome.assessment).far
    if not (far or laws) or outcome.assessment.apart:
        return outcome
    context.say("learning terms of states that are not measured", LEARNING)
    with context.clock("learned"):
        terms = state_terms(context, state.stages[-1].fit)
    if not terms:
        return outcome
    rival = laws[0].reported if laws else None
    if rival and not worth_between_fits(context, rival, terms[0].reported).sure:
        return outcome
    # what one-step errors depend on was their imitation: the last 80 s of a pump, for a level
    assessment = replace(outcome.assessment, remaining=None)
    return outcome._replace(assessment=assessment, laws=terms)


def agrees_with_law(
    context: SearchContext, odd: Sequence[OddLog], assessment: Assessment, fit: Fit
) -> bool:
    """Whether logs that were odd err no more than the others in a fit with the law."""
    if not odd or assessment.trained is None:
        return not odd
    before: tuple[Run, ...] = assessment.trained[1].runs
    after = runs_over(fit.model, context.fitter.records, initial=fit.initial)
    if context.unseen:
        before = (*before, *assessment.after.runs)
        after = (*after, *runs_over(fit.model, context.unseen, noise=fit.noise_of_runs))
    return no_longer_odd(odd, before, after)


def add_headroom(context: SearchContext, outcome: Outcome) -> Outcome:
    """The outcome with what could be explained, and what recurs, where the verdict rests on it."""
    assessment = outcome.assessment
    far = verdict_evidence(outcome.selection, assessment).far
    is_placed = outcome.laws or assessment.remaining or assessment.changed
    if not far or is_placed or assessment.trained is None:
        return outcome
    training, judged = assessment.apart or (assessment.trained[1], assessment.after)
    with context.clock("headroom"):
        room = headroom_between(training, judged if context.unseen else None)
    runs = (*training.runs, *(judged.runs if context.unseen else ()))
    recurring = recurring_shares(context.given, runs)
    return outcome._replace(assessment=replace(assessment, room=room, recurring=recurring))


def add_change(context: SearchContext, outcome: Outcome) -> Outcome:
    """The outcome with a size of an effect that changes, where nothing else says what is left."""
    _, selection, assessment, laws = outcome
    if laws or assessment.remaining or assessment.apart or assessment.trained is None:
        return outcome
    unseen = assessment.after.runs if context.unseen else ()  # else it holds training logs
    with context.clock("remaining"):
        training = assessment.trained[1].runs
        changed = changed_size(selection.fit, selection.added, training, unseen)
    return outcome._replace(assessment=replace(assessment, changed=changed))


def missing_before_and_after(
    context: SearchContext, state: SearchState, baseline: TrialFit
) -> tuple[tuple[Missing, ...], tuple[Missing, ...]]:
    """The missing signals of the model as given, and those that its effects leave."""
    with context.clock("missing"):
        missing = missing_signals(context.fitter, baseline)
        if state.current.remaining is None or not state.number:
            return missing, ()
        return missing, missing_signals(context.fitter, state.current.trial)


def still_possible(
    context: SearchContext, state: SearchState, law: LearnedLaw | None
) -> dict[str, Worth]:
    """The effects for which whole runs alone speak, less those that nothing is left for.

    Beside a law each is fitted anew: the friction of an axis with an offset of 3 N was learned, and
    "possibly also: buoyancy" (69 %) was that offset once more.
    """
    present = state.current.trial.effects
    possible = {name: worth for name, worth in state.possible.items() if name not in present}
    if law is None:
        return possible
    fit, candidates = law.reported, context.fitter.candidates
    with context.clock("learned"):
        beside = {
            name: worth_between_fits(
                context, fit, quick_fit(context, fit, fit.model + candidates[name])
            )
            for name in possible
        }
    return {name: worth for name, worth in beside.items() if worth.sure}
