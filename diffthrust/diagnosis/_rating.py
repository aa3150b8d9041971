"""The candidates of a stage, each tried beside the present model and rated."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from diffthrust.diagnosis._criteria import (
    CLEAR,
    MARGIN,
    criterion,
    price_of,
    simulation_errors,
    unseen_cost,
    unseen_gain,
)
from diffthrust.diagnosis._findings import TriedEffect
from diffthrust.diagnosis._innovations_fit import (
    CandidateFitter,
    TrialFit,
    side_by_side,
)
from diffthrust.diagnosis._score_test import redundant
from diffthrust.diagnosis._screen import is_at_null, levels_of, screened
from diffthrust.diagnosis._search_state import PLAIN, CurrentModel, SearchContext, SearchState
from diffthrust.estimation._estimate import Estimate, shown_unit
from diffthrust.logs._written import ShownUnits
from diffthrust.models._base.parameter import Parameter

_CARRIED = 6
"""So many of the effects tried at a stage are fitted to the end."""
ALONE = 0.05
"""An effect is worth a closer look where its likelihood ratio alone would come so rarely."""
_WORSE = 3.0
"""A noise that costs the unseen logs more log-likelihood than this (odds of 20 to 1) is no better
one. An effect is refused whose gain is no longer worth its price when that cost is taken from it:
of training and unseen logs neither speaks louder than its likelihood."""
_GONE = 1e-2
"""A positive parameter below this share of what simulations say is as good as zero."""
_AT_BOUND = 1e-6
"""A value so near to its bound, as a share of it, was stopped by it."""
_POOR = 0.5
"""With a larger error of whole training runs (NRMSE) the fit may have gone astray."""


class Tried(NamedTuple):
    """An effect that was tried beside the present model, and what is told of it."""

    candidate: TriedEffect
    trial: TrialFit


def screen(tools: SearchContext, known: SearchState) -> tuple[SearchState, list[Tried]]:
    """Try all candidates that are not in the model: those that promise something, best first."""
    trials, present = tools.fitter, known.current.trial
    names = [n for n in (*trials.candidates, *trials.constants) if n not in present.effects]

    def say(name: str) -> None:
        share = known.share(0.5 * names.index(name) / len(names))
        tools.say(f"stage {known.number + 1}: trying {name}", share)

    promising, untestable = [], dict(known.untestable)
    levels, others = levels_of(trials, present), other_values(tools, known)
    for name, trial in screened(trials, names, present, levels, say, others).items():
        # what gains so much, the other parameters cannot do from where they are
        gains = present.cost - trial.cost > PLAIN
        if not gains and redundant(trial.quadratic, trial.names, name):
            if name not in trials.constants:
                untestable.setdefault(name, "other parameters do the same to what is measured")
        else:
            promising.append((name, trial))
    silent = known.silent | ({*names} - {name for name, _ in promising})
    promising.sort(key=lambda pair: pair[1].expected)
    ended = side_by_side(trials.further, [trial for _, trial in promising[:_CARRIED]])
    ended += [trial for _, trial in promising[_CARRIED:]]
    _ = known.current.criterion  # before any of several threads asks
    leading = min((price_of(trials, trial) + 2 * trial.cost for trial in ended), default=0.0)

    def rated(trial: TrialFit) -> Tried:
        return Tried(rate(trials, known, trial, leading), trial)

    tried = sorted(side_by_side(rated, ended), key=lambda one: one.candidate.delta_bic)
    return replace(known, untestable=untestable, silent=silent), tried


def other_values(tools: SearchContext, known: SearchState) -> Mapping[str, float] | None:
    """Values to try effects with besides the present ones, which may have gone astray.

    Where whole runs fail the search's own; where the observer explains all by random forces,
    and the model is left with nothing to do, those of the simulation.
    """
    last, trials = known.stages[-1], tools.fitter
    if tools.guess and last.train.nrmse > _POOR:
        return tools.guess
    fitted = {n: p.value for n, p in last.fit.model.parameters.items() if not p.fixed}
    logs = [n for n in trials.free if trials.problem.named[n].transform == "log"]
    values = known.current.trial.values
    gone = any(values[n] < _GONE * fitted[n] for n in logs if n in fitted)
    return fitted if gone else None


def rate(
    trials: CandidateFitter, known: SearchState, trial: TrialFit, leading: float
) -> TriedEffect:
    """What is told of a trial; its noises are priced where that may make it the best."""
    from scipy.special import chdtrc  # slow to import

    present, own = known.current, trial.parameters_of()
    ratio = max(0.0, 2 * (present.trial.cost - trial.cost))
    p_value = float(chdtrc(len(own), ratio))
    delta = price_of(trials, trial) - ratio
    behind = price_of(trials, trial) + 2 * trial.cost - leading
    if delta > -CLEAR and p_value < ALONE and behind < CLEAR:
        delta = criterion(trials, trial) - present.criterion
    errors = simulation_errors(trials, trial)
    named, shown = trial.problem.named, ShownUnits(r.log.written for r in trials.records)
    sizes = {n: shown_unit(named[n], trial.problem.model, shown) for n in own}
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
            n.removeprefix(f"{trial.effects[-1]}."): Estimate(
                trial.values[n],
                None,
                named[n].unit,
                False,
                stopped(named[n], trial.values[n]),
                *sizes[n],
            )
            for n in own
        },
    )


def stopped(parameter: Parameter, value: float) -> bool:
    """Whether a bound stopped a parameter; at its null an effect has gone, and was not stopped.

    Example:
        >>> stopped(parameter(4.0, bounds=(0, 5), null=0.0), 5.0)
        True
    """
    ends = (end for end in parameter.limits if math.isfinite(end))
    near = (e for e in ends if abs(value - e) <= _AT_BOUND * max(abs(e), parameter.scale))
    return any(end != parameter.null for end in near)


def better_noise(
    trials: CandidateFitter, present: CurrentModel, tried: list[Tried]
) -> CurrentModel | None:
    """The present model with a noise that was found while trying an effect, if it is better.

    That is so where the trial, its effect taken out, explains the logs better than the present
    model: its gain was then not the effect's.
    """
    for place, (candidate, trial) in enumerate(tried):
        doubtful = (place == 0 and candidate.delta_bic > -PLAIN) or is_at_null(trials, trial)
        if not doubtful or candidate.delta_bic >= -MARGIN:
            continue
        now, values = present.trial, trials.absent(candidate.effect, trial.values)
        without = trials.settled(now.effects, values, trial.begin, now.limit)
        if without.cost < now.cost - 0.5 * MARGIN:
            alike = replace(now, limit=without.limit)
            if not unseen_cost(trials, without) > unseen_cost(trials, alike) + _WORSE:
                return CurrentModel(trials, without)
    return None
