"""What each effect of a search does beside all others, once the search has ended.

The fall of the error at the stage at which an effect came depends on what was there before: of a
small thruster's runs dry friction removed 86 % when it was the first, a load exponent in its place
as much, and beside one another a tenth each of what is left without them. An effect that changed
nothing when it was tried may matter beside what came later.
"""

from __future__ import annotations

from dataclasses import replace

from diffthrust.diagnosis._admission import record_stage, refitted_stage
from diffthrust.diagnosis._criteria import no_better
from diffthrust.diagnosis._explained_share import Worth, matters
from diffthrust.diagnosis._search_state import SearchContext, SearchState
from diffthrust.diagnosis._simulation_fit import (
    SimulationChange,
    change_between,
    fitted_beside,
    fitted_to_runs,
    fitted_without,
    simulation_fitter,
)


def with_shares_beside_others(context: SearchContext, state: SearchState) -> SearchState:
    """The search with what each of its effects does to whole runs beside all others.

    Of an effect of the last stage it is the share that it removes of the squared error which is
    left without it, the others fitted again; of a detectable one the share that it would remove of
    what is left. A detectable one that matters by now is added.
    """
    fitter, last = context.fitter, state.stages[-1]
    several = len(last.effects) > 1
    added = [n for n in last.effects if several and n in fitter.candidates]
    outside = [n for n in state.detectable if n in fitter.candidates]
    if not added and not outside:
        return replace(state, beside={})
    with context.clock("whole runs"):
        simulation_fitter(fitter).ready(last.effects, outside)  # one program for all of them
        base = fitted_to_runs(fitter, last)
        beside = {}
        for name in added:
            others = [n for n in last.effects if n != name]
            without = fitted_without(fitter, base, others)
            beside[name] = _worth(context, change_between(fitter, without, base))
        for name in outside:
            names = (*last.effects, name)
            updated = fitted_beside(fitter, last, state.current.trial, names)
            beside[name] = _worth(context, change_between(fitter, base, updated))
    late = [n for n in outside if matters(beside[n], beside[n].everywhere or beside[n])]
    for name in sorted(late, key=lambda n: -beside[n].share):
        tried = replace(state, detectable=tuple(n for n in state.detectable if n != name))
        fitted = refitted_stage(context, tried)
        if no_better(last, fitted) is None:
            recorded = record_stage(context, tried, fitted, name)
            if recorded.number > state.number:
                return with_shares_beside_others(context, recorded)
    return replace(state, beside=beside)


def _worth(context: SearchContext, change: SimulationChange) -> Worth:
    return replace(change.worth, everywhere=change.everywhere if context.unseen else None)
