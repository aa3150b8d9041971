"""The model of a trial fitted to whole runs, as the next stage of a search or to be compared."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from diffthrust.diagnosis._candidates import with_candidates
from diffthrust.diagnosis._criteria import missed, no_better
from diffthrust.diagnosis._explained_share import Worth, matters, worth_of
from diffthrust.diagnosis._innovations_fit import with_values
from diffthrust.diagnosis._search_start import few_substeps
from diffthrust.diagnosis._search_state import FittedStage, SearchContext, SearchState
from diffthrust.estimation._multistart import NOTICED
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model
from diffthrust.simulation._runs import Run

_MORE_STARTS = 6
"""Numerics: starts of a fit that ended worse than the one that is nested in it."""
_NEAR = 0.1
"""Numerics: a share of their mean. Numbers by log that lie nearer to it are fitted as one, too."""
_UNLIMITED = 100.0
"""Numerics: a limit of so many times its guess limits nothing, as its null, infinity, does: without
it in a fit's first guess a Kingfisher's rate limit ended worse than without, and was fitted again
from six starts, for four minutes."""


def stage_effects(state: SearchState) -> tuple[str, ...]:
    """The effects of the current model, without those that are only detectable."""
    return tuple(n for n in state.current.trial.effects if n not in state.detectable)


def refitted_stage(
    context: SearchContext, state: SearchState, starts: int = 0, substeps: int = 0
) -> FittedStage:
    """The current model without the effects that are only detectable, fitted to whole runs.

    What may differ by log is one value for all logs at first, and differs where that matters as an
    effect does: a steady current that each of a boat's logs had its own of stood in for a weak
    thruster, at an NRMSE of 0.69 where one current for all left 0.28.

    Args:
        context: what the search works with.
        state: the search, with the trial.
        starts: the trial's and random ones, if not the default number.
        substeps: integrator steps per sample of a fit that is only compared, which is made once; as
            many as it needs if not given.
    """
    if not substeps:
        return _alike_or_apart(context, state, starts, substeps)
    rivals, key = state.stages[-1].rivals, (stage_effects(state), starts, substeps)
    if key not in rivals:
        rivals[key] = _alike_or_apart(context, state, starts, substeps)
    return rivals[key]


def compared_stage(
    context: SearchContext, state: SearchState, starts: int = 0, *, anew: bool = False
) -> FittedStage:
    """As `refitted_stage`, with the fewest integrator steps that tell fits apart.

    With ``anew`` it is fitted from the values of the trial even where the same effects were fitted
    before: what one-step errors gave no start for may be tried again from whole runs.
    """
    few = few_substeps(state.stages[-1].fit, context.records)
    fit = _alike_or_apart if anew else refitted_stage
    stage = fit(context, state, starts, few)
    if math.isfinite(stage.train.nrmse):
        return stage
    return refitted_stage(context, state, starts)  # what is stiff overflows with few


def _alike_or_apart(
    context: SearchContext, state: SearchState, starts: int, substeps: int
) -> FittedStage:
    """The fit with one value for all logs, or with a value each where that matters."""
    last, names = state.stages[-1], stage_effects(state)
    candidates = context.fitter.candidates
    refit = partial(context.refit, like=last.fit if substeps else None, substeps=substeps)
    model = with_candidates(context.given, names, candidates, like=last.fit.model)
    present = {effect.name for effect in last.fit.model.effects}
    new = [e for e in model.effects if e.differs and e.name not in present]
    if not new:
        apart = _refitted(context, state, model, starts, substeps)
        near = [e for e in apart.fit.model.effects if e.differs and _nearly_alike(e, apart)]
        if not near:
            return apart
        effects = {e.name: e.differing(False) if e in near else e for e in apart.fit.model.effects}
        values = {n: e.value for n, e in apart.fit.parameters.items()}
        model = with_values(with_candidates(context.given, names, effects), values)
        alike = FittedStage(names, *refit(model, starts=1))
        return _apart_where_it_matters(alike, apart)
    shared = {**candidates, **{e.name: e.differing(False) for e in new}}
    alike = with_candidates(context.given, names, shared, like=last.fit.model)
    fitted = _refitted(context, state, alike, starts, substeps)
    if not math.isfinite(fitted.train.nrmse):
        return _refitted(context, state, model, starts, substeps)
    values = {n: e.value for n, e in fitted.fit.parameters.items()}
    model = with_values(model, values)
    apart = FittedStage(names, *refit(model, starts=1))
    return _apart_where_it_matters(fitted, apart)


def _apart_where_it_matters(alike: FittedStage, apart: FittedStage) -> FittedStage:
    """Of two stages that with numbers by log, where these remove as much as an effect must."""
    better = no_better(alike, apart) is None and matters(worth_between(alike, apart))
    return apart if better or not math.isfinite(alike.train.nrmse) else alike


def _nearly_alike(effect: Effect, stage: FittedStage) -> bool:
    """Whether an effect's numbers by log lie near their mean: one value may do, and is asked.

    While two drags were missing a current of its own in each log did a little for a boat; beside
    them the same current was left in all logs, to 2 %, told as "0.18 to 0.18 m/s".
    """
    numbers = [[log[f"{effect.name}.{n}"] for n in effect.by_log] for log in stage.fit.initial]
    mean = np.mean(numbers, axis=0)
    away = np.linalg.norm(numbers - mean, axis=1)
    return bool(np.all(away < _NEAR * np.linalg.norm(mean)))


def _refitted(
    context: SearchContext, state: SearchState, model: Model, starts: int, substeps: int
) -> FittedStage:
    """A model fitted to whole runs, as the next stage.

    The fit starts from the values of the trial, and from the last stage with the new effects at
    their nulls. Where it ends worse than that stage all the same, which is nested in it, it has not
    reached its optimum, and is made again from several starts.
    """
    last, names = state.stages[-1], stage_effects(state)
    candidates = context.fitter.candidates
    model = with_values(model, state.current.trial.values)
    start = {n: p.value for n, p in last.fit.model.parameters.items()}
    for name in ({*names} & {*candidates}) - {effect.name for effect in last.fit.model.effects}:
        start |= _at_null(candidates[name])
    free = {n for n, p in model.parameters.items() if not p.fixed}
    guess = {n: v for n, v in start.items() if n in free}
    if substeps:
        refit = partial(context.refit, like=last.fit, substeps=substeps)
    else:
        # the search goes by the steps that suffice for the last stage: those of the model as given
        # were 2 a sample for an NGS thruster, whose duct's water, once added, needs 16
        few = few_substeps(last.fit, context.records)
        refit = replace(context.refit, first_substeps=few)
    fitted = FittedStage(names, *refit(model, [guess], starts=starts))
    if ended_worse(fitted, last) and {*last.effects} <= {*names}:
        guesses = [guess, {n: v for n, v in context.guess.items() if n in free}]
        again = FittedStage(names, *refit(model, guesses, starts=_MORE_STARTS, segments=True))
        fitted = fitted if ended_worse(again, fitted, by=0.0) else again
    return fitted


def _at_null(effect: Effect) -> dict[str, float]:
    """The values of an effect by full name, each at its null, or where it does as good as that."""
    guess, null = effect._parameters, effect.at_null()._parameters
    return {
        f"{effect.name}.{n}": p.value if math.isfinite(p.value) else _UNLIMITED * guess[n].value
        for n, p in null.items()
    }


def ended(context: SearchContext, stage: FittedStage) -> FittedStage:
    """A stage that was only compared, fitted to its end; as it is where that errs more."""
    fitted = fitted_to_its_end(context, stage)
    return stage if ended_worse(fitted, stage) else fitted


def fitted_to_its_end(context: SearchContext, stage: FittedStage) -> FittedStage:
    """A stage that was only compared, fitted with the integrator steps that it needs."""
    model = stage.fit.model
    values = {n: p.value for n, p in model.parameters.items() if not p.fixed}
    return FittedStage(stage.effects, *context.refit(model, [values], starts=1))


def ended_worse(stage: FittedStage, other: FittedStage, by: float = NOTICED) -> bool:
    """Whether a fit ended worse than another of the same logs: by what both of them maximise.

    Errors by channel may grow where a likelihood rises, which weighs a channel by its readings: a
    boat whose north and east are read half as often as its heading gained 248 of log-likelihood
    while the mean of its errors grew, and was searched anew from six starts, for nothing. Fits on
    segments, or with other integrator steps, may maximise something else: their whole runs decide.
    """
    if not math.isfinite(stage.train.nrmse):
        return True
    ways = {(fit.horizon, fit.substeps) for fit in (stage.fit, other.fit)}
    if stage.fit.horizon is None and len(ways) == 1:
        return stage.fit.log_likelihood < other.fit.log_likelihood - by
    return missed(other, stage)


def worth_between(before: FittedStage, after: FittedStage) -> Worth:
    """What the second of two stages removes of the squared error of the first."""
    return worth_of(
        errors_between(before.runs, after.runs),
        errors_between(before.unseen_runs, after.unseen_runs),
    )


def errors_between(*models: Sequence[Run]) -> list[dict[str, tuple[np.ndarray, ...]]]:
    """By log and channel what was measured, and the errors of each model over whole runs."""
    return [
        {
            name: (trace.measured, *(run.channels[name].residual for run in runs))
            for name, trace in runs[0].channels.items()
        }
        for runs in zip(*models, strict=True)
    ]
