"""Effects that logs cannot tell apart, and the test that would."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from diffthrust._support.errors import InputError
from diffthrust.diagnosis._criteria import price_of, unseen_gain
from diffthrust.diagnosis._screen import levels_of, screened
from diffthrust.diagnosis._search import SearchState, Tools
from diffthrust.diagnosis._stages import MARGIN
from diffthrust.diagnosis._trials import TrialFit
from diffthrust.experiments._result import Experiment
from diffthrust.experiments._suggest import suggest_experiment

_ALIKE = 8.0
"""Effects whose criteria differ by less than this cannot be told apart (odds of some 50 to 1)."""


def groups_of(tools: Tools, known: SearchState, first: TrialFit) -> tuple[tuple[str, ...], ...]:
    """For each added effect those that, in its place, explain the logs as well.

    Not those against which whole runs have spoken. The signals' levels are those of ``first``, the
    trial of the model as given.
    """
    trials, present = tools.trials, known.present.trial
    barred = {name for name, why in known.refused.items() if why.by_whole_runs}
    rivals = {c.effect for c in known.ranking if c.delta_bic < -MARGIN} - barred
    levels = levels_of(trials, first)
    groups = []
    for name in present.effects:
        without = trials.further(known.present.without(name))
        alike, price = [name], price_of(trials, present, name)
        others = sorted(rivals - {*present.effects})
        for rival, trial in screened(trials, others, without, levels).items():
            trial = trials.further(trial)
            worse = trial.cost - present.cost
            if rival in known.refused:
                worse -= unseen_gain(trials, present, trial)
            if 2 * worse + price_of(trials, trial) - price < _ALIKE:
                alike.append(rival)
        groups.append(tuple(alike))
    return tuple(groups)


def proposal(
    tools: Tools,
    known: SearchState,
    groups: Sequence[Sequence[str]],
    limits: Mapping[str, tuple[float, float]] | None,
) -> Experiment | None:
    """The test, within limits of the inputs, that would separate the first group of several."""
    trials = tools.trials
    for i, group in enumerate(groups):
        if len(group) < 2:
            continue
        tools.say("looking for a test that separates " + " and ".join(group), 0.95)
        effects = [trials.candidates[n] for n in known.present.trial.effects]
        rivals = [known.stages[-1].fit]
        log = max(trials.logs, key=lambda log: log.duration)
        try:
            for name in group[1:3]:
                effects[i] = trials.candidates[name]
                rivals.append(tools.refit(tools.given + effects))
            with tools.clock("experiment"):
                return suggest_experiment(
                    rivals,
                    duration=min(log.duration, 2000 * log.step),
                    step=log.step,
                    limits=limits,
                    logs=trials.logs,
                )
        except InputError:
            return None  # inputs that cannot be prescribed
    return None
