"""Effects on the command, sample by sample: what `effects._recorded` does to whole records.

Both give the same numbers, so that a loop's record, simulated again from its commands, moves as it
did in the loop.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import jax.numpy as jnp
from jaxtyping import Array

from diffthrust._support.errors import InputError
from diffthrust.control._plant import driven
from diffthrust.effects import CommandDelay, CommandRateLimit
from diffthrust.models._base.effect import Effect, Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Signals
from diffthrust.models._craft.placed import Placed


def _delayed(line: Array, value: Array, first: Array, samples: Array) -> tuple[Array, Array]:
    """A sample so many samples later, linear between them, and the line of samples to remember.

    The line has the newest in front, ``(n,)`` with n above ``samples``, and begins full of the
    first.
    """
    line = jnp.where(first, value, jnp.concatenate([value[None], line[:-1]]))
    # weights in the place of an index: no gather in the loop's body, and a derivative by the delay
    weights = jnp.maximum(1.0 - jnp.abs(samples - jnp.arange(line.shape[0], dtype=float)), 0.0)
    return jnp.sum(weights * line), line


class CommandPath:
    """The effects on the command of a thruster, as they act within a loop.

    The samples are ``step`` [s] apart. An `InputError` refuses an effect that reads other samples
    than the present one, of which no form is known that runs sample by sample.
    """

    def __init__(self, thruster: Model, step: float) -> None:
        self.channel: str = driven(thruster)
        self.lengths: dict[str, int] = {}
        """Samples that each effect remembers; they fix the compiled code."""
        for placed in thruster.effects:
            effect = _itself(placed)
            at = [port for port in placed.ports if port in thruster.inputs]
            if not at or not effect.memory:
                continue
            if isinstance(effect, CommandDelay):
                samples = math.ceil(float(effect.delay) / step + 1e-6) + 1
                # powers of two: another delay seldom needs another compilation
                self.lengths[placed.name] = 2 ** max(1, math.ceil(math.log2(samples)))
            elif isinstance(effect, CommandRateLimit):
                self.lengths[placed.name] = 0
            else:
                raise InputError(
                    f"The effect '{effect.name}' acts on whole records of '{at[0]}' and reads "
                    "other samples than the present one: it cannot run within a loop, where the "
                    "later samples are not known yet.",
                    "Leave it out, or give it states at a port inside the model.",
                )

    def start(self) -> dict[str, Array]:
        """What is remembered before the first sample."""
        return {name: jnp.zeros((n,) if n else ()) for name, n in self.lengths.items()}

    def __call__(
        self,
        effects: tuple[Effect, ...],
        signals: Mapping[str, Array],
        kept: Mapping[str, Array],
        first: Array,
        step: Array,
    ) -> tuple[Array, dict[str, Array]]:
        """The command that reaches the model, and what is to be remembered.

        Of the inputs at this sample, the command and ``time`` among them; ``first`` says whether
        it is the first one.
        """
        value, after = signals[self.channel], {}
        for placed in effects:
            effect, name = _itself(placed), placed.name
            if isinstance(effect, CommandDelay):
                value, after[name] = _delayed(kept[name], value, first, effect.delay / step)
            elif isinstance(effect, CommandRateLimit):
                last, reach = kept[name], effect.rate * step
                value = jnp.where(first, value, jnp.clip(value, last - reach, last + reach))
                after[name] = value
            else:
                arriving = Signals({**signals, self.channel: value})
                value = Ports((placed,), arriving)(self.channel, value)
        return value, after


def _itself(effect: Effect) -> Effect:
    """The effect that acts on the thruster of a craft."""
    return effect.inner if isinstance(effect, Placed) else effect
