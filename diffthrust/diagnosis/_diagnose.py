"""Diagnosis: where a model fails, which effect it lacks, and what cannot be told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.progress import ProgressOption, progressing, teller
from diffthrust.comparison._compare import Comparison, compare
from diffthrust.diagnosis._candidates import Candidates
from diffthrust.diagnosis._equivalence import SearchResult, proposal, with_equivalents
from diffthrust.diagnosis._findings import Missing
from diffthrust.diagnosis._given import OddLog
from diffthrust.diagnosis._held_values import held_values
from diffthrust.diagnosis._innovations_fit import TrialFit
from diffthrust.diagnosis._missing_signal import missing_signals
from diffthrust.diagnosis._outlier_logs import no_longer_odd, odd_logs
from diffthrust.diagnosis._result import Diagnosis
from diffthrust.diagnosis._search_state import (
    LEARNING,
    SOUGHT,
    SearchContext,
    SearchState,
    start_search,
)
from diffthrust.diagnosis._set_aside import set_aside
from diffthrust.diagnosis._stages import next_stage
from diffthrust.diagnosis._unknown_term.select import learned_law
from diffthrust.diagnosis._verdict import verdict_of
from diffthrust.diagnosis._whole_runs import from_simulation
from diffthrust.estimation._arguments import by_input, check_arguments, listed
from diffthrust.estimation._origin import origin_of, same_logs
from diffthrust.estimation._result import Fit
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.simulation._remembered import simulated_once

_MOST_STAGES = 5


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
    nor whole runs speak against it: it must change them, and not make those of training and unseen
    logs together worse. Earlier effects that it made superfluous are dropped. At the end signals of
    unknown form are tried at each port: if the errors still depend on a signal of the model, or a
    channel contradicts it, the verdict is "unexplained".

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
        A `Diagnosis`; ``print(diag.report())`` tells it, and ``model + diag.best`` is the model
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
    train, unseen = listed(logs), listed(holdout) if holdout is not None else ()
    model = fit.model if isinstance(fit, Fit) else fit
    check_arguments(model, train, unseen, seed=seed)
    for name in by_input("limits", limits, model, "(low, high)"):
        if name not in model.inputs:
            raise InputError(
                f"limits: '{model}' has no input {name!r}; it has {listing(model.inputs)}.",
                "Correct the name.",
            )
    say = teller(progress)
    with simulated_once():
        tools, known = start_search(fit, train, unseen, candidates, seed, say)
        first = known.current.trial
        while max(known.number, len(known.detectable)) < _MOST_STAGES:
            before, known = known, next_stage(tools, known)
            if known.accepted == before.accepted:
                known = from_simulation(tools, known)
            if known.accepted == before.accepted:
                break
        found = _reported(tools, known, first, limits, experiment)
    say("done", 1.0)
    before = fit.origin if isinstance(fit, Fit) else None
    origin, notes = origin_of(train, unseen, before.spec if before else None), ()
    if before and found.stages[0].fit is not fit and not same_logs(before.train, origin.train):
        notes = ("The fit that was given is of other logs: its model was fitted anew to these.",)
    return replace(found, origin=origin, notes=notes)


def _reported(
    tools: SearchContext,
    known: SearchState,
    first: TrialFit,
    limits: Mapping[str, tuple[float, float]] | None,
    experiment: bool,
) -> Diagnosis:
    """All that is told at the end of a search."""
    # what the first model lacks is seen with errors limited as they are at the end
    first = replace(first, limit=known.current.trial.limit)
    effects = with_equivalents(tools, known, first)
    tools.say("what no known effect explains", SOUGHT)
    found = _findings(tools, effects, first)
    left = known.current.remaining
    if left is not None and (found.verdict == "unexplained" or found.apart):
        tools.say("learning what no known effect explains", LEARNING)
        with tools.clock("learned"):
            answer = learned_law(tools, effects, first)
        odd = [one for one in found.odd_logs if one.much] if found.apart else []
        alike = answer is not None and _alike(tools, odd, found, answer[1].told)
        if answer is not None and (alike or found.remaining is not None):
            beside, law = answer
            like = [one.log for one in odd if alike]
            if beside is not effects or like:
                effects = beside
                found = _findings(tools, effects, first, like)
            where = replace(left, port=law.curve.port, manner=law.manner)
            found = replace(found, verdict="unexplained", laws=(law,), remaining=where)
    if found.verdict in ("undecided", "unexplained"):
        present = effects.state.current.trial.effects
        possible = {n: w for n, w in known.possible.items() if n not in present}
        found = replace(found, possible=possible)
    if experiment:
        rivals = [*effects.groups, *((None, name) for name in found.possible)]
        found = replace(found, experiment=proposal(tools, effects.state, rivals, limits))
    return found


def _alike(tools: SearchContext, odd: Sequence[OddLog], found: Diagnosis, fit: Fit) -> bool:
    """Whether logs that were unlike the others are like them in what a fit leaves."""
    if not odd or found.trained is None:
        return not odd
    trained = compare(fit, tools.fitter.logs, initial=fit.initial)
    unseen = (found.after.runs, compare(fit, tools.unseen).runs) if tools.unseen else ((), ())
    before, after = (
        (*one.runs, *other) for one, other in zip((found.trained[1], trained), unseen, strict=True)
    )
    return no_longer_odd(odd, before, after)


def _findings(
    tools: SearchContext, effects: SearchResult, first: TrialFit, like: Sequence[str] = ()
) -> Diagnosis:
    """What a search has found, and the verdict on it.

    Args:
        tools: what it worked with.
        effects: what it has found.
        first: the trial of the model as given.
        like: logs that a learned law has shown to be like the others.
    """
    trials, unseen, known = tools.fitter, tools.unseen, effects.state
    present = known.current.trial
    with tools.clock("missing"):
        missing = missing_signals(trials, first)
    with tools.clock("remaining"):
        remaining = known.current.remaining
    left: tuple[Missing, ...] = ()
    if remaining is not None and known.number:
        with tools.clock("missing"):
            left = missing_signals(trials, present)
    ends = known.stages[0].fit, known.stages[-1].fit
    trained = _held_against(*ends, trials.logs, trained=True)
    held = _held_against(*ends, unseen) if unseen else trained
    runs = (*trained[1].runs, *(held[1].runs if unseen else ()))
    tested = {candidate.effect for candidate in known.ranking}
    sizes = map(float, present.quadratic.sigma)
    found = Diagnosis(
        verdict="adequate",
        model=tools.given,
        best=tuple(ends[1].model.effects[len(tools.given.effects) :]),
        groups=effects.groups,
        stages=known.stages,
        ranking=known.ranking,
        remaining=remaining,
        untestable={n: why for n, why in known.untestable.items() if n not in present.effects},
        dropped=known.dropped,
        before=held[0],
        after=held[1],
        missing=missing,
        left=left,
        refused={n: why for n, why in known.refused.items() if n not in present.effects},
        silent=tuple(sorted(known.silent - tested - {*known.untestable, *trials.constants})),
        held=held_values(tools.given, present),
        one_step=dict(zip(trials.channels, sizes, strict=True)),
        trained=trained,
        odd_logs=tuple(one for one in odd_logs(trials, present, runs) if one.log not in like),
        experiment=None,
        seconds=tools.clock.seconds,
        worth={
            n: w
            for n, w in known.worth.items()
            if n in (*known.stages[-1].effects, *known.detectable) and n not in trials.constants
        },
        detectable=known.detectable,
        detectable_groups=effects.detectable_groups,
    )
    found = set_aside(tools, found)
    with tools.clock("headroom"):
        return replace(found, verdict=verdict_of(found))


def _held_against(
    first: Fit, last: Fit, logs: Sequence[Log], trained: bool = False
) -> tuple[Comparison, Comparison]:
    """The models of two fits held against logs; once where they are one."""
    before = compare(first, logs, initial=first.initial if trained else None)
    if last is first:
        return before, before
    return before, compare(last, logs, initial=last.initial if trained else None)
