"""Effects fitted to whole runs: the trials' problem with nothing that corrects the states.

In the innovations form of a system with few measured states random forces can explain anything. So
where whole runs are poor and the search finds no more, every candidate is fitted to whole runs as
well: from there its trial begins anew, and what whole runs alone speak for is told as possible.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from diffthrust.diagnosis._admit import MARGIN, Tried, admit
from diffthrust.diagnosis._explained_share import Worth, far_above_noise
from diffthrust.diagnosis._findings import Stage
from diffthrust.diagnosis._innovations_fit import TrialFit, side_by_side
from diffthrust.diagnosis._screen import levels_of, screened
from diffthrust.diagnosis._search_state import SearchContext, SearchState
from diffthrust.diagnosis._simulation_fit import fitted_to_runs, share_between, simulation_fitter
from diffthrust.diagnosis._stages import rate
from diffthrust.effects import EFFECTS

_MOST = 4
"""So many of the effects that whole runs speak for are tried again, and told."""
_USERS = 3
"""So many effects of the user's own that promise nothing are fitted all the same."""
_CLEARLY = 0.1
"""An effect that surely removes more than this of the squared errors of whole unseen runs is asked
no more whether it predicts their next sample better."""


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
