"""A rival in the place of an effect, where whole runs prove it the better one.

A search adds the effect that helps most where it stands. What came later may make a rival of it the
better one: a search of a BlueBoat once ended with a force exponent, which predicted the next sample
much better than a quadratic surge drag; by hand, the drag in its place halved the surge error over
whole runs. And what is only detectable may keep out a rival: of a tanker a rudder inflow, which
changes nothing over whole runs, stood for a quadratic sway drag.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from diffthrust.diagnosis._admission import ended, worths_between
from diffthrust.diagnosis._candidates import with_candidates
from diffthrust.diagnosis._criteria import no_better
from diffthrust.diagnosis._explained_share import adds_little, matters
from diffthrust.diagnosis._findings import Refusal
from diffthrust.diagnosis._innovations_fit import TrialFit, with_values
from diffthrust.diagnosis._search_state import (
    SOUGHT,
    CurrentModel,
    FittedStage,
    SearchContext,
    SearchState,
)
from diffthrust.diagnosis._settings import SETTINGS

_MOST_EXCHANGED = 2
"""Numerics: effects in whose place a rival may come. Of a tanker it was one; more could go to and
fro, one pulled by the next sample and one by whole runs."""


def refitted_rivals(
    context: SearchContext, stage: FittedStage, name: str, rivals: Mapping[str, TrialFit]
) -> dict[str, FittedStage]:
    """The last stage with each rival in the place of an effect, or of one that is only detectable.

    Fitted from several starts: where a rival was as good when the effect was added, what came later
    is fitted beside the effect, and a fit that starts there may end far from where the rival does
    best. On the maps of a T200 a linear damping wants five times the drive that a load exponent
    does. What a rival has by log is one value for all: with a value each it wins by its freedom.
    """
    stages, candidates = {}, context.fitter.candidates
    for rival, trial in rivals.items():
        names = (*(n for n in stage.effects if n != name), rival)
        alike = {r: candidates[r].differing(False) for r in (rival,) if r in candidates}
        shared = {**candidates, **alike}
        model = with_candidates(context.given, names, shared, stage.fit.model)
        free = {n for n, p in model.parameters.items() if not p.fixed}
        last = {n: e.value for n, e in stage.fit.parameters.items() if n in free}
        # the model's own parameters as the rival wants them, what came later as it is now
        later = {n: value for n, value in last.items() if n.rpartition(".")[0]}
        model = with_values(model, {**trial.values, **later})
        context.say(f"fitting with {rival} in place of {name}", SOUGHT)
        refitted = context.refit(model, [last], substeps=stage.fit.substeps)
        stages[rival] = FittedStage(names, *refitted)
    return stages


def with_exchange(
    context: SearchContext, state: SearchState, name: str, rivals: Mapping[str, FittedStage]
) -> SearchState | None:
    """The search with the best of some rivals in the place of an effect, if it is surely better.

    Whole runs must surely err less with it, in the place of an effect that is only detectable by a
    tenth. Never one that has given way itself, and so few in all that a search comes to an end.

    Args:
        context: what the search works with.
        state: where the search has ended.
        name: the effect.
        rivals: the last stage with each in its place.
    """
    last, most = state.stages[-1], SETTINGS.admission.most_effects
    may = state.number < most and len(state.exchanged) < _MOST_EXCHANGED
    candidates = {*context.fitter.candidates} - {*state.exchanged}
    better = _best(state, name, (s for rival, s in rivals.items() if rival in candidates))
    if not may or name in state.exchanged or better is None:
        return None
    better = _best(state, name, [ended(context, better)])
    return None if better is None else _exchanged(context, state, name, better, last)


def _best(state: SearchState, name: str, stages: Iterable[FittedStage]) -> FittedStage | None:
    better = [stage for stage in stages if _is_better(state, name, stage)]
    return min(better, key=lambda stage: stage.train.nrmse, default=None)


def _is_better(state: SearchState, name: str, stage: FittedStage) -> bool:
    last = state.stages[-1]
    worth, everywhere = worths_between(last, stage)
    little = adds_little(replace(worth, everywhere=everywhere))
    if no_better(last, stage) or (little and name in state.detectable):
        return False
    return everywhere.share > 0.0 and matters(worth, everywhere)


def _exchanged(
    context: SearchContext, state: SearchState, name: str, better: FittedStage, last: FittedStage
) -> SearchState:
    fitter, trial = context.fitter, state.current.trial
    (rival,) = (effect for effect in better.effects if effect not in last.effects)
    values = {**trial.values, **{n: p.value for n, p in better.fit.model.parameters.items()}}
    values = fitter.absent(name, values)
    effects = (*(n for n in trial.effects if n not in (name, rival)), rival)
    settled = fitter.settled(effects, values, None, trial.clip)
    return replace(
        state,
        current=CurrentModel(fitter, settled),
        stages=(*state.stages, better),
        exchanged={**state.exchanged, name: rival},
        turned_down={**state.turned_down, name: (Refusal.EXCHANGED, effects)},
        detectable=tuple(n for n in state.detectable if n not in (name, rival)),
        refused={},
        possible={},
        exhausted=False,
    )
