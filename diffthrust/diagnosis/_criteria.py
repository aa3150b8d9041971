"""The information criterion of a trial, which charges for its noise as well."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from diffthrust.diagnosis._trials import Trial, Trials
from diffthrust.estimation._observer import is_memory

_REMEMBERED = {"drift": "memory", "colour": "correlation"}
BUDGET = 12
"""Steps of a fit without one of the noises."""


class Noise(NamedTuple):
    """One random force or lasting error: its gains, and its memory if it has one."""

    gains: tuple[str, ...]
    memory: tuple[str, ...]

    @property
    def parameters(self) -> tuple[str, ...]:
        """All of them."""
        return (*self.gains, *self.memory)


def noises(nuisance: Sequence[str]) -> list[Noise]:
    """The parameters of an observer by what they tell of.

    Example:
        >>> [noise.gains for noise in noises(["noise.speed.gain.speed", "noise.thrust.colour"])]
        [('noise.speed.gain.speed',), ('noise.thrust.colour',)]
    """
    gains: dict[tuple[str, str], list[str]] = {}
    for name in nuisance:
        if not is_memory(name):
            _, of, kind, *_ = name.split(".")
            gains.setdefault((of, kind), []).append(name)
    return [
        Noise(tuple(names), tuple({f"noise.{of}.{_REMEMBERED.get(kind)}"} & {*nuisance}))
        for (of, kind), names in gains.items()
    ]


def criterion(trials: Trials, trial: Trial) -> float:
    """Bayesian information criterion with as much noise as the trial needs.

    Random forces and lasting sensor errors are explanations, too, and their parameters have a
    price: each noise that the criterion itself would do without is taken out. An effect that makes
    a noise superfluous gains its price.
    """
    price = math.log(trials.samples)
    named = noises(trials.nuisance)
    there = [n for n in named if any(trial.values[gain] != 0 for gain in n.gains)]
    still = {p for n in named if n not in there for p in n.parameters}
    for noise in sorted(there, key=lambda n: max(abs(trial.values[gain]) for gain in n.gains)):
        values = {**trial.values, **dict.fromkeys(noise.gains, 0.0)}
        fewer = still | {*noise.parameters}
        without = trials.solve(trial.effects, values, trial.begin, BUDGET, still=fewer)
        if 2 * (without.cost - trial.cost) < len(noise.parameters) * price:
            trial, still = without, fewer
    own = sum(name not in trials.nuisance for name in trial.names)
    return 2 * trial.cost + price * (own + len(trials.nuisance) - len(still))
