"""Effects between the motor's torque and the shaft."""

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp

from diffthrust._effect import Effect
from diffthrust._parameters import parameter
from diffthrust._signals import Relaxing, Signals


class ActuatorLag(Effect):
    """The motor's torque follows the command as a first-order lag.

    Acts on the drive: time_constant * d(response)/dt = drive - response. Of an electric motor the
    time constant is inductance / resistance. Null: time_constant = 0. The response is integrated
    exactly (`Relaxing`), so any time constant may be tried, however short against the step.
    Source: Aras et al. 2013, electrical equation of the motor.
    """

    name = "actuator_lag"
    port = "drive"
    states = {"response": ""}
    time_constant: float = parameter(0.05, "s", bounds=(0, None), null=0.0, size=0.1)

    def __call__(self, value: Any, s: Signals) -> Any:
        """The lagged drive; at the null exactly the drive, with the response's derivative."""
        null = jax.lax.stop_gradient(value) + (s.response - jax.lax.stop_gradient(s.response))
        return jnp.where(self.time_constant > 0, s.response, null)

    def rates(self, value: Any, s: Signals) -> Mapping[str, Any]:
        """First-order lag; a nanosecond keeps value and derivative finite at the null."""
        decay = 1.0 / (self.time_constant + 1e-9)
        return {"response": Relaxing(decay * (value - s.response), decay)}

    def initial(self, value: Any, s: Signals) -> Mapping[str, Any]:
        """Settled at the drive with which the log begins."""
        return {"response": value}
