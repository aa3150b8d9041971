"""Effects fitted to whole runs: the trials' problem with nothing that corrects the states.

In the innovations form of a system with few measured states random forces can explain anything. So
where whole runs are poor and the search finds no more, every candidate is fitted to whole runs as
well: from there its trial begins anew, and what whole runs alone speak for is told as possible.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from diffthrust.diagnosis._admit import MARGIN, Tried, admit
from diffthrust.diagnosis._findings import Stage
from diffthrust.diagnosis._screen import levels_of, screened
from diffthrust.diagnosis._search import SearchState, Tools
from diffthrust.diagnosis._stages import rate
from diffthrust.diagnosis._trials import Limit, TrialFit, Trials, side_by_side
from diffthrust.diagnosis._worth import BeforeAfter, Worth, far_above, worth_of
from diffthrust.effects import EFFECTS
from diffthrust.estimation._observer import is_memory
from diffthrust.estimation._one_step import passes

_MOST = 4
"""So many of the effects that whole runs speak for are tried again, and told."""
_USERS = 3
"""So many effects of the user's own that promise nothing are fitted all the same."""
_CLEARLY = 0.1
"""An effect that surely removes more than this of the squared errors of whole unseen runs is asked
no more whether it predicts their next sample better."""


def over_whole_runs(trials: Trials) -> Trials:
    """The same trials without an observer: no random force, no lasting error is estimated."""
    whole = copy(trials)
    whole.nuisance = ()
    return whole


def fitted_whole(tools: Tools, last: Stage, effects: Sequence[str] | None = None) -> TrialFit:
    """The model of a stage, or with fewer effects, fitted to whole runs from its values."""
    trials = tools.trials
    values = {n: p.value for n, p in trials.ready(last.effects).problem.named.items()}
    values |= {n: p.value for n, p in last.fit.model.parameters.items() if n in values}
    values |= {n: 0.0 for n in trials.nuisance if not is_memory(n)}
    names = last.effects if effects is None else tuple(effects)
    for name in {*last.effects} - {*names}:
        values = trials.absent(name, values)
    free = Limit(np.full(len(trials.channels), np.inf))
    whole = over_whole_runs(trials)
    return whole.further(whole.solve(names, values, None, free))


def trial_worth(trials: Trials, before: TrialFit, after: TrialFit) -> Worth:
    """What one trial removes of the errors of another, on unseen logs if there are any."""
    there = trials.ready({*before.effects, *after.effects})
    on = there.unseen or there.problem

    def held(trial: TrialFit) -> list[dict[str, tuple[np.ndarray, np.ndarray]]]:
        begin = trial.begin if on is there.problem else None
        problem = trial.limit.on(on.focus(trial.names, trial.values, begin))
        return [
            dict(zip(trials.channels, zip(one.measured, one.errors, strict=True), strict=True))
            for one in passes(problem)
        ]

    return worth_of(
        [
            {name: BeforeAfter(seen, rest, late[name][1]) for name, (seen, rest) in early.items()}
            for early, late in zip(held(before), held(after), strict=True)
        ]
    )


def are_poor(tools: Tools, known: SearchState, last: Stage) -> bool:
    """Whether the errors of a stage over whole runs are large and last."""
    sigma = known.present.trial.quadratic.sigma
    one_step = dict(zip(tools.trials.channels, map(float, sigma), strict=True))
    return bool(far_above(last.holdout or last.train, one_step))


def from_whole_runs(tools: Tools, known: SearchState) -> SearchState:
    """Try the effects again that lower the errors over whole runs, from their values there.

    The first that explains the next sample as well is added; the others are possible.
    """
    if not are_poor(tools, known, known.stages[-1]):
        return replace(known, possible={})
    tools.say("fitting the effects to whole runs", known.share(0.5))
    with tools.clock("whole runs"):
        lowering = _lowering(tools, known)
    known = replace(known, possible={name: worth for name, (worth, _) in lowering.items()})
    for name, (worth, whole) in lowering.items():
        with tools.clock("whole runs"):
            trial = _begun_anew(tools, known, name, whole)
            candidate = rate(tools.trials, known, trial, np.inf)
        if candidate.delta_bic > -MARGIN:
            continue
        proven = bool(tools.unseen) and worth.low > _CLEARLY
        outcome = admit(tools, known, Tried(candidate, trial), proven)
        if isinstance(outcome, SearchState) and outcome.found != known.found:
            here = known.number, name
            ranking = [c for c in outcome.ranking if (c.stage, c.effect) != here]
            ranking = sorted([*ranking, candidate], key=lambda c: (c.stage, c.delta_bic))
            return replace(outcome, ranking=tuple(ranking), refused={})
    return known


def _lowering(tools: Tools, known: SearchState) -> dict[str, tuple[Worth, TrialFit]]:
    """The effects that surely lower the errors over whole runs, each fitted to them, best first."""
    trials, base = tools.trials, fitted_whole(tools, known.stages[-1])
    present = {*known.present.trial.effects}
    names = [n for n in trials.candidates if n not in present]
    whole = over_whole_runs(trials)
    begun = screened(whole, names, base, levels_of(trials, base))
    users = [
        n for n in names if n not in begun and type(trials.candidates[n]) is not EFFECTS.get(n)
    ]
    begun |= {name: _fitted_anew(tools, known, base, name) for name in users[:_USERS]}
    ended = dict(zip(begun, side_by_side(whole.further, list(begun.values())), strict=True))
    worths = {name: trial_worth(trials, base, trial) for name, trial in ended.items()}
    best = sorted((n for n in ended if worths[n].sure), key=lambda n: -worths[n].share)
    return {name: (worths[name], ended[name]) for name in best[:_MOST]}


def _fitted_anew(tools: Tools, known: SearchState, base: TrialFit, name: str) -> TrialFit:
    """A whole-run fit of an effect that promised nothing where the model is, from several starts.

    A model that is wrong at heart may have run to where its effect shows no more.
    """
    fit = tools.refit(known.stages[-1].fit.model + tools.trials.candidates[name])
    values = {**base.values, **{n: p.value for n, p in fit.model.parameters.items()}}
    whole = over_whole_runs(tools.trials)
    return whole.solve((*base.effects, name), values, None, base.limit)


def _begun_anew(tools: Tools, known: SearchState, name: str, whole: TrialFit) -> TrialFit:
    """The trial of an effect, from where whole runs put it."""
    trials, present = tools.trials, known.present.trial
    theirs = ("", name, *known.stages[-1].effects)
    values = {n: v for n, v in whole.values.items() if n.rpartition(".")[0] in theirs}
    effects = (*present.effects, name)
    return trials.settled(effects, {**present.values, **values}, whole.begin, present.limit)
