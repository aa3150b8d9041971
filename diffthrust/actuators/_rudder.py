"""A propeller with a rudder behind it."""

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from diffthrust.models._base.actuator import Steered
from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.signals import RatesAndOutputs, Signals


@registered
class RudderPropeller(Steered):
    """A thruster that points ahead, and a rudder in its race.

    With T the thrust of the propeller and u [m/s] the speed of the craft through the water there,
    the rudder at the angle a takes the force

        normal = (race * max(T, 0) + free_stream * u |u|) * sin a
        thrust = T - normal * sin a,     side_thrust = normal * cos a

    across its blade. A positive angle pushes the stern to starboard. Astern, the race does not
    reach the rudder. Source: Fossen 2021, section 9.5 (rudder in the propeller's slipstream).

    Args:
        thruster: the model of the propeller.
        command: the unit of its command; as the thruster has it else.
        **parameters: values by name.

    Example:
        >>> stern = dft.actuators.RudderPropeller(dft.SpeedLoopThruster())
        >>> stern.inputs
        {'command': 'effort', 'rudder_angle': 'rad'}
    """

    name = "rudder_propeller"
    options: ClassVar[tuple[str, ...]] = ("command",)
    inputs: ClassVar[Mapping[str, str]] = {"rudder_angle": "rad"}
    optional_inputs: ClassVar[Mapping[str, str]] = {"inflow": "m/s"}
    feels: ClassVar[tuple[str, ...]] = ("inflow",)
    outputs: ClassVar[Mapping[str, str]] = {"side_thrust": "N"}
    ports: ClassVar[Mapping[str, str]] = {
        "rudder": "angle at which the rudder stands [rad]",
        "rudder_force": "force across the blade of the rudder [N]",
    }

    race: float = parameter(0.8, bounds=(0, None), doc="rudder force per thrust")
    free_stream: float = parameter(
        2.0, "N s^2/m^2", bounds=(0, None), null=0.0, size=5.0, doc="rudder force by the way"
    )

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        """Fossen 2021, section 9.5."""
        rates, outputs = self._bound_thruster().equations(s, port)
        thrust = outputs["thrust"]
        angle = port("rudder", s.rudder_angle)
        u = s.inflow if "inflow" in s else 0.0 * thrust
        lift = self.race * jnp.maximum(thrust, 0.0) + self.free_stream * u * jnp.abs(u)
        normal = port("rudder_force", lift * jnp.sin(angle))
        directed = {
            "thrust": thrust - normal * jnp.sin(angle),
            "side_thrust": normal * jnp.cos(angle),
        }
        return rates, {**outputs, **directed}
