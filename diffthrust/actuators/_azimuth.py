"""A thruster that turns."""

from collections.abc import Mapping
from typing import Any, ClassVar

import jax.numpy as jnp

from diffthrust.models._base.actuator import Steered
from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.signals import RatesAndOutputs, Relaxing, Signals


@registered
class Azimuth(Steered):
    """A thruster on a vertical axis, which turns to an angle.

        d(azimuth)/dt = difference of angle and azimuth, the short way, / slew_time
        thrust, side_thrust = force * (cos azimuth, sin azimuth)

    The angle [rad] is clockwise from above, from where the thruster points on the craft: at a
    quarter turn it pushes to starboard. Where the log has the measured ``azimuth`` as an input, the
    force follows it and ``angle`` is not needed.
    Source: Fossen 2021, section 9.3 (azimuth thrusters), with a lag of first order.

    Args:
        thruster: the model of the thruster.
        command: the unit of its command; as the thruster has it else.
        **parameters: values by name, ``slew_time`` [s] among them.

    Example:
        >>> bow = dft.actuators.Azimuth(dft.Thruster(), slew_time=1.0)
        >>> bow.inputs, list(bow.parameters)
        ({'command': 'V', 'angle': 'rad'}, ['alpha', 'beta', 'ct', 'slew_time'])
    """

    name = "azimuth"
    options: ClassVar[tuple[str, ...]] = ("command",)
    inputs: ClassVar[Mapping[str, str]] = {"angle": "rad"}
    optional_inputs: ClassVar[Mapping[str, str]] = {"azimuth": "rad"}
    states: ClassVar[Mapping[str, str]] = {"azimuth": "rad"}
    outputs: ClassVar[Mapping[str, str]] = {"azimuth": "rad", "side_thrust": "N"}
    ports: ClassVar[Mapping[str, str]] = {
        "pointing": "angle at which the thruster aims [rad]",
        "turning": "rate at which the thruster turns [rad/s]",
        "azimuth_force": "force of the thruster along its axis [N]",
    }
    angles: ClassVar[tuple[str, ...]] = ("azimuth",)
    time_scales: ClassVar[tuple[float, float]] = (0.05, 60.0)

    slew_time: float = parameter(1.0, "s", bounds=(0, None), doc="of the turn to the angle")

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        """Fossen 2021, section 9.3."""
        rates, outputs = self._bound_thruster().equations(s, port)
        force = port("azimuth_force", outputs["thrust"])
        cos, sin = jnp.cos(s.azimuth), jnp.sin(s.azimuth)
        directed = {"thrust": force * cos, "side_thrust": force * sin, "azimuth": s.azimuth}
        turning: dict[str, Any] = {}
        if "angle" in s:
            behind = port("pointing", s.angle) - s.azimuth
            short_way = jnp.arctan2(jnp.sin(behind), jnp.cos(behind))
            rate = port("turning", short_way / self.slew_time)
            turning = {"azimuth": Relaxing(rate, 1.0 / self.slew_time)}
        return {**rates, **turning}, {**outputs, **directed}

    def initial(self, s: Signals) -> Mapping[str, Any]:
        """Turned to the first angle."""
        begin = dict(self._bound_thruster().initial(s))
        return {**begin, "azimuth": s.angle} if "angle" in s else begin
