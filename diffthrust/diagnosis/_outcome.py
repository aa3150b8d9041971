"""What follows from a search: its effects, its last model against the logs, laws and changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from diffthrust.comparison._compare import Comparison, comparison_of
from diffthrust.diagnosis._candidates import with_candidates
from diffthrust.diagnosis._changed_size import changed_size
from diffthrust.diagnosis._criteria import held_values
from diffthrust.diagnosis._effect_shares import shares_by_effect
from diffthrust.diagnosis._equivalence import SearchResult
from diffthrust.diagnosis._explained_share import Worth
from diffthrust.diagnosis._findings import Assessment, OddLog, Selection, Stage, verdict_evidence
from diffthrust.diagnosis._headroom import headroom_between, recurring_shares
from diffthrust.diagnosis._innovations_fit import TrialFit
from diffthrust.diagnosis._learned import LearnedLaw
from diffthrust.diagnosis._missing import Missing
from diffthrust.diagnosis._missing_signal import missing_signals
from diffthrust.diagnosis._outlier_logs import error_ratio, no_longer_odd, odd_logs
from diffthrust.diagnosis._residual_structure import remaining_structure
from diffthrust.diagnosis._search_start import compiled_fitter
from diffthrust.diagnosis._search_state import LEARNING, FittedStage, SearchContext, SearchState
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._unknown_term.fit import quick_fit, worth_between_fits
from diffthrust.diagnosis._unknown_term.select import learned_law
from diffthrust.diagnosis._unknown_term.state_terms import state_terms
from diffthrust.estimation._result import Fit
from diffthrust.simulation._runs import Run, pooled_errors, runs_over

_STARTS = 2
"""Numerics: starts of a fit without the odd logs, or with all: its model is fitted already, and one
more tells whether these had bent it into another valley."""
_SAME = 1.01
"""Numerics: a fit has reached another's error over the same logs where it is larger by no more."""


class Outcome(NamedTuple):
    """A search and what follows from it: its effects, its last model against the logs, and laws."""

    search: SearchResult
    selection: Selection
    assessment: Assessment
    laws: tuple[LearnedLaw, ...] = ()


def assessed(context: SearchContext, search: SearchResult, cleared: Sequence[str] = ()) -> Outcome:
    """The effects that a search has selected, and its last model against the logs.

    Without accusing logs that a learned law has ``cleared``: it made them agree with the others.
    """
    state = search.state
    last = state.stages[-1]
    with context.clock("remaining"):
        remaining = state.current.remaining
    runs = _all_runs(context, last.trained, last.judged)
    odd = odd_logs(context.fitter, state.current.trial, runs, structure=remaining is not None)
    odd, others = upheld(context, last, tuple(log for log in odd if log.log not in cleared))
    selection = selection_of(context, search)
    assessment = replace(
        _assessment(context, state),
        after=last.judged,
        trained=(state.stages[0].trained, last.trained),
        remaining=remaining,
        odd_logs=odd,
    )
    far = verdict_evidence(selection, assessment).far
    if remaining is not None or assessment.after.hints or far:
        assessment = _set_aside(context, last, assessment, others)
    return Outcome(search, selection, assessment)


def as_given(context: SearchContext, state: SearchState) -> dict[str, Any]:
    """The model as given against logs in which nothing is sought: fields of `Diagnosis`.

    No log is accused, and no structure is told: both may be the mistake.
    """
    selection = selection_of(context, SearchResult(state, (), ()))
    return {**vars(selection), **vars(_assessment(context, state)), "verdict": "unexplained"}


def _assessment(context: SearchContext, state: SearchState) -> Assessment:
    first = state.stages[0]
    return Assessment(
        before=first.judged,
        after=first.judged,
        trained=(first.trained, first.trained),
        one_step=context.fitter.sizes(state.current.trial),
        remaining=None,
    )


def _all_runs(context: SearchContext, training: Comparison, judged: Comparison) -> tuple[Run, ...]:
    return *training.runs, *(judged.runs if context.unseen else ())


# -- logs that are set aside -----------------------------------------------------------------------


def upheld(
    context: SearchContext, last: FittedStage, odd: tuple[OddLog, ...]
) -> tuple[tuple[OddLog, ...], FittedStage | None]:
    """The odd logs less those whose accusation another fit does not bear out.

    A fit follows the logs that it is made of, and may end badly: one that has lost a log it needed
    errs more on the others, and would accuse these of what it did itself. So a log is called unlike
    the others only where it is so by the best fit of all logs and by that of the others, and where
    the latter is as good on the others as the former.

    Returns:
        The odd logs, and the last stage fitted without the accused ones; none where no training
        log is accused.
    """
    accused = {log.log for log in odd if log.accused}
    if not accused:
        return odd, None
    records, unseen = context.records, context.unseen
    kept, kept_unseen = (
        [record for record in logs if record.name not in accused] for logs in (records, unseen)
    )
    sound = tuple(log for log in odd if not log.accused)
    if not kept:  # nothing would be left to fit
        return sound, None
    runs: list[Sequence[Run]] = []
    others = None
    if len(kept) < len(records):
        context.say("without the odd logs", 1.0)
        refitted = context.refit(last.fit.model, starts=_STARTS, records=(kept, kept_unseen))
        others = FittedStage(last.effects, *refitted)
        if not _is_as_good(others, last, accused):
            return sound, None
        runs.append(runs_over(others.fit.model, (*records, *unseen)))
    if len(kept_unseen) < len(unseen):  # the fit has not seen these
        context.say("with the odd logs", 1.0)
        all_logs = (*records, *unseen), ()
        runs.append(context.refit(last.fit.model, starts=_STARTS, records=all_logs).runs)
    baseline = _all_runs(context, last.trained, last.judged)
    least = SETTINGS.outlier_logs.least_error_ratio
    cleared = {
        log.log
        for log in odd
        if log.accused
        and error_ratio(log, baseline) > least
        and not all(error_ratio(log, by_fit) > least for by_fit in runs)
    }
    if not cleared:
        return odd, others
    return upheld(context, last, tuple(log for log in odd if log.log not in cleared))


def _is_as_good(others: FittedStage, last: FittedStage, accused: set[str]) -> bool:
    """Whether a fit without some logs errs no more on the others than the fit of all logs does."""
    pairs = [(others.runs, last.runs, _SAME)]
    if others.unseen_runs:
        pairs.append((others.unseen_runs, last.unseen_runs, SETTINGS.admission.most_unseen_growth))
    return all(
        pooled_errors(without).nrmse
        <= most * pooled_errors([run for run in every if run.name not in accused]).nrmse
        for without, every, most in pairs
    )


def _set_aside(
    context: SearchContext, last: FittedStage, assessment: Assessment, others: FittedStage | None
) -> Assessment:
    """The assessment without the odd logs that carry much of the error.

    A log that disagrees with the others may say nothing about what all of them lack, and bends the
    parameters that they share: where one is among the training logs the last stage is fitted
    without it (``others``), and tested for structure once more. The same where no log is so odd,
    and where no unseen log would be left: what is odd about the only one may be what the model
    lacks.
    """
    odd = {log.log for log in assessment.odd_logs if log.accused}
    if not odd:
        return assessment
    records, unseen = context.records, context.unseen
    trained, judged = (
        tuple(run for run in runs if run.name not in odd)
        for runs in (last.trained.runs, last.judged.runs if unseen else ())
    )
    removed = len(records) + len(unseen) - len(trained) - len(judged)
    if removed > len(odd) or (unseen and not judged):  # several logs may bear one name
        return assessment
    if others is None:
        return replace(assessment, apart=(last.trained, comparison_of(last.fit, judged)))
    kept, kept_unseen = ([run.record for run in runs] for runs in (trained, judged))
    windows = [window for window in context.fitter.records if window.name not in odd]
    fitter, trial = compiled_fitter(others.fit, (), (), kept, kept_unseen, windows)
    return replace(
        assessment,
        remaining=remaining_structure(fitter, trial),
        one_step=fitter.sizes(trial),
        apart=(others.trained, others.judged),
    )


# -- effects, laws and changes ---------------------------------------------------------------------


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
    agree = _agrees_with_law(context, odd, assessment, law.reported)
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


def _agrees_with_law(
    context: SearchContext, odd: Sequence[OddLog], assessment: Assessment, fit: Fit
) -> bool:
    """Whether logs that were odd err no more than the others in a fit with the law."""
    if not odd or assessment.trained is None:
        return not odd
    baseline = _all_runs(context, assessment.trained[1], assessment.after)
    updated = runs_over(fit.model, context.records, initial=fit.initial)
    if context.unseen:
        updated += runs_over(fit.model, context.unseen, noise=fit.noise_of_runs)
    return no_longer_odd(odd, baseline, updated)


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
    recurring = recurring_shares(context.given, _all_runs(context, training, judged))
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
                context,
                fit,
                quick_fit(context, fit, with_candidates(fit.model, [name], candidates)),
            )
            for name in possible
        }
    return {name: worth for name, worth in beside.items() if worth.sure}
