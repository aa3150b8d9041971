"""Effects between the speed of the propeller and its thrust."""

from collections.abc import Mapping

import jax.numpy as jnp

from diffthrust.effects._forms import ReverseSpeedAsymmetry, from_zero
from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.parameter import parameter, relative_to
from diffthrust.models._base.signals import Rate, Signal, Signals


@registered
class ReverseThrustAsymmetry(ReverseSpeedAsymmetry):
    """The propeller thrusts less (or more) when it turns backwards.

    Acts on the thrust [N]: multiplied by 1 + change where speed < 0.
    Null: change = 0. Source: Yoerger, Cooke & Slotine 1990, section III, which fits the thrust in
    the forward direction only and ignores the asymmetry.

    Example:
        >>> model = dft.Thruster() + dft.effects.ReverseThrustAsymmetry(change=-0.1)
        >>> model.parameters["reverse_thrust_asymmetry.change"].range_text()
        '[-1, inf)'
    """

    name = "reverse_thrust_asymmetry"
    in_words = "{change:more} thrust in reverse"
    port = "propeller"


@registered
class InflowThrustLoss(Effect):
    """Water that already flows through the propeller takes up less thrust.

    Acts on the thrust [N]: thrust - loss * |speed| * inflow. Null: loss = 0. Source: the bilinear
    thrust of Fossen 1994 and Fossen & Blanke 2000; Kim & Chung 2006.

    Example:
        >>> model = dft.Thruster() + dft.effects.InflowThrustLoss(loss=0.1)
        >>> model.parameters["inflow_thrust_loss.loss"].range_text()
        '[0, inf) N s^2/(m rad)'
    """

    name = "inflow_thrust_loss"
    in_words = "inflow takes thrust away"
    port = "propeller"
    needs = ("inflow",)
    loss: float = from_zero(
        0.1, "N s^2/(m rad)", size=0.3, probes=relative_to("propeller", 0.002, 0.02)
    )

    def __call__(self, value: Signal, s: Signals) -> Signal:
        return value - self.loss * jnp.abs(s.speed) * s.inflow


@registered
class AxialFlow(Effect):
    """Thrust overshoots at fast changes, while the water in the duct catches up.

    Acts on the thrust [N]: thrust - loss * |speed| * flow, where the speed ``flow`` [m/s] of the
    water in the duct is a state:

        mass * d(flow)/dt = thrust - linear_drag * flow - quadratic_drag * flow |flow|

    with the thrust that leaves. Null: loss = 0. No sensor reads the flow, so its scale is free:
    k times the flow goes with loss / k, mass / k, linear_drag / k and quadratic_drag / k^2. The
    drags are therefore held, by default; set them from the geometry to give the flow and the mass
    a meaning. Source: Healey et al. 1995; Fossen & Blanke 2000.

    Example:
        >>> model = dft.Thruster() + dft.effects.AxialFlow(loss=0.1)
        >>> model.parameters["axial_flow.loss"].range_text()
        '[0, inf) N s^2/(m rad)'
    """

    name = "axial_flow"
    in_words = "thrust overshoots while the water in the duct catches up"
    port = "propeller"
    states = {"flow": "m/s"}
    loss: float = from_zero(
        0.1, "N s^2/(m rad)", size=0.3, probes=relative_to("propeller", 0.002, 0.02, 0.2)
    )
    mass: float = parameter(
        20.0, "kg", bounds=(0, None), transform="log", probes=relative_to("propeller", 0.2, 1.0)
    )
    linear_drag: float = parameter(1.0, "N s/m", bounds=(0, None), fixed=True)
    quadratic_drag: float = parameter(10.0, "N s^2/m^2", bounds=(0, None), fixed=True)

    def __call__(self, value: Signal, s: Signals) -> Signal:
        return value - self.loss * jnp.abs(s.speed) * s.flow

    def rates(self, value: Signal, s: Signals) -> Mapping[str, Rate]:
        drag = (self.linear_drag + self.quadratic_drag * jnp.abs(s.flow)) * s.flow
        return {"flow": (self(value, s) - drag) / self.mass}

    def initial(self, value: Signal, s: Signals) -> Mapping[str, Signal | float]:
        # the positive root in the form without cancellation: at a small thrust -b + sqrt(b^2 + 4 c)
        # loses its digits
        linear = self.linear_drag + self.loss * jnp.abs(s.speed) + 1e-9
        root = jnp.sqrt(linear**2 + 4.0 * self.quadratic_drag * jnp.abs(value))
        return {"flow": 2.0 * value / (linear + root)}


@registered
class Cavitation(Effect):
    """The thrust falls short at high speeds.

    Acts on the thrust [N]: of what is gained above the speed ``onset`` [rad/s] the share
    ``shortfall`` is missing, thrust * (1 - shortfall * (1 - onset^2 / speed^2)). Null:
    shortfall = 0. Source: Carlton 2012, chapter 9.

    Example:
        >>> model = dft.Thruster() + dft.effects.Cavitation(shortfall=0.2)
        >>> model.parameters["cavitation.shortfall"].range_text()
        '[0, 1]'
    """

    name = "cavitation"
    in_words = "thrust falls short beyond {onset}"
    port = "propeller"
    shortfall: float = parameter(0.2, bounds=(0, 1), null=0.0, size=0.3, probes=(0.2, 0.6))
    onset: float = parameter(
        40.0, "{speed}", bounds=(0, None), transform="log", probes=relative_to("speed", 0.4, 0.7)
    )

    def __call__(self, value: Signal, s: Signals) -> Signal:
        onset = self.onset**2
        # the maximum keeps the quotient finite at rest, in the branch without cavitation
        full = onset / jnp.maximum(s.speed**2, onset + 1e-12)
        return value * (1.0 - self.shortfall * (1.0 - full))


@registered
class ThrustDegradation(Effect):
    """The thrust drops at some instant: an obstruction, fouling, ventilation.

    Acts on the thrust [N]: from ``instant`` [s] on, on the log's own clock, the share ``fraction``
    is lost. It is lost over ``transition`` [s] about the instant, so that a fit can feel its place.
    Null: fraction = 0. Source: Yoerger, Cooke & Slotine 1990, figure 18 (the duct is obstructed
    during a run).

    Example:
        >>> model = dft.Thruster() + dft.effects.ThrustDegradation(fraction=0.2)
        >>> model.parameters["thrust_degradation.fraction"].range_text()
        '[0, 1]'
    """

    name = "thrust_degradation"
    in_words = "{fraction:%} of the thrust is lost from {instant} on"
    port = "propeller"
    fraction: float = parameter(0.2, bounds=(0, 1), null=0.0, size=0.3, probes=(0.2, 0.6))
    instant: float = parameter(
        30.0, "s", size=10.0, probes=relative_to("duration", 0.2, 0.4, 0.6, 0.8)
    )
    transition: float = parameter(1.0, "s", bounds=(0, None), fixed=True)

    def __call__(self, value: Signal, s: Signals) -> Signal:
        # a step has no slope by its instant: the ramp lets a fit move it
        lost = jnp.clip(0.5 + (s.time - self.instant) / self.transition, 0.0, 1.0)
        return value * (1.0 - self.fraction * lost)
