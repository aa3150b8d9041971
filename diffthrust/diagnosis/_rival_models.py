"""Other models of the library for the same logs, before effects and after.

Whether a controller holds the speed or the command drives a torque decides what is missing: behind
a speed loop no effect can stand for a supply that sags. So where the diagnosed model with all that
was found still errs far above the noise, each model that the same channels feed is fitted as it is.
Of those that err about as little as the diagnosed model as it was given, the best is searched for
effects of its own: those that the diagnosis saw some gain in, and those that act in it alone. The
search ends where it falls behind: on the maps of a T200 it took a third of the diagnosis. None
whose parameters the logs leave open: a DC motor whose current nobody measures is fitted for longer
than the whole diagnosis takes, and to no end.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from diffthrust._support.errors import InputError
from diffthrust.diagnosis._candidates import candidates_of
from diffthrust.diagnosis._channel_use import models_fed_by
from diffthrust.diagnosis._explained_share import explained_share
from diffthrust.diagnosis._findings import OtherModel
from diffthrust.diagnosis._learned import LearnedLaw
from diffthrust.diagnosis._search_start import start_search
from diffthrust.diagnosis._search_state import FittedStage, SearchContext, SearchState
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._stage_fit import errors_between
from diffthrust.diagnosis._stepwise import done, simulation_is_poor, step
from diffthrust.estimation._result import Fit
from diffthrust.estimation._status import Status
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model
from diffthrust.simulation._record import Record, bind
from diffthrust.simulation._runs import Run, runs_over

_STARTS = 4
"""Numerics: starts of the fit of another model, of which nothing is known."""
_OPEN = {Status.NOT_IDENTIFIABLE, Status.NOT_CONVERGED}
"""Outcomes of a fit after which there is no search."""


class _Rival(NamedTuple):
    """A model of the same logs, as it is."""

    train: tuple[Record, ...]
    unseen: tuple[Record, ...]
    stage: FittedStage


def other_models(
    context: SearchContext, state: SearchState, law: LearnedLaw | None, catalogue: bool
) -> tuple[OtherModel, ...]:
    """Other models of the same logs, the one that errs least first.

    None where whole runs of the diagnosed model, with all that was found and learned, err hardly
    more than the noise: no other can then do better. The whole ``catalogue`` is tried on another
    model only if it was on this one.
    """
    first, last = state.stages[0], state.stages[-1]
    if not simulation_is_poor(context, state, law.reported if law else last):
        return ()
    with context.clock("other models"):
        rivals = [_as_it_is(context, model) for model in _rivals_of(context)]
        rivals = [rival for rival in rivals if math.isfinite(_error(rival.stage.fit))]
        rivals.sort(key=lambda rival: _error(rival.stage.fit))
        reach = SETTINGS.rival_models.within_reach * _error(first.fit)
        baseline = _runs_of(context, last, law)
        results = []
        for place, rival in enumerate(rivals):
            fit = rival.stage.fit
            searched = None
            if not place and fit.status not in _OPEN and _error(fit) <= reach:
                searched = _searched(context, state, rival, catalogue)
            last_stage = searched or rival.stage
            runs = last_stage.unseen_runs or last_stage.runs
            worth = explained_share(errors_between(baseline, runs))
            results.append(OtherModel(fit, searched and searched.fit, worth))
    return tuple(sorted(results, key=lambda other: _error(other.best)))


def _error(fit: Fit) -> float:
    return (fit.holdout or fit.train).nrmse


def _rivals_of(context: SearchContext) -> list[Model]:
    """Other models of the library that the logs feed, and that all measured channels compare.

    Where the logs do not say in which unit the command is, it is in that of the diagnosed model.
    """
    given, records = context.given, (*context.records, *context.unseen)
    prescribed = {name for record in records for name in record.inputs}
    models = models_fed_by([record.log for record in records])
    models = [m.commanded_in(given.command) if given.command in m.commands else m for m in models]
    return [
        model
        for model in models
        if type(model) is not type(given)
        and _hidden_states(model, records) <= _hidden_states(given, records)
        and not prescribed & {*model.states, *given.states}
        and all(given.inputs.get(name, unit) == unit for name, unit in model.inputs.items())
        and _measured(model, records) == {*context.fitter.channels}
    ]


def _measured(model: Model, records: Sequence[Record]) -> set[str]:
    return {*model.outputs} & {name for record in records for name in record.log.measured}


def _hidden_states(model: Model, records: Sequence[Record]) -> int:
    """The number of states that no channel measures."""
    return len({*model.states} - {name for record in records for name in record.log.measured})


def _as_it_is(context: SearchContext, model: Model) -> _Rival:
    """A model with what it shares with the diagnosed one: fixed constants, and effects."""
    given = context.given
    shared = {
        name: {"value": p.value, "fixed": True}
        for name, p in given._parameters.items()
        if p.fixed and name in model.parameters and model.parameters[name].unit == p.unit
    }
    model = model.replace(shared)
    for effect in given.effects:
        model = _with(model, effect)
    context.say(f"{model.name} in place of {given.name}", 0.95)
    train, unseen = (
        bind(model, [record.log for record in records])
        for records in (context.records, context.unseen)
    )
    refit = replace(context.refit, train=train, unseen=unseen, first_substeps=None, horizon=None)
    return _Rival(train, unseen, FittedStage((), *refit(model, starts=_STARTS)))


def _with(model: Model, effect: Effect) -> Model:
    """The model with an effect, or as it is where it has no place for that."""
    try:
        return model + effect
    except InputError:
        return model


def _searched(
    context: SearchContext, state: SearchState, rival: _Rival, catalogue: bool
) -> FittedStage | None:
    """The last stage of a search with few candidates; ``None`` where it added nothing."""
    fit, present = rival.stage.fit, state.stages[-1].effects
    gained = {c.effect for c in state.ranking if c.delta_bic < 0}
    # what changed nothing over whole runs was tried again: half of a diagnosis of the NGS's bench
    useless = {name for name, (why, _) in state.turned_down.items() if why.by_whole_runs}
    gained -= useless | {*state.detectable}
    names = {*present, *state.possible, *gained} & {*context.fitter.candidates}
    candidates = [context.fitter.candidates[name] for name in sorted(names)]
    # where a periodic force begins, the rival's records do not say: its trials would have more
    # initial states than the rest, and fail
    candidates = [
        e for e in candidates if not e.free_starts and _with(fit.model, e) is not fit.model
    ]
    if catalogue:
        alone, _ = candidates_of(fit.model, (*rival.train, *rival.unseen))
        candidates += [e for e in alone if _with(context.given, e) is context.given]
    if not candidates:
        return None
    seed = context.refit.options["seed"]

    def say(message: str, share: float) -> None:
        context.say(f"{fit.model.name}: {message}", 0.95 + 0.05 * share)

    searching, reached = start_search(fit, rival.train, rival.unseen, candidates, seed, say)
    while not (done(reached) or _is_behind(reached, state) or _is_even(reached, state)):
        reached = step(searching, reached)
    return reached.stages[-1] if reached.number else None


def _is_behind(reached: SearchState, state: SearchState) -> bool:
    """Whether a rival with two effects or more errs more than the diagnosed model with as many.

    By more than a tenth; with one effect less is not asked of it, for a right one may err more as
    it is: a thruster, taken for one behind a speed loop, by 1.28 times.
    """
    last = reached.stages[-1]
    as_many = [stage for stage in state.stages if len(stage.effects) <= len(last.effects)]
    most = SETTINGS.whole_runs.equivalent_error * _error(as_many[-1].fit)
    return len(last.effects) > 1 and _error(last.fit) > most


def _is_even(reached: SearchState, state: SearchState) -> bool:
    """Whether a rival errs about as little as the diagnosed model at its end, and falls no more.

    By less than a tenth, with the last effect. On the bench of the NGS its next was refused after a
    minute.
    """
    errors = [_error(stage.fit) for stage in reached.stages]
    equivalent = SETTINGS.whole_runs.equivalent_error
    final = equivalent * _error(state.stages[-1].fit)
    return len(errors) > 2 and errors[-1] <= final and errors[-2] <= equivalent * errors[-1]


def _runs_of(context: SearchContext, last: FittedStage, law: LearnedLaw | None) -> Sequence[Run]:
    """Whole runs of the diagnosed model with all that was found, over the logs that count."""
    if law is None:
        return last.unseen_runs or last.runs
    fit = law.reported
    if context.unseen:
        return runs_over(fit.model, context.unseen, substeps=fit.substeps, noise=fit.noise_of_runs)
    records = context.records
    return runs_over(fit.model, records, initial=fit.initial, substeps=fit.substeps)
