"""Effects that whole unseen runs prove, two that lower their errors only together before all.

A boat in a steady current with one thruster a fifth weaker: each effect alone lets its errors over
whole runs stay where they were, for the other bends the course all the same, and both together
remove nine tenths. From one sample to the next random forces and the other parameters do what
either does, so that no single is added and both would be called untestable. Where singles do not
reach, therefore, pairs are fitted to whole runs: the best single with each other effect, and pairs
of those that one-step errors cannot test. Where one of two does as well alone, or no pair is
proven, a single is added: beside both of these, a quadratic drag of the turning removed 94 % of the
squared error of whole unseen runs, and nothing of the one-step errors, which random forces explain.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, product

from diffthrust.diagnosis._criteria import no_better
from diffthrust.diagnosis._explained_share import Worth, adds_little, explained_share
from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit, side_by_side
from diffthrust.diagnosis._predicted_gain import Point, probes
from diffthrust.diagnosis._screening import levels_of
from diffthrust.diagnosis._search_state import CurrentModel, FittedStage, SearchContext, SearchState
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._simulation_fit import Runs, SimulationTrials, share_between
from diffthrust.diagnosis._stage_fit import (
    compared_stage,
    ended,
    ended_worse,
    errors_between,
    worth_between,
)

_PROBES = 4
"""Numerics: trial values of an effect that has no size as a single, of which starts are made."""


def with_proven(
    context: SearchContext,
    state: SearchState,
    trials: SimulationTrials,
    lowering: Sequence[str],
    ahead: Callable[[SearchState], SearchState] | None = None,
) -> SearchState:
    """The search with what surely lowers the errors of whole unseen runs.

    Where there is nothing of the kind, with those effects alone possible that a fit bears out.

    Args:
        context: what the search works with.
        state: the search, at a stage with poor whole runs to which no single was added that lowers
            the one-step errors, too.
        trials: the fits to whole runs beside that stage.
        lowering: the effects of their singles that are new and lower the errors of whole unseen
            runs enough, the best first.
        ahead: the next step of the search, if a pair may be proven by what comes beside it.
    """
    # nothing could prove them, or they would stand in for the mistake: of a Kingfisher with its
    # sides exchanged ten pairs were fitted in five minutes, each with a current
    if not context.unseen or context.mend_first:
        return state
    context.say("fitting pairs of effects to whole runs", state.share(0.8))
    with context.clock("pairs"):
        singles, constants = trials.singles, context.fitter.constants
        apart = {*state.detectable, *constants}
        new = {name: trial for name, trial in singles.items() if name not in apart}
        fitted = _fitted_pairs(context, state, trials, new)
        fitted = fitted[: SETTINGS.pairs.most_fitted]
        ended = []
        for trial in fitted:
            ended.append(_refitted(context, state, trial))
            if proven := _proven_pair(context, state, trials, trial, ended[-1], new):
                return _added(context, state, *proven)
        if ahead and fitted:
            further = _proven_ahead(context, state, ended[0], ahead)
            if further:
                return further
        # a constant, which may absorb any error, is not proven by whole runs alone
        best = [name for name in lowering if name not in constants][:1]
        refitted = {name: _refitted(context, state, singles[name]) for name in best}
        for stage in refitted.values():
            if _is_proven_alone(state.stages[-1], stage):
                return _added(context, state, stage)
        return replace(state, possible=_borne_out(context, state, singles, refitted))


def _borne_out(
    context: SearchContext,
    state: SearchState,
    singles: Mapping[str, TrialFit],
    refitted: Mapping[str, FittedStage],
) -> dict[str, Worth]:
    """The effects that are possible which a fit to whole runs bears out, with what it removes.

    Trials end where they may: of an Otter one promised 23 % of the squared error of unseen runs by
    a propeller's inflow, with which the fit erred more there than without.
    """
    worths = {}
    for name in state.possible:
        stage = refitted.get(name) or _refitted(context, state, singles[name])
        worths[name] = _removed(state.stages[-1], stage)
    return {name: worth for name, worth in worths.items() if worth.sure}


# -- which pairs lower the errors ------------------------------------------------------------------


def _fitted_pairs(
    context: SearchContext,
    state: SearchState,
    trials: SimulationTrials,
    singles: Mapping[str, TrialFit],
) -> list[TrialFit]:
    """The last stage with each pair that may lower its errors; the best first."""
    fitter, runs, base = context.fitter, trials.runs, trials.base
    ranked = sorted(singles, key=lambda name: singles[name].expected)
    untested = [n for n in state.untestable if n in fitter.candidates and n not in base.effects]
    names = list(dict.fromkeys((*ranked[:1], *untested, *ranked)))[: SETTINGS.pairs.most_effects]
    pairs = [
        pair for pair in combinations(names, 2) if ranked[:1] == [pair[0]] or {*pair} <= {*untested}
    ]
    levels = levels_of(fitter, base)
    points = {name: probes(fitter.candidates[name], levels)[1][:_PROBES] for name in names}

    def fitted(pair: tuple[str, str]) -> TrialFit:
        starts = _starts(base, pair, singles, points)
        return runs.fitted((*base.effects, *pair), starts, base.clip)

    if new := [pair for pair in pairs if pair not in trials.pairs]:
        runs.fitter.ready(base.effects, names)  # one program for all of them
        trials.pairs.update(zip(new, side_by_side(fitted, new), strict=True))
    least = SETTINGS.whole_runs.proving_share
    promising = [t for p in pairs if _promised(fitter, base, t := trials.pairs[p]) > least]
    return sorted(promising, key=lambda trial: trial.expected)


def _promised(fitter: CandidateFitter, base: TrialFit, trial: TrialFit) -> float:
    """The share of the squared error that a further step would have removed.

    The cost is half the samples times the logarithm of the squared error, whose geometric mean over
    the channels this is.
    """
    gain = base.expected - trial.expected
    return -math.expm1(-2.0 * gain / fitter.samples) if math.isfinite(gain) else 0.0


def _starts(
    base: TrialFit,
    pair: tuple[str, str],
    singles: Mapping[str, TrialFit],
    points: Mapping[str, Sequence[Point]],
) -> list[dict[str, float]]:
    """Where fits of a pair begin.

    The parameters of the model start from the last stage and from both singles, each effect from
    its size as a single and from its probes.
    """
    fitted = [singles[name] for name in pair if name in singles]
    alone = {t.effects[-1]: {n: t.values[n] for n in t.parameters_of()} for t in fitted}
    sizes = [[*([alone[name]] if name in alone else []), *points[name]] for name in pair]
    return [
        {**trial.values, **first, **second}
        for trial in (base, *fitted)
        for first, second in product(*sizes)
    ]


# -- whether they are proven -----------------------------------------------------------------------


def _proven_pair(
    context: SearchContext,
    state: SearchState,
    trials: SimulationTrials,
    trial: TrialFit,
    stage: FittedStage,
    singles: Mapping[str, TrialFit],
) -> tuple[FittedStage, ...]:
    """The stages of a pair that whole unseen runs prove, or of one of it alone; none else.

    Each of two is proven beside the other, too. Those that each help alone have one stage each, so
    that each has its own share.
    """
    last, runs = state.stages[-1], trials.runs
    if not _is_proven(last, stage):
        return ()
    first, second = trial.effects[-2:]
    alone = []
    for kept, absent in ((first, second), (second, first)):
        starts = [context.fitter.absent((absent,), trial.values)]
        starts += [singles[kept].values] if kept in singles else []
        single = runs.fitted((*last.effects, kept), starts, trial.clip)
        if _is_hopeless(runs, trials.base, single, trial):
            continue
        alone.append(_refitted(context, state, single))
        if ended_worse(stage, alone[-1]):  # which is nested in it
            within = replace(state, stages=(*state.stages, alone[-1]))
            stage = _refitted(context, within, trial)
        needed = _share(runs, single, trial) > SETTINGS.whole_runs.proving_share
        if not (needed or _is_needed(alone[-1], stage)):
            return (alone[-1],) if _is_proven_alone(last, alone[-1]) else ()
    if len(alone) == 2 and all(_removed(last, single).sure for single in alone):
        return min(alone, key=lambda s: s.train.nrmse), stage
    return (stage,)


def _proven_ahead(
    context: SearchContext,
    state: SearchState,
    stage: FittedStage,
    ahead: Callable[[SearchState], SearchState],
) -> SearchState | None:
    """The search with a pair that training runs ask for by far, where what comes next proves it.

    A current and a weak thruster took a boat's training runs from 0.67 to 0.10, while its only
    unseen run stayed astray, by 1.2 before and 1.4 with them, until two drags stood beside them.
    """
    last = state.stages[-1]
    trained = explained_share(errors_between(last.runs, stage.runs))
    if not trained.low > SETTINGS.pairs.least_single_share:
        return None
    further = ahead(_added(context, state, stage))
    is_more = further.number > state.number + 1
    return further if is_more and _is_proven(last, further.stages[-1]) else None


def _is_proven(last: FittedStage, stage: FittedStage) -> bool:
    """Whether whole runs prove a pair: unseen ones, or all by far, of which unseen ones are sure.

    A current and a weak thruster took a boat's training runs from 0.95 to 0.30 and its only unseen
    run from 0.54 to 0.43, 37 % (5 % to 63 %) of its squared error, while two drags were missing.
    """
    unseen = worth_between(last, stage)
    by_far = unseen.sure and unseen.of_all.low > SETTINGS.pairs.least_single_share
    enough = unseen.low > SETTINGS.whole_runs.proving_share
    return no_better(last, stage) is None and (enough or by_far)


def _is_needed(single: FittedStage, pair: FittedStage) -> bool:
    """Whether a pair errs surely less than one of it alone: unseen runs, or all by a tenth.

    Of a boat whose unseen run a current alone led astray by 1.05 and a weak thruster beside it by
    0.65, that run was not sure, and training runs, which fell from 0.29 to 0.10, were not asked.
    Unseen ones by a tenth, too: a coupling removed 5 % beside a drag that had removed 93 % alone.
    """
    unseen = worth_between(single, pair)
    much = unseen.sure and not adds_little(replace(unseen, everywhere=None))
    return much or unseen.of_all.low > SETTINGS.whole_runs.proving_share


def _is_hopeless(runs: Runs, base: TrialFit, single: TrialFit, pair: TrialFit) -> bool:
    """Whether one of two does nothing of what both do.

    No fit from more starts is needed to say so: where a weak thruster beside a current brought a
    boat from an NRMSE of 0.91 to 0.09, a sway coupling in its place ended at 0.94 after 3100 steps.
    """
    helps = share_between(runs.fitter, base, single).sure
    return not helps and _share(runs, single, pair) > SETTINGS.pairs.least_single_share


def _share(runs: Runs, single: TrialFit, pair: TrialFit) -> float:
    """What a pair surely removes of the squared error of one of it, over unseen logs.

    Where errors accumulate, of that of runs that forget: beside a current a weak thruster brought a
    boat's training runs from 0.28 to 0.16, and one unseen run, astray for want of two drags, from
    0.61 to 0.67; a coupling was then added in its place.
    """
    return share_between(runs.fitter, single, pair).low


def _is_proven_alone(last: FittedStage, stage: FittedStage) -> bool:
    """Whether whole runs alone prove one effect: by far more than chance finds among many."""
    worth = worth_between(last, stage)
    return (
        not no_better(last, stage)
        and min(worth.low, worth.of_all.low) > SETTINGS.pairs.least_single_share
    )


def _removed(without: FittedStage, stage: FittedStage) -> Worth:
    """The share of the squared error of whole unseen runs that a stage removes of another's.

    Of these alone: on the training logs a model that lacks more than this pair does not end where
    unseen logs want it, and one effect stands in for another.
    """
    return replace(worth_between(without, stage), everywhere=None)


def _refitted(context: SearchContext, state: SearchState, trial: TrialFit) -> FittedStage:
    """The model of a trial, fitted to whole runs from its values and from those of the stage.

    From no random start: the trial comes from many, and a boat's random starts took half the time.
    With few integrator steps: a pair that nothing proved, a wind on an Otter, was followed to 32 a
    sample, for two thirds of the minutes that all its pairs took.
    """
    current = CurrentModel(context.fitter, trial)
    tried = replace(state, current=current)
    return compared_stage(context, tried, starts=1)


# -- adding it -------------------------------------------------------------------------------------


def _added(context: SearchContext, state: SearchState, *proven: FittedStage) -> SearchState:
    """The search with these stages, and with their effects in the current model."""
    fitter, present = context.fitter, state.current.trial
    stages = tuple(ended(context, stage) for stage in proven)
    values = {n: p.value for n, p in stages[-1].fit.model.parameters.items()}
    effects = tuple(dict.fromkeys((*present.effects, *stages[-1].effects)))
    settled = fitter.settled(effects, {**present.values, **values}, None, present.clip)
    return replace(
        state,
        current=CurrentModel(fitter, settled),
        stages=(*state.stages, *stages),
        refused={},
        possible={},
    )
