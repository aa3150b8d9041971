"""The steps of a search: screen the candidates, admit the best, or look at whole runs.

`step` adds an effect or ends the search. The `SearchContext` stays as it is; each step takes the
`SearchState` so far, and returns the next.

In the innovations form of a system with few measured states random forces can explain anything. So
where whole runs are poor and one-step errors ask for nothing more, every candidate is fitted to
whole runs as well: its trial starts again from there, and what whole runs alone speak for is
reported as possible.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diffthrust.diagnosis._admission import admit
from diffthrust.diagnosis._criteria import (
    MARGIN,
)
from diffthrust.diagnosis._explained_share import Worth
from diffthrust.diagnosis._findings import Refusal, Stage, TriedEffect
from diffthrust.diagnosis._innovations_fit import TrialFit, side_by_side
from diffthrust.diagnosis._rating import ALONE, Tried, better_noise, rate, screen
from diffthrust.diagnosis._screen import levels_of, screened
from diffthrust.diagnosis._search_state import SearchContext, SearchState
from diffthrust.diagnosis._simulation_fit import fitted_to_runs, share_between, simulation_fitter
from diffthrust.diagnosis._verdict import far_above_noise
from diffthrust.effects import EFFECTS

_MOST_STAGES = 5
"""Most stages, and most effects that are only detectable."""
SCREENS = 3
"""Most screens for one stage: a better noise may come to light again and again on flat ridges."""
_MOST = 4
"""So many of the effects that whole runs speak for are tried again, and told."""
_USERS = 3
"""So many effects of the user's own that promise nothing are fitted all the same."""
_CLEARLY = 0.1
"""An effect that surely removes more than this of the squared errors of whole unseen runs is asked
no more whether it predicts their next sample better."""


def step(context: SearchContext, state: SearchState) -> SearchState:
    """Add the best effect, by one-step errors or, where these say nothing, by whole runs."""
    updated = next_stage(context, state)
    if updated.accepted == state.accepted:
        updated = from_simulation(context, updated)
    return replace(updated, exhausted=updated.accepted == state.accepted)


def done(state: SearchState) -> bool:
    """Whether the last step added nothing, or the search has come to its last stage."""
    return state.exhausted or max(state.number, len(state.detectable)) >= _MOST_STAGES


def next_stage(tools: SearchContext, known: SearchState) -> SearchState:
    """Add the best effect, if any is worth it; drop what it made superfluous.

    On its way a better noise may be found; then the candidates are screened anew beside it.
    """
    for again in reversed(range(SCREENS)):
        before, known = known, one_round(tools, known, again > 0)
        if known.accepted != before.accepted or known.current is before.current:
            break
    return known


def one_round(tools: SearchContext, known: SearchState, again: bool) -> SearchState:
    """Screen the candidates, and add the best that passes.

    With ``again`` a better noise ends the round, if one has come to light.
    """
    with tools.clock("screen"):
        known, tried = screen(tools, known)
    if again and (quieter := better_noise(tools.fitter, known.current, tried)):
        return replace(known, current=quieter)
    known = replace(known, refused={}, ranking=ranked(known, [one for one, _ in tried]))
    for place, (candidate, trial) in enumerate(tried):
        if place and candidate.p_value < ALONE:  # beside the first its noise was not priced
            candidate = rate(tools.fitter, known, trial, math.inf)
        if candidate.delta_bic > -MARGIN:
            continue
        outcome = still_refused(tools, known, candidate.effect)
        outcome = outcome or admit(tools, known, Tried(candidate, trial))
        if isinstance(outcome, SearchState):
            return outcome
        known = refusing(known, candidate.effect, outcome)
    return known


def ranked(known: SearchState, tried: Sequence[TriedEffect]) -> tuple[TriedEffect, ...]:
    """The effects that were tried, by stage, the best first.

    Beside an effect that is only detectable its rivals explain nothing more: of what was tried in
    the same stage before it, the better result is kept.
    """
    earlier = [one for one in known.ranking if one.stage < known.number]
    before = [one for one in known.ranking if one.stage == known.number and known.detectable]
    best: dict[str, TriedEffect] = {}
    for one in sorted([*before, *tried], key=lambda one: one.delta_bic):
        best.setdefault(one.effect, one)
    return (*earlier, *best.values())


def refusing(known: SearchState, name: str, why: Refusal) -> SearchState:
    """The search with an effect that was refused beside the present ones."""
    told = why, known.current.trial.effects
    return replace(
        known,
        refused={**known.refused, name: why},
        turned_down={**known.turned_down, name: told},
    )


def still_refused(tools: SearchContext, known: SearchState, name: str) -> Refusal | None:
    """Why whole runs have refused an effect, where nothing that came since could change that.

    That is so where no effect was added or dropped since that shares a port or a signal with it.
    """
    why, beside = known.turned_down.get(name, (None, ()))
    if why is None or not why.by_whole_runs:
        return None
    candidates = tools.fitter.candidates
    moved = {*known.current.trial.effects} ^ {*beside}
    if not {name, *moved} <= {*candidates}:  # a constant may act anywhere
        return None if moved else why
    own = {*candidates[name].ports, *candidates[name].needs}
    touched = any(own & {*candidates[n].ports, *candidates[n].needs} for n in moved)
    return None if touched else why


def simulation_is_poor(tools: SearchContext, known: SearchState, last: Stage) -> bool:
    """Whether the errors of a stage over whole runs are large and last."""
    sigma = known.current.trial.quadratic.sigma
    one_step = dict(zip(tools.fitter.channels, map(float, sigma), strict=True))
    return bool(far_above_noise(last.holdout or last.train, one_step))


def from_simulation(tools: SearchContext, known: SearchState) -> SearchState:
    """Try the effects again that lower the errors over whole runs, from their values there.

    The first that explains the next sample as well is added; the others are possible.
    """
    if not simulation_is_poor(tools, known, known.stages[-1]):
        return replace(known, possible={})
    tools.say("fitting the effects to whole runs", known.share(0.5))
    with tools.clock("whole runs"):
        lowering = _lowering(tools, known)
    known = replace(known, possible={name: worth for name, (worth, _) in lowering.items()})
    for name, (worth, whole) in lowering.items():
        with tools.clock("whole runs"):
            trial = _begun_anew(tools, known, name, whole)
            candidate = rate(tools.fitter, known, trial, np.inf)
        if candidate.delta_bic > -MARGIN:
            continue
        proven = bool(tools.unseen) and worth.low > _CLEARLY
        outcome = admit(tools, known, Tried(candidate, trial), proven)
        if isinstance(outcome, SearchState) and outcome.accepted != known.accepted:
            here = known.number, name
            ranking = [c for c in outcome.ranking if (c.stage, c.effect) != here]
            ranking = sorted([*ranking, candidate], key=lambda c: (c.stage, c.delta_bic))
            return replace(outcome, ranking=tuple(ranking), refused={})
    return known


def _lowering(tools: SearchContext, known: SearchState) -> dict[str, tuple[Worth, TrialFit]]:
    """The effects that surely lower the errors over whole runs, each fitted to them, best first."""
    trials = tools.fitter
    base = fitted_to_runs(trials, known.stages[-1])
    present = {*known.current.trial.effects}
    names = [n for n in trials.candidates if n not in present]
    whole = simulation_fitter(trials)
    begun = screened(whole, names, base, levels_of(trials, base))
    users = [
        n for n in names if n not in begun and type(trials.candidates[n]) is not EFFECTS.get(n)
    ]
    begun |= {name: _fitted_anew(tools, known, base, name) for name in users[:_USERS]}
    ended = dict(zip(begun, side_by_side(whole.further, list(begun.values())), strict=True))
    worths = {name: share_between(trials, base, trial) for name, trial in ended.items()}
    best = sorted((n for n in ended if worths[n].sure), key=lambda n: -worths[n].share)
    return {name: (worths[name], ended[name]) for name in best[:_MOST]}


def _fitted_anew(tools: SearchContext, known: SearchState, base: TrialFit, name: str) -> TrialFit:
    """A whole-run fit of an effect that promised nothing where the model is, from several starts.

    A model that is wrong at heart may have run to where its effect shows no more.
    """
    fit = tools.refit(known.stages[-1].fit.model + tools.fitter.candidates[name])
    values = {**base.values, **{n: p.value for n, p in fit.model.parameters.items()}}
    whole = simulation_fitter(tools.fitter)
    return whole.solve((*base.effects, name), values, None, base.limit)


def _begun_anew(tools: SearchContext, known: SearchState, name: str, whole: TrialFit) -> TrialFit:
    """The trial of an effect, from where whole runs put it."""
    trials, present = tools.fitter, known.current.trial
    theirs = ("", name, *known.stages[-1].effects)
    values = {n: v for n, v in whole.values.items() if n.rpartition(".")[0] in theirs}
    effects = (*present.effects, name)
    return trials.settled(effects, {**present.values, **values}, whole.begin, present.limit)
