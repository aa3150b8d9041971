"""A propeller on a hinge."""

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from diffthrust.models._base.actuator import Actuator
from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.power_law import power_law
from diffthrust.models._base.signals import RatesAndOutputs, Signals


@registered
class HingedPropeller(Actuator):
    """An outboard propeller that is turned by a rudder servo: the drive of `Vessel`.

        force = gain * sign(propeller_speed) |propeller_speed|^exponent
        thrust, side_thrust = force * (cos rudder_angle, sin rudder_angle)

    A positive angle pushes the stern to starboard, and so the bow to port. With ``gain`` held at 1
    masses and dampings of the body are ratios to it, as in the paper.
    Source: Siramdasu & Fahimi 2013, equations (1) to (5).

    Example:
        >>> stern = dft.actuators.HingedPropeller(exponent=0.27)
        >>> stern.inputs
        {'propeller_speed': 'rev/s', 'rudder_angle': 'rad'}
    """

    name = "hinged_propeller"
    options: ClassVar[tuple[str, ...]] = ("command",)
    inputs: ClassVar[Mapping[str, str]] = {"propeller_speed": "rev/s", "rudder_angle": "rad"}
    outputs: ClassVar[Mapping[str, str]] = {"thrust": "N", "side_thrust": "N"}
    ports: ClassVar[Mapping[str, str]] = {
        "revolutions": "speed at which the propeller turns [rev/s]",
        "rudder": "angle at which the propeller stands [rad]",
        "drive": "force of the propeller along its axis [N]",
    }
    commands: tuple[str, ...] = ("rev/s", "effort")
    commanded: tuple[str, ...] = ("propeller_speed",)

    gain: float = parameter(
        1.0, "N/{propeller_speed}", bounds=(0, None), fixed=True, doc="force at a speed of 1"
    )
    exponent: float = parameter(0.27, bounds=(0.05, 4.0), transform="log", doc="of the speed")

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        """Siramdasu & Fahimi 2013, equations (1) to (5)."""
        n = port("revolutions", s.propeller_speed)
        angle = port("rudder", s.rudder_angle)
        force = port("drive", self.gain * power_law(n, self.exponent))
        return {}, {"thrust": force * jnp.cos(angle), "side_thrust": force * jnp.sin(angle)}
