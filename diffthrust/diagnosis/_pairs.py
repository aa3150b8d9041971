"""Two effects that lower the errors of whole runs only together.

A boat in a steady current with one thruster a fifth weaker: each effect alone lets its errors over
whole runs stay where they were, for the other bends the course all the same, and both together
remove nine tenths. From one sample to the next random forces and the other parameters do what
either does, so that no single is added and both would be called untestable. Where singles do not
reach, therefore, pairs are fitted to whole runs: the best single with each other effect, and pairs
of those that one-step errors cannot test.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from diffthrust.diagnosis._admission import errors_between, refitted_stage
from diffthrust.diagnosis._criteria import no_better
from diffthrust.diagnosis._explained_share import Worth, explained_share
from diffthrust.diagnosis._innovations_fit import (
    CandidateFitter,
    TrialFit,
    side_by_side,
)
from diffthrust.diagnosis._predicted_gain import Point
from diffthrust.diagnosis._screening import levels_of, probes
from diffthrust.diagnosis._search_state import (
    CurrentModel,
    FittedStage,
    SearchContext,
    SearchState,
)
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._simulation_fit import simulation_fitter

_STEPS = 8
"""Numerics: steps of the fit of a pair, from which it is seen which pairs may lower the errors."""
_FOLLOWED = 2
"""Numerics: starts of a pair from which these steps are taken: those of least cost."""
_PROBES = 4
"""Numerics: trial values of an effect that has no size as a single, of which starts are made."""


class FittedPair(NamedTuple):
    """Two effects beside those of the last stage, fitted to whole runs from several starts.

    Args:
        effects: their names.
        stage: the last stage with both.
        alone: the last stage with each of them alone.
        last: the last stage itself.
    """

    effects: tuple[str, str]
    stage: FittedStage
    alone: tuple[FittedStage, FittedStage]
    last: FittedStage

    @property
    def stages(self) -> tuple[FittedStage, ...]:
        """The stages that it adds: one more if each helps alone, so that each has its own share."""
        if not all(_removed(self.last, single).sure for single in self.alone):
            return (self.stage,)
        return (min(self.alone, key=lambda single: single.train.nrmse), self.stage)


def with_pair(
    context: SearchContext, state: SearchState, base: TrialFit, singles: Mapping[str, TrialFit]
) -> SearchState:
    """The search with a pair that surely lowers the errors of whole unseen runs, or as it was.

    Args:
        context: what the search works with.
        state: the search, at a stage with poor whole runs to which no single was added.
        base: the last stage, fitted to whole runs.
        singles: the same with one effect more each.
    """
    if not context.unseen:  # nothing could prove a pair
        return state
    context.say("fitting pairs of effects to whole runs", state.share(0.8))
    with context.clock("pairs"):
        started = _started(context, state, base, singles)[: SETTINGS.pairs.most_fitted]
        for trial in started:
            pair = _fitted(context, state, trial, singles)
            if pair is not None:
                return _added(context, state, pair)
    return state


# -- which pairs are fitted from several starts ----------------------------------------------------


def _started(
    context: SearchContext, state: SearchState, base: TrialFit, singles: Mapping[str, TrialFit]
) -> list[TrialFit]:
    """The last stage with each pair in question, fitted for a few steps; the best first."""
    fitter, simulation = context.fitter, simulation_fitter(context.fitter)
    ranked = sorted(singles, key=lambda name: singles[name].expected)
    untested = [n for n in state.untestable if n in fitter.candidates and n not in base.effects]
    names = list(dict.fromkeys((*ranked[:1], *untested, *ranked)))[: SETTINGS.pairs.most_effects]
    pairs = [
        pair for pair in combinations(names, 2) if ranked[:1] == [pair[0]] or {*pair} <= {*untested}
    ]
    if not pairs:
        return []
    simulation.ready((*base.effects, *names))  # one program for all of them
    levels = levels_of(fitter, base)
    points = {name: probes(fitter.candidates[name], levels)[1][:_PROBES] for name in names}

    def started(pair: tuple[str, str]) -> TrialFit:
        return _few_steps(simulation, base, pair, singles, points)

    trials = side_by_side(started, pairs)
    promising = [
        t for t in trials if _promised(fitter, base, t) > SETTINGS.whole_runs.proving_share
    ]
    return sorted(promising, key=lambda trial: trial.expected)


def _promised(fitter: CandidateFitter, base: TrialFit, trial: TrialFit) -> float:
    """The share of the squared error that a further step would have removed.

    The cost is half the samples times the logarithm of the squared error, whose geometric mean over
    the channels this is.
    """
    gain = base.expected - trial.expected
    return -math.expm1(-2.0 * gain / fitter.samples) if math.isfinite(gain) else 0.0


def _few_steps(
    simulation: CandidateFitter,
    base: TrialFit,
    pair: tuple[str, str],
    singles: Mapping[str, TrialFit],
    points: Mapping[str, Sequence[Point]],
) -> TrialFit:
    """A pair, fitted for a few steps from the best two of all starts.

    The parameters of the model start from the last stage and from both singles, each effect from
    its size as a single and from its probes.
    """
    effects = (*base.effects, *pair)
    fitted = [singles[name] for name in pair if name in singles]
    alone = {t.effects[-1]: {n: t.values[n] for n in t.parameters_of()} for t in fitted}
    sizes = [[*([alone[name]] if name in alone else []), *points[name]] for name in pair]
    starts = [
        {**trial.values, **first, **second}
        for trial in (base, *fitted)
        for first, second in product(*sizes)
    ]
    costs = [simulation.cost(effects, start, None, base.clip) for start in starts]
    order = np.argsort(np.where(np.isfinite(costs), costs, np.inf))[:_FOLLOWED]
    ends = [simulation.solve(effects, starts[k], None, base.clip, _STEPS) for k in order]
    return min(ends, key=lambda end: end.expected)


# -- whether a pair is proven ----------------------------------------------------------------------


def _fitted(
    context: SearchContext,
    state: SearchState,
    trial: TrialFit,
    singles: Mapping[str, TrialFit],
) -> FittedPair | None:
    """A pair that whole unseen runs prove, each beside the other too; ``None`` otherwise."""
    simulation, last = simulation_fitter(context.fitter), state.stages[-1]
    trial = simulation.further(trial)
    stage = _refitted(context, state, trial)
    removed = _removed(last, stage)
    if no_better(last, stage) or not removed.low > SETTINGS.whole_runs.proving_share:
        return None
    first, second = trial.effects[-2:]
    alone = []
    for kept, absent in ((first, second), (second, first)):
        values = simulation.absent(absent, trial.values)
        single = simulation.solve((*last.effects, kept), values, None, trial.clip)
        ends = [single, *([singles[kept]] if kept in singles else [])]
        alone.append(_refitted(context, state, min(ends, key=lambda end: end.expected)))
        if not _removed(alone[-1], stage).sure:
            return None
    return FittedPair((first, second), stage, (alone[0], alone[1]), last)


def _removed(without: FittedStage, stage: FittedStage) -> Worth:
    """The share of the squared error of whole unseen runs that a stage removes of another's.

    Of these alone: on the training logs a model that lacks more than this pair does not end where
    unseen logs want it, and one effect stands in for another.
    """
    return explained_share(errors_between(without.unseen_runs, stage.unseen_runs))


def _refitted(context: SearchContext, state: SearchState, trial: TrialFit) -> FittedStage:
    """The model of a trial, fitted to whole runs from its values and from those of the stage."""
    current = CurrentModel(context.fitter, trial)
    return refitted_stage(context, replace(state, current=current))


# -- adding it -------------------------------------------------------------------------------------


def _added(context: SearchContext, state: SearchState, pair: FittedPair) -> SearchState:
    """The search with both effects."""
    fitter, present = context.fitter, state.current.trial
    values = {n: p.value for n, p in pair.stage.fit.model.parameters.items()}
    effects = (*present.effects, *pair.effects)
    settled = fitter.settled(effects, {**present.values, **values}, None, present.clip)
    return replace(
        state,
        current=CurrentModel(fitter, settled),
        stages=(*state.stages, *pair.stages),
        refused={},
        possible={},
    )
