"""Effects that logs cannot tell apart, and the test that would."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from diffthrust._support.errors import InputError
from diffthrust.diagnosis._screen import screened
from diffthrust.diagnosis._stages import MARGIN, Stages
from diffthrust.experiments._result import Experiment
from diffthrust.experiments._suggest import suggest_experiment

ALIKE = 8.0
"""Effects whose criteria differ by less than this cannot be told apart (odds of some 50 to 1)."""


def groups_of(search: Stages) -> tuple[tuple[str, ...], ...]:
    """For each added effect those that, in its place, explain the logs as well.

    Not those against which whole runs have spoken.
    """
    rivals = {c.effect for c in search.ranking if c.delta_bic < -MARGIN} - search.barred
    levels = search.trials.levels(search.first)
    out = []
    for name in search.present.effects:
        without = search.trials.further(search.without(name))
        alike, price = [name], search.price(search.present, name)
        others = sorted(rivals - set(search.present.effects))
        for rival, trial in screened(search.trials, others, without, levels).items():
            trial = search.trials.further(trial)
            worse = trial.cost - search.present.cost
            if rival in search.refused:
                worse -= search.trials.unseen_gain(search.present, trial)
            if 2 * worse + search.price(trial) - price < ALIKE:
                alike.append(rival)
        out.append(tuple(alike))
    return tuple(out)


def proposal(
    search: Stages,
    groups: Sequence[Sequence[str]],
    limits: Mapping[str, tuple[float, float]] | None,
) -> Experiment | None:
    """The test, within limits of the inputs, that would separate the first group of several."""
    for i, group in enumerate(groups):
        if len(group) < 2:
            continue
        search.say("looking for a test that separates " + " and ".join(group), 0.95)
        effects = [search.trials.candidates[n] for n in search.present.effects]
        rivals = [search.stages[-1].fit]
        log = max(search.train, key=lambda log: log.duration)
        try:
            for name in group[1:3]:
                effects[i] = search.trials.candidates[name]
                rivals.append(search.fitted(search.given + effects))
            return search.timed(
                "experiment",
                suggest_experiment,
                rivals,
                duration=min(log.duration, 2000 * log.step),
                step=log.step,
                limits=limits,
                logs=search.train,
            )
        except InputError:
            return None  # inputs that cannot be prescribed
    return None
