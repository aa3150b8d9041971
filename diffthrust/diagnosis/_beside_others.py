"""What each effect of a search does beside all others, once the search has ended.

The fall of the error at the stage at which an effect came depends on what was there before: of a
small thruster's runs dry friction removed 86 % when it was the first, a load exponent in its place
as much, and beside one another a tenth each of what is left without them. An effect that changed
nothing when it was tried may matter beside what came later.
"""

from __future__ import annotations

import math
from dataclasses import replace

from diffthrust.diagnosis._admission import (
    ended_worse,
    record_stage,
    refitted_stage,
    worths_between,
)
from diffthrust.diagnosis._candidates import with_candidates
from diffthrust.diagnosis._criteria import missed, no_better
from diffthrust.diagnosis._explained_share import Worth, adds_little, matters, negligible
from diffthrust.diagnosis._search_state import FittedStage, SearchContext, SearchState
from diffthrust.models._base.model import Model


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
        shares = worths_between(fewer, last)
        beside[name] = _with_everywhere(context, *shares)
        if negligible(*shares):
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
        shares = worths_between(last, fitted)
        beside[name] = _with_everywhere(context, *shares)
        if not adds_little(beside[name]) and matters(*shares):
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
    fitted = context.refit(held or plain, guesses, starts=1, substeps=last.fit.substeps)
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


def _with_everywhere(context: SearchContext, worth: Worth, everywhere: Worth) -> Worth:
    return replace(worth, everywhere=everywhere if context.unseen else None)
