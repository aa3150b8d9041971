"""The power law of a command."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp

from diffthrust.models._base.signals import Signal


def power_law(command: Signal, exponent: Any) -> Signal:
    """sign(command) |command|^exponent, with a derivative also at rest."""
    turning = command != 0
    # 1 in the place of a command of 0: 0 ** p by p is 0 * log 0, a NaN that `where` does not keep
    # out of the derivative
    strength = jnp.where(turning, jnp.abs(command), 1.0) ** exponent
    return jnp.where(turning, jnp.sign(command) * strength, 0.0)
