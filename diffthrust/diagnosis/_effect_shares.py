"""What each effect of a search removes of the error: when it came, and beside all others.

Shares that stand side by side are parts of the squared error of the model as given. Each is the
fall from the stage before the effect, so that they add up to what all effects remove. What an
effect removes beside all others, or alone, does not: such shares of a thruster with a dead band and
a lag added up to 113 % and -13 %.

That fall depends on what was there before: of a small thruster's runs dry friction removed 86 %
when it was the first, a load exponent in its place as much, and beside one another a tenth each of
what is left without them. An effect that changed nothing when it was tried may matter beside what
came later.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

from diffthrust.diagnosis._admission import record_stage
from diffthrust.diagnosis._candidates import with_candidates
from diffthrust.diagnosis._criteria import missed, no_better
from diffthrust.diagnosis._explained_share import (
    Worth,
    adds_little,
    matters,
    negligible,
    sure_share,
    worths_of,
)
from diffthrust.diagnosis._search_state import FittedStage, SearchContext, SearchState
from diffthrust.diagnosis._stage_fit import (
    ended_worse,
    errors_between,
    refitted_stage,
    worth_between,
)
from diffthrust.models._base.model import Model


class _Part(NamedTuple):
    """Effects that have one share, and the stages in which the error falls by them."""

    names: tuple[str, ...]
    steps: tuple[int, ...]


def shares_by_effect(stages: Sequence[FittedStage]) -> dict[str, Worth]:
    """What each effect of the last stage removes, of unseen logs if any, and of all logs together.

    Effects that came in one stage have a joint share, and so has one without which another does
    harm. What came in the place of another effect has the share of both.
    """
    if not (parts := list(_parts(stages))):
        return {}
    trained = errors_between(*(stage.runs for stage in stages))
    unseen = errors_between(*(stage.unseen_runs for stage in stages))
    worths = worths_of(trained, unseen, [part.steps for part in parts])
    while len(parts) > 1 and (harming := [k for k, worth in enumerate(worths) if _harms(worth)]):
        k = min(harming[0], len(parts) - 2)
        parts[k : k + 2] = [_Part(*(a + b for a, b in zip(*parts[k : k + 2], strict=True)))]
        worths = worths_of(trained, unseen, [part.steps for part in parts])
    return {
        name: replace(worth, together=part.names if len(part.names) > 1 else ())
        for part, worth in zip(parts, worths, strict=True)
        for name in part.names
    }


def _harms(worth: Worth) -> bool:
    return worth.share < 0 and sure_share(worth) is None


def _parts(stages: Sequence[FittedStage]) -> Iterator[_Part]:
    """The effects of the last stage, with the stages in which they came or took another's place."""
    parts: list[_Part] = []
    for k, (before, stage) in enumerate(itertools.pairwise(stages), 1):
        lost = {*before.effects} - {*stage.effects}
        replaced = [part for part in parts if lost & {*part.names}]
        names = [name for part in replaced for name in part.names if name not in lost]
        names += [name for name in stage.effects if name not in before.effects]
        steps = (*(step for part in replaced for step in part.steps), k)
        parts = [*(part for part in parts if part not in replaced), _Part(tuple(names), steps)]
    yield from (part for part in parts if part.names)


# -- beside all others -----------------------------------------------------------------------------


def with_shares_beside_others(context: SearchContext, state: SearchState) -> SearchState:
    """The search with what each of its effects does to whole runs beside all others.

    Of an effect of the last stage it is the share that it removes of the squared error which is
    left without it, the others fitted again; of a detectable one the share that it would remove of
    what is left. A detectable one that matters by now is added, if it removes a tenth: on the maps
    of a T200 a dead band removed 3 % beside five others, and could not be told from alpha. One of
    the last stage that does next to nothing beside the others is only detectable: a boat's two
    drags made a propeller's inflow superfluous that had stood in for them.
    """
    candidates, last = context.fitter.candidates, state.stages[-1]
    added = [name for name in last.effects if name in candidates] * (len(last.effects) > 1)
    beside = {}
    for name in added:
        fewer = _without(context, state, name)
        if not all(math.isfinite(e.nrmse) for e in (fewer.train, fewer.holdout) if e):
            continue  # runs that overflow without it are no measure of what it removes
        beside[name] = worth_between(fewer, last)
        if negligible(beside[name]):
            tried = replace(state, detectable=(*state.detectable, name))
            fitted = refitted_stage(context, tried)
            if not missed(last, fitted):
                stages = tuple(s for s in state.stages if {*s.effects} < {*fitted.effects})
                return with_shares_beside_others(context, replace(tried, stages=(*stages, fitted)))
    for name in state.detectable:
        tried = replace(state, detectable=tuple(n for n in state.detectable if n != name))
        fitted = refitted_stage(context, tried, starts=1, substeps=last.fit.substeps)
        if ended_worse(fitted, last):
            continue  # than without it: of a Kingfisher a yaw drag "removed" -706 to -202 %
        beside[name] = worth_between(last, fitted)
        if not adds_little(beside[name]) and matters(beside[name]):
            fitted = refitted_stage(context, tried)
            recorded = record_stage(context, tried, fitted, name)
            if no_better(last, fitted) is None and recorded.number > state.number:
                return with_shares_beside_others(context, recorded)
    return replace(state, beside=beside)


def _without(context: SearchContext, state: SearchState, name: str) -> FittedStage:
    """The last stage without one of its effects, fitted from where it is with it."""
    last = state.stages[-1]
    others = tuple(effect for effect in last.effects if effect != name)
    for stage in state.stages:
        if {*stage.effects} == {*others}:
            return stage
    plain = with_candidates(context.given, others, context.fitter.candidates, last.fit.model)
    held = _held_at_null(last.fit.model, name)
    free = {n: p.value for n, p in plain.parameters.items() if not p.fixed}
    values = {n: p.value for n, p in last.fit.model.parameters.items()}
    # also from the given model: on a bench of the NGS, without its dry friction, the simulation
    # overflows at the values of the last stage, and its share was told as all of the error
    guesses = [{n: values[n] for n in free}, *([free] if held else [])]
    context.say(f"fitting without {name}", state.share(1.0))
    fitted = context.refit(held or plain, guesses, starts=1, like=last.fit)
    return FittedStage(others, *fitted)


def _held_at_null(model: Model, name: str) -> Model | None:
    """The model with one of its effects held where it does nothing: nothing is compiled for it.

    None where a search has no such place: of a logarithm, of a limit without end, or of numbers
    that only matter while another is not at its null, which a fit would leave out.
    """
    effect = next(effect for effect in model.effects if effect.name == name)
    free = {n: p for n, p in effect._parameters.items() if not p.fixed}
    nulls = {n: p.null for n, p in free.items() if p.null is not None and math.isfinite(p.null)}
    if effect.differs or len(nulls) < len(free) or any(p.transform == "log" for p in free.values()):
        return None
    held = {n: {"value": v, "bounds": (v, math.nextafter(v, math.inf))} for n, v in nulls.items()}
    return model.replace({f"{name}.{n}": place for n, place in held.items()})
