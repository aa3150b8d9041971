"""Effects between the speed of the propeller and its thrust."""

from typing import Any

import jax.numpy as jnp

from diffthrust._effect import Effect
from diffthrust._parameters import parameter
from diffthrust._signals import Signals


class ReverseThrustAsymmetry(Effect):
    """The propeller thrusts less (or more) when it turns backwards.

    Acts on the thrust [N]: multiplied by 1 + change where speed < 0.
    Null: change = 0. Source: Yoerger, Cooke & Slotine 1990, section III, which fits the thrust in
    the forward direction only and ignores the asymmetry.
    """

    name = "reverse_thrust_asymmetry"
    port = "propeller"
    change: float = parameter(-0.1, bounds=(-1, None), null=0.0, size=0.3)

    def __call__(self, value: Any, s: Signals) -> Any:
        """The thrust with the reverse direction changed."""
        return value * (1.0 + jnp.where(s.speed < 0, self.change, 0.0))
