"""Diagnosis: where a model fails, which effect it lacks, and what the logs leave open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.progress import ProgressOption, progressing, reporter
from diffthrust.diagnosis._admission import remaining_share
from diffthrust.diagnosis._candidates import Candidates, asks_for_all
from diffthrust.diagnosis._changed_size import changed_size
from diffthrust.diagnosis._channel_use import unused_channels, unused_notes
from diffthrust.diagnosis._criteria import held_values
from diffthrust.diagnosis._equivalence import SearchResult, proposal, with_equivalents
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
from diffthrust.diagnosis._mend_trials import measured_mends
from diffthrust.diagnosis._mended import undone_by
from diffthrust.diagnosis._missing import (
    Missing,
)
from diffthrust.diagnosis._missing_signal import missing_signals
from diffthrust.diagnosis._outlier_logs import no_longer_odd, odd_logs
from diffthrust.diagnosis._periodic_stage import add_periodic_force
from diffthrust.diagnosis._recurrence import recurring_shares
from diffthrust.diagnosis._result import Diagnosis
from diffthrust.diagnosis._rival_models import other_models
from diffthrust.diagnosis._search_state import (
    LEARNING,
    SOUGHT,
    SearchContext,
    SearchState,
    start_search,
)
from diffthrust.diagnosis._set_aside import one_step_sizes, set_aside, upheld
from diffthrust.diagnosis._stage_shares import shares_by_effect
from diffthrust.diagnosis._stepwise import done, step
from diffthrust.diagnosis._unknown_term.fit import quick_fit, worth_between_fits
from diffthrust.diagnosis._unknown_term.select import learned_law
from diffthrust.diagnosis._unknown_term.state_terms import state_terms
from diffthrust.diagnosis._verdict import verdict_of
from diffthrust.estimation._arguments import (
    FitOptions,
    by_input,
    check_arguments,
    check_switch,
    training_and_unseen,
)
from diffthrust.estimation._origin import Origin, origin_of, same_logs
from diffthrust.estimation._result import Fit
from diffthrust.estimation._status import Status
from diffthrust.experiments._request import checked_limits
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._commands import adopted
from diffthrust.simulation._record import bind
from diffthrust.simulation._runs import Run, runs_over


@progressing
def diagnose(
    fit: Fit | Model,
    logs: Log | Sequence[Log],
    *,
    holdout: Log | Sequence[Log] | None = None,
    candidates: Candidates | None = None,
    experiment: bool = True,
    limits: Mapping[str, tuple[float, float]] | None = None,
    seed: int = 0,
    progress: ProgressOption = None,
) -> Diagnosis:
    """Find what a model lacks: where it fails, which physical effect is missing, what is unknown.

    Every effect that the logs can test is tried in the innovations form of the model, in which
    random forces and lasting sensor errors have estimated sizes of their own: what remains is
    white, and a likelihood ratio on it means what it says. The best effect is added while it lowers
    the Bayesian information criterion clearly, and neither the one-step predictions of unseen logs
    nor whole runs speak against it: the effect must lower the errors of whole runs, and must not
    raise those of training and unseen logs together. Earlier effects that it made superfluous are
    dropped. At the end signals of unknown form are tried at each port: if the errors still depend
    on a signal of the model, or a channel contradicts it, the verdict is "unexplained".

    Args:
        fit: a fit, or a model that is fitted first.
        logs: training logs.
        holdout: unseen logs: they guard against effects that only imitate noise.
        candidates: names or objects of effects to try, and names of constants that the model holds;
            all of both that fit the model where ``None``. The word "all" stands for these:
            ``["all", MyEffect()]``.
        experiment: propose a test that would separate effects that these logs cannot.
        limits: lowest and highest value of each input in that test, in the model's unit; by default
            the range of the training logs.
        seed: of the starts of the fits.
        progress: True for a bar, or a function of a message and the share done.

    Returns:
        A `Diagnosis`; ``print(diag.report())`` shows it, and ``model + diag.best`` is the model
        with what was found.

    Raises:
        InputError: logs that do not fit the model, or hold fewer measurements than the trials
            estimate numbers; candidates that are no effects, or cannot be tried.

    Example:
        >>> train, held_out = lacking
        >>> few = ["command_deadband", "thrust_sensor_offset"]
        >>> found = dft.diagnose(
        ...     dft.Thruster(), train, holdout=held_out, candidates=few, experiment=False
        ... )
        >>> found.verdict, found.added
        ('effects_found', ('command_deadband',))
    """
    train, unseen = training_and_unseen(logs, holdout)
    model = fit.model if isinstance(fit, Fit) else fit
    check_arguments(model, train, FitOptions(seed=seed))
    check_switch("experiment", experiment)
    for name, pair in by_input("limits", limits, model, "(low, high)").items():
        if name not in model.inputs:
            raise InputError(
                f"limits: '{model}' has no input {name!r}; it has {listing(model.inputs)}.",
                "Correct the name.",
            )
        checked_limits(name, pair)
    given = fit if isinstance(fit, Fit) else adopted(fit, train)
    model = given.model if isinstance(given, Fit) else given
    records, unseen_records = bind(model, train), bind(model, unseen)
    say = reporter(progress)
    context, state = start_search(given, records, unseen_records, candidates, seed, say)
    baseline = state.current.trial
    mends = measured_mends(context, state.stages[0])
    context, state = searched(context, state)
    # what the first model lacks is judged with errors clipped as they are at the end
    baseline = replace(baseline, clip=state.current.trial.clip)
    search = with_equivalents(context, state, baseline)
    say("what no known effect explains", SOUGHT)
    outcome = add_law(context, assessed(context, search), baseline)
    outcome = add_change(context, add_state_terms(context, outcome))
    outcome = add_headroom(context, outcome)
    search, selection, assessment, laws = outcome
    kept = {n: why for n, why in selection.refused.items() if not undone_by(n, mends)}
    selection = replace(selection, refused=kept)
    evidence = verdict_evidence(selection, assessment)
    verdict = verdict_of(replace(evidence, structure=evidence.structure or bool(laws)))
    missing, left = missing_before_and_after(context, search.state, baseline)
    law = laws[0] if laws else None
    opened = verdict in ("undecided", "unexplained")
    possible = still_possible(context, search.state, law) if opened else {}
    proposed = proposal(context, search, possible, limits) if experiment else None
    others = other_models(context, search.state, law, asks_for_all(candidates))
    unused = unused_channels(context.given, (*records, *unseen_records))
    say("done", 1.0)
    origin, notes = provenance(fit, selection.stages[0].fit, train, unseen)
    return Diagnosis(
        verdict=verdict,
        model=context.given,
        **vars(selection),
        **vars(assessment),
        missing=missing,
        left=left,
        laws=laws,
        possible=possible,
        experiment=proposed,
        seconds=context.clock.seconds,
        mends=mends,
        other_models=others,
        unused=unused,
        notes=(*notes, *unused_notes(context.given, unused)),
        origin=origin,
    )


def searched(context: SearchContext, state: SearchState) -> tuple[SearchContext, SearchState]:
    """The search to its end: effects by their trials, periodic forces by their lines.

    A line is looked for first, for others would be fitted to it, and where nothing else is left to
    add.
    """
    context, state = add_periodic_force(context, state)
    while not done(state):
        state = step(context, state)
        if state.exhausted:
            context, state = add_periodic_force(context, state)
    return context, state


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


def selection_of(context: SearchContext, search: SearchResult) -> Selection:
    """The effects that a search has selected, and what became of the other candidates."""
    state, fitter = search.state, context.fitter
    present, last = state.current.trial.effects, state.stages[-1]
    tested = {candidate.effect for candidate in state.ranking}
    worth = shares_by_effect(state.stages) | {n: state.worth[n] for n in state.detectable}
    # what lowers the errors of whole runs is tested by them, though not by one-step errors
    supported = {*present, *state.possible}
    untestable = {n: why for n, why in state.untestable.items() if n not in supported}
    listed = {*supported, *untestable, *fitter.constants}
    return Selection(
        best=tuple(last.fit.model.effects[len(context.given.effects) :]),
        groups=search.groups,
        stages=tuple(Stage(stage.effects, stage.fit) for stage in state.stages),
        ranking=state.ranking,
        untestable=untestable,
        dropped=state.dropped,
        refused={n: why for n, why in state.refused.items() if n not in present},
        silent=tuple(sorted(state.silent - tested - listed)),
        worth={n: share for n, share in worth.items() if n not in fitter.constants},
        detectable=state.detectable,
        detectable_groups=search.detectable_groups,
        held=held_values(context.given, state.current.trial),
    )


def add_law(context: SearchContext, outcome: Outcome, baseline: TrialFit) -> Outcome:
    """The outcome with a learned law, where structure remains and a law surely explains it.

    The effects that were found without the law are sought once more beside it. A law that makes odd
    logs agree with the others is what they showed, so that they are set aside no more.
    """
    search, _, assessment, _ = outcome
    remaining = search.state.current.remaining
    if remaining is None:
        return outcome
    context.say("learning what no known effect explains", LEARNING)
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
    share = remaining_share(state, state.stages[-1])
    terms = tuple(replace(term, worth=term.worth.of(share)) for term in terms)
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
        after = (*after, *runs_over(fit.model, context.unseen))
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


def provenance(
    fit: Fit | Model, first: Fit, train: Sequence[Log], unseen: Sequence[Log]
) -> tuple[Origin, tuple[str, ...]]:
    """Where a diagnosis comes from; a note where it does not begin with the fit that was given."""
    source = fit.origin if isinstance(fit, Fit) else None
    origin = origin_of(train, unseen, source.spec if source else None)
    if not isinstance(fit, Fit) or first.parameters == fit.parameters:
        return origin, ()
    if source is None or not same_logs(source.train, origin.train):
        why = "is of other logs: its model was fitted anew to these."
    elif fit.status is Status.SIMULATION_FAILED:
        why = (
            "had failed: its model could not be simulated over whole runs. It was fitted anew, "
            "from the values at which it had ended; what is called as given here is that fit "
            f"({first.status})."
        )
    else:
        why = "errs otherwise along these logs: its model was fitted anew."
    return origin, (f"The fit that was given {why}",)
