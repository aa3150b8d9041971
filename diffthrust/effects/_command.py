"""Effects between the recorded command and the motor."""

from typing import Any

import jax.numpy as jnp

from diffthrust._effect import Effect
from diffthrust._parameters import parameter
from diffthrust._signals import Signals


class CommandDeadband(Effect):
    """The motor controller ignores small commands.

    Acts on the recorded command [V]: zero while |command| < width, and beyond it
    command - (1 - restored) * width * sign(command). Controllers differ in whether they subtract
    the band (``restored = 0``, the default) or jump to the full command (``restored = 1``); what
    is restored comes back over the next tenth of the band, so that a fit can feel the edge. The
    band is applied to the recorded samples, before any interpolation between them.
    Null: width = 0. Source: the dead-zone of Slotine & Li 1991, section 5.2; common in motor
    controllers.
    """

    name = "command_deadband"
    port = "command"
    width: float = parameter(0.05, "V", bounds=(0, None), null=0.0, size=0.2)
    restored: float = parameter(0.0, bounds=(0, 1), fixed=True)

    def __call__(self, value: Any, s: Signals) -> Any:
        """The command that the motor sees."""
        beyond = jnp.abs(value) - self.width
        edge = jnp.clip(beyond / (0.1 * self.width + 1e-12), 0.0, 1.0)
        left = jnp.maximum(beyond, 0.0) + self.restored * self.width * edge
        return jnp.sign(value) * left
