"""Diagnosis: where a model fails, which effect it lacks, and what the logs leave open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from diffthrust._support._running.blas import one_blas_thread
from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.progress import ProgressOption, progressing, reporter
from diffthrust.diagnosis._bounds import idle_bounds
from diffthrust.diagnosis._candidates import Candidates, asks_for_all
from diffthrust.diagnosis._channel_use import unused_channels, unused_notes
from diffthrust.diagnosis._effect_shares import with_shares_beside_others
from diffthrust.diagnosis._equivalence import SearchResult, proposal, with_equivalents
from diffthrust.diagnosis._findings import verdict_evidence
from diffthrust.diagnosis._mend_trials import measured_mends
from diffthrust.diagnosis._mended import MeasuredMend, mends_lead, undone_by
from diffthrust.diagnosis._outcome import (
    add_change,
    add_headroom,
    add_law,
    add_state_terms,
    as_given,
    assessed,
    missing_before_and_after,
    still_possible,
)
from diffthrust.diagnosis._periodic_stage import add_periodic_force
from diffthrust.diagnosis._result import Diagnosis
from diffthrust.diagnosis._rival_models import other_models
from diffthrust.diagnosis._search_start import blind_notes, start_search, with_finer_steps
from diffthrust.diagnosis._search_state import SOUGHT, SearchContext, SearchState
from diffthrust.diagnosis._stepwise import done, step
from diffthrust.diagnosis._trial_windows import window_note
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
from diffthrust.estimation._unexplained import farthest_runaway
from diffthrust.experiments._request import checked_limits
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._commands import adopted
from diffthrust.simulation._record import bind


@progressing
@one_blas_thread()
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

    Nothing is sought (`sought`) in logs of which a sign or an exchange of channels is doubted, if
    fits to mended logs err surely less, or the model fails on them as they are and no fit to mended
    logs clears them: they are to be mended first.

    Args:
        fit: a fit, or a model that is fitted first.
        logs: training logs.
        holdout: unseen logs: they guard against effects that only imitate noise.
        candidates: names or objects of effects to try, and names of constants that the model holds;
            all of both that fit the model where ``None``. The word "all" stands for these:
            ``["all", MyEffect()]``. Those that are named alone are sought in any logs.
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
        >>> result = dft.diagnose(
        ...     dft.Thruster(), train, holdout=held_out, candidates=few, experiment=False
        ... )
        >>> result.verdict, result.added
        ('effects_found', ('command_deadband',))
    """
    train, unseen = training_and_unseen(logs, holdout)
    model = fit.model if isinstance(fit, Fit) else fit
    check_arguments(model, train, FitOptions(seed=seed))
    check_switch("experiment", experiment)
    _check_limits(limits, model)
    given = fit if isinstance(fit, Fit) else adopted(fit, train)
    model = given.model if isinstance(given, Fit) else given
    records, unseen_records = bind(model, train), bind(model, unseen)
    say = reporter(progress)
    context, state = start_search(given, records, unseen_records, candidates, seed, say)
    first = state.stages[0]
    mends = measured_mends(context, first)
    failing = not first.fit.status.ok or bool(first.judged.hints)
    failing = failing or farthest_runaway(first.fit, first.fit.guess) is not None
    # who names effects wants these tried
    wrong = asks_for_all(candidates) and mends_lead(first.fit.doubts, mends, failing)
    findings = (
        as_given(context, state)
        if wrong
        else _sought(context, state, candidates, mends, experiment, limits)
    )
    blind = () if wrong else blind_notes(state, records)
    shortened = () if wrong else window_note(context.fitter.records, context.records)
    unused = unused_channels(context.given, (*records, *unseen_records))
    say("done", 1.0)
    origin, notes = provenance(fit, first.fit, train, unseen)
    return Diagnosis(
        **findings,
        model=context.given,
        sought=not wrong,
        seconds=context.clock.seconds,
        mends=mends,
        unused=unused,
        notes=(*notes, *shortened, *blind, *unused_notes(context.given, unused)),
        origin=origin,
    )


def _check_limits(limits: Mapping[str, tuple[float, float]] | None, model: Model) -> None:
    for name, pair in by_input("limits", limits, model, "(low, high)").items():
        if name not in model.inputs:
            raise InputError(
                f"limits: '{model}' has no input {name!r}; it has {listing(model.inputs)}.",
                "Correct the name.",
            )
        checked_limits(name, pair)


def _sought(
    context: SearchContext,
    state: SearchState,
    candidates: Candidates | None,
    mends: Sequence[MeasuredMend],
    experiment: bool,
    limits: Mapping[str, tuple[float, float]] | None,
) -> dict[str, Any]:
    """What a search finds, and what follows from it: fields of `Diagnosis`."""
    baseline = state.current.trial
    context, search = searched(context, state)
    # what the first model lacks is judged with errors clipped as they are at the end
    baseline = replace(baseline, clip=search.state.current.trial.clip)
    context.say("what none of the effects tried explains", SOUGHT)
    outcome = add_law(context, assessed(context, search), baseline)
    outcome = add_change(context, add_state_terms(context, outcome))
    outcome = add_headroom(context, outcome)
    search, selection, assessment, laws = outcome
    idle = idle_bounds(context, search.state.stages[0], search.state.stages[-1])
    assessment = replace(assessment, idle_bounds=idle)
    kept = {n: why for n, why in selection.refused.items() if not undone_by(n, mends)}
    selection = replace(selection, refused=kept)
    evidence = verdict_evidence(selection, assessment)
    verdict = verdict_of(replace(evidence, structure=evidence.structure or bool(laws)))
    missing, left = missing_before_and_after(context, search.state, baseline)
    law = laws[0] if laws else None
    opened = verdict in ("undecided", "unexplained")
    possible = still_possible(context, search.state, law) if opened else {}
    return {
        **vars(selection),
        **vars(assessment),
        "verdict": verdict,
        "missing": missing,
        "left": left,
        "laws": laws,
        "possible": possible,
        "experiment": proposal(context, search, possible, limits) if experiment else None,
        "other_models": other_models(context, search.state, law, asks_for_all(candidates)),
    }


def searched(context: SearchContext, state: SearchState) -> tuple[SearchContext, SearchResult]:
    """The search to its end: effects by their trials, periodic forces by their lines.

    A line is looked for first, for others would be fitted to it, and where nothing else is left to
    add. Where a rival then proves better than what was added, the search goes on from it.
    """
    first = state.current.trial
    context, state = add_periodic_force(context, state)
    while True:
        while not done(state):
            context, state = with_finer_steps(context, step(context, state))
            if state.exhausted:
                context, state = add_periodic_force(context, state)
        context, state = with_finer_steps(context, with_shares_beside_others(context, state))
        search = with_equivalents(context, state, first)
        if search.exchanged is None:
            return context, search
        state = search.exchanged


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
