"""The stages of a diagnosis, step by step: screen, rate, admit, drop, refit.

`next_stage` adds an effect, or ends the search. What a search works with, its `Tools`, stays as it
is; each step takes what is `SearchState` so far, and returns what is known after it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from diffthrust.diagnosis._criteria import (
    criterion,
    missed,
    no_better,
    price_of,
    simulation_errors,
    unseen_cost,
    unseen_gain,
)
from diffthrust.diagnosis._findings import Refusal, Stage, TriedEffect
from diffthrust.diagnosis._ports import KNOTS
from diffthrust.diagnosis._score_test import redundant
from diffthrust.diagnosis._screen import is_idle, levels_of, screened
from diffthrust.diagnosis._search import PLAIN, Present, SearchState, Tools
from diffthrust.diagnosis._structure import gain_of
from diffthrust.diagnosis._trials import TrialFit, Trials, side_by_side, with_values
from diffthrust.estimation._estimate import Estimate, shown_unit
from diffthrust.logs._written import ShownUnits

MARGIN = 4.0
"""An effect is added where it lowers the information criterion by more than this, so that one of
some thirty candidates passes by chance in about one diagnosis of a hundred."""
SCREENS = 3
"""Most screens for one stage: a better noise may come to light again and again on flat ridges."""
_CARRIED = 6
"""So many of the effects tried at a stage are fitted to the end."""
_ALONE = 0.05
"""An effect is worth a closer look where its likelihood ratio alone would come so rarely."""
_CLEAR = 20.0
"""Where the criterion falls by more than this, no noise that it makes superfluous matters."""
_WORSE = 3.0
"""A noise that costs the unseen logs more log-likelihood than this (odds of 20 to 1) is no better
one. An effect is refused whose gain is no longer worth its price when that cost is taken from it:
of training and unseen logs neither speaks louder than its likelihood."""
_GONE = 1e-2
"""A positive parameter below this share of what simulations say is as good as zero."""
_POOR = 0.5
"""With a larger error of whole training runs (NRMSE) the fit may have gone astray."""
_PART = 0.3
"""An effect that explains less than this part of what an unknown signal does is not it."""
_OWN = 0.5
"""It is something else, and missing as well, if it keeps so much of its gain beside that signal."""


class Tried(NamedTuple):
    """An effect that was tried beside the present model, and what is told of it."""

    candidate: TriedEffect
    trial: TrialFit


def next_stage(tools: Tools, known: SearchState) -> SearchState:
    """Add the best effect, if any is worth it; drop what it made superfluous.

    On its way a better noise may be found; then the candidates are screened anew beside it.
    """
    for again in reversed(range(SCREENS)):
        before, known = known, one_round(tools, known, again > 0)
        if known.number > before.number or known.present is before.present:
            break
    return known


def one_round(tools: Tools, known: SearchState, again: bool) -> SearchState:
    """Screen the candidates, and add the best that passes.

    With ``again`` a better noise ends the round, if one has come to light.
    """
    with tools.clock("screen"):
        known, tried = screen(tools, known)
    if again and (quieter := better_noise(tools.trials, known.present, tried)):
        return replace(known, present=quieter)
    earlier = tuple(one for one in known.ranking if one.stage < known.number)
    known = replace(known, refused={}, ranking=(*earlier, *(candidate for candidate, _ in tried)))
    for place, (candidate, trial) in enumerate(tried):
        if place and candidate.p_value < _ALONE:  # beside the first its noise was not priced
            candidate = rate(tools.trials, known, trial, math.inf)
        if candidate.delta_bic > -MARGIN:
            continue
        outcome = admit(tools, known, Tried(candidate, trial))
        if isinstance(outcome, SearchState):
            return outcome
        known = replace(known, refused={**known.refused, candidate.effect: outcome})
    return known


def screen(tools: Tools, known: SearchState) -> tuple[SearchState, list[Tried]]:
    """Try all candidates that are not in the model: those that promise something, best first."""
    trials, present = tools.trials, known.present.trial
    names = [n for n in trials.candidates if n not in present.effects]

    def say(name: str) -> None:
        share = 0.2 + 0.1 * known.number + 0.1 * names.index(name) / len(names)
        tools.say(f"stage {known.number + 1}: trying {name}", share)

    promising, untestable = [], dict(known.untestable)
    levels, others = levels_of(trials, present), other_values(tools, known)
    for name, trial in screened(trials, names, present, levels, say, others).items():
        # what gains so much, the other parameters cannot do from where they are
        gains = present.cost - trial.cost > PLAIN
        if not gains and redundant(trial.quadratic, trial.names, name):
            untestable.setdefault(name, "other parameters do the same to what is measured")
        else:
            promising.append((name, trial))
    silent = known.silent | ({*names} - {name for name, _ in promising})
    promising.sort(key=lambda pair: pair[1].expected)
    ended = side_by_side(trials.further, [trial for _, trial in promising[:_CARRIED]])
    ended += [trial for _, trial in promising[_CARRIED:]]
    _ = known.present.criterion  # before any of several threads asks
    leading = min((price_of(trials, trial) + 2 * trial.cost for trial in ended), default=0.0)

    def rated(trial: TrialFit) -> Tried:
        return Tried(rate(trials, known, trial, leading), trial)

    tried = sorted(side_by_side(rated, ended), key=lambda one: one.candidate.delta_bic)
    return replace(known, untestable=untestable, silent=silent), tried


def other_values(tools: Tools, known: SearchState) -> Mapping[str, float] | None:
    """Values to try effects with besides the present ones, which may have gone astray.

    Where whole runs fail the search's own; where the observer explains all by random forces,
    and the model is left with nothing to do, those of the simulation.
    """
    last, trials = known.stages[-1], tools.trials
    if tools.guess and last.train.nrmse > _POOR:
        return tools.guess
    fitted = {n: p.value for n, p in last.fit.model.parameters.items() if not p.fixed}
    logs = [n for n in trials.own if trials.problem.named[n].transform == "log"]
    values = known.present.trial.values
    gone = any(values[n] < _GONE * fitted[n] for n in logs if n in fitted)
    return fitted if gone else None


def rate(trials: Trials, known: SearchState, trial: TrialFit, leading: float) -> TriedEffect:
    """What is told of a trial; its noises are priced where that may make it the best."""
    from scipy.special import chdtrc  # slow to import

    present, own = known.present, trial.own()
    ratio = max(0.0, 2 * (present.trial.cost - trial.cost))
    p_value = float(chdtrc(len(own), ratio))
    delta = price_of(trials, trial) - ratio
    behind = price_of(trials, trial) + 2 * trial.cost - leading
    if delta > -_CLEAR and p_value < _ALONE and behind < _CLEAR:
        delta = criterion(trials, trial) - present.criterion
    errors = simulation_errors(trials, trial)
    named, shown = trials.problem.named, ShownUnits(log.written for log in trials.logs)
    sizes = {n: shown_unit(named[n], trials.problem.model, shown) for n in own}
    return TriedEffect(
        stage=known.number,
        effect=trial.effects[-1],
        likelihood_ratio=ratio,
        delta_bic=delta,
        p_value=p_value,
        holdout_gain=unseen_gain(trials, present.trial, trial),
        train_nrmse=errors[0],
        holdout_nrmse=errors[1],
        parameters={
            n.partition(".")[2]: Estimate(
                trial.values[n], None, named[n].unit, False, False, *sizes[n]
            )
            for n in own
        },
    )


def better_noise(trials: Trials, present: Present, tried: list[Tried]) -> Present | None:
    """The present model with a noise that was found while trying an effect, if it is better.

    That is so where the trial, its effect taken out, explains the logs better than the present
    model: its gain was then not the effect's.
    """
    for place, (candidate, trial) in enumerate(tried):
        doubtful = (place == 0 and candidate.delta_bic > -PLAIN) or is_idle(trials, trial)
        if not doubtful or candidate.delta_bic >= -MARGIN:
            continue
        now, values = present.trial, trials.absent(candidate.effect, trial.values)
        without = trials.settled(now.effects, values, trial.begin, now.limit)
        if without.cost < now.cost - 0.5 * MARGIN:
            alike = replace(now, limit=without.limit)
            if not unseen_cost(trials, without) > unseen_cost(trials, alike) + _WORSE:
                return Present(trials, without)
    return None


def admit(tools: Tools, known: SearchState, tried: Tried) -> SearchState | Refusal:
    """Add an effect, with a stage of its own, or say why not.

    Without a stage nor a refusal the effect has turned out superfluous.
    """
    trials, before, (candidate, trial) = tools.trials, known.present, tried
    if not comparable(tools, before, tried):
        return Refusal.SMALL_PART
    with tools.clock("screen"):
        settled = trials.settled(trial.effects, trial.values, trial.begin, trial.limit)
    unseen = unseen_gain(trials, before.trial, settled)
    if candidate.delta_bic - 2 * min(unseen, 0.0) > -MARGIN:
        return Refusal.UNSEEN_LOGS
    added = replace(known, present=Present(trials, settled))
    fewer = drop(trials, added)
    if {*fewer.present.trial.effects} == {*before.trial.effects}:
        return fewer
    tools.say(f"refitting with {candidate.effect}", 0.3 + 0.1 * known.number)
    last, fitted = known.stages[-1], refitted(tools, fewer.present.trial)
    swapped = fewer.dropped != known.dropped and candidate.effect in fewer.present.trial.effects
    if swapped and missed(last, fitted):
        fewer, fitted = added, refitted(tools, settled)
    refusal = no_better(last, fitted)
    return refusal or replace(fewer, stages=(*known.stages, fitted))


def comparable(tools: Tools, present: Present, tried: Tried) -> bool:
    """Whether an effect explains what is missing, not a small part that it happens to touch.

    A function of one signal that no known effect is like may explain far more. What an effect
    explains is its own where that function explains as much beside it as it did alone.
    """
    trials, (candidate, trial) = tools.trials, tried
    with tools.clock("remaining"):
        left = present.remaining
    if left is None:
        return True
    unknown = left.gain - KNOTS * math.log(trials.samples)
    if -candidate.delta_bic > _PART * unknown:
        return True
    with tools.clock("remaining"):
        beside = gain_of(trials, trial, left)
    kept = candidate.likelihood_ratio - (left.gain - beside)
    return kept > max(_OWN * candidate.likelihood_ratio, price_of(trials, trial) + MARGIN)


def drop(trials: Trials, known: SearchState) -> SearchState:
    """Take out every effect without which the criterion is no worse.

    The last one too: on its way to the optimum the fit may have found a better noise.
    """
    effects = known.present.trial.effects
    for name in effects:
        present = known.present
        without = present.without(name)
        loss = 2 * (without.cost - present.trial.cost) - price_of(trials, present.trial, name)
        if loss < _CLEAR:
            loss = criterion(trials, without) - present.criterion
        if loss < MARGIN:
            dropped = known.dropped if name == effects[-1] else (*known.dropped, name)
            known = replace(known, present=Present(trials, without), dropped=dropped)
    return known


def refitted(tools: Tools, trial: TrialFit) -> Stage:
    """The model with the effects of a trial, fitted to whole runs."""
    effects = [tools.trials.candidates[n] for n in trial.effects]
    return Stage(trial.effects, tools.refit(with_values(tools.given + effects, trial.values)))
