"""An added effect as a person would say it: "commands within ±25 us do nothing"."""

from __future__ import annotations

from dataclasses import dataclass

from diffthrust._support.words import percent
from diffthrust.diagnosis._report.text import (
    an_effect,
    by_log_words,
    measured,
    recorded,
)
from diffthrust.estimation._estimate import Estimate
from diffthrust.estimation._result import Fit


@dataclass(frozen=True)
class Amount:
    """An estimate in a sentence: a size in its unit, ``:%`` a share, ``:more`` a change of one."""

    estimate: Estimate

    def __format__(self, form: str) -> str:
        """The estimate as `Effect.in_words` asks for it."""
        value = self.estimate.value
        if form == "%":
            return percent(value) if value >= 0 else f"-{percent(-value)}"
        if form == "more":
            return f"{percent(abs(value))} {'more' if value > 0 else 'less'}"
        return measured(self.estimate)


def effect_words(name: str, fit: Fit) -> str:
    """An effect with its size: by its own words, what it comes to, or by its name.

    Args:
        name: of an effect of the fitted model.
        fit: with its estimates.

    Example:
        >>> effect_words("command_deadband", fit)
        'commands within ±0.40 V do nothing'
    """
    effect = next((effect for effect in fit.model.effects if effect.name == name), None)
    if effect is None:
        return an_effect(name)
    if by_log := by_log_words(effect, fit):
        return f"{an_effect(name)} of {by_log}"
    amounts = {n: Amount(fit.parameters[f"{name}.{n}"]) for n in effect.declared}
    if consequence := effect.consequence(fit.model, recorded(fit)):
        return consequence
    if effect.in_words:
        return effect.in_words.format(**amounts)
    free = [n for n in amounts if not fit.parameters[f"{name}.{n}"].fixed]
    return f"{an_effect(name)} of {amounts[free[0]]}" if len(free) == 1 else an_effect(name)
