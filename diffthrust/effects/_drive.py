"""Effects in the propulsion and steering of a vessel."""

from collections.abc import Collection

import jax.numpy as jnp

from diffthrust.effects._curves import power
from diffthrust.effects._forms import Offset, RateLimit, ReverseAsymmetry, ceiling, from_zero
from diffthrust.effects._shaft import ActuatorLag
from diffthrust.models._base.component import Component, registered
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.parameter import parameter, relative_to
from diffthrust.models._base.signals import Signal, Signals


@registered
class PropellerLag(ActuatorLag):
    """The propeller reaches the commanded speed as a first-order lag.

    Acts on the propeller speed [rev/s]: time_constant * d(response)/dt = speed - response, settled
    when the log begins. Null: time_constant = 0. Source: Fossen 2011, section 12.3 (actuators under
    low-level control, as first-order lags).

    Example:
        >>> model = dft.Vessel() + dft.effects.PropellerLag(time_constant=0.3)
        >>> model.parameters["propeller_lag.time_constant"].range_text()
        '[0, inf) s'
    """

    name = "propeller_lag"
    in_words = "the propeller lags by {time_constant}"
    port = "revolutions"
    states = {"response": "rev/s"}
    time_constant: float = from_zero(0.3, "s", size=0.5, probes=(0.1, 0.5, 1.5))


@registered
class RudderLag(ActuatorLag):
    """The rudder, or the hinge of the propeller, follows its command as a first-order lag.

    Acts on the rudder angle [rad]: time_constant * d(response)/dt = angle - response, settled when
    the log begins. Null: time_constant = 0. Source: Van Amerongen 1982, Adaptive steering of ships
    (model of the steering machine).

    Example:
        >>> model = dft.Vessel() + dft.effects.RudderLag(time_constant=0.3)
        >>> model.parameters["rudder_lag.time_constant"].range_text()
        '[0, inf) s'
    """

    name = "rudder_lag"
    in_words = "the rudder lags by {time_constant}"
    port = "rudder"
    states = {"response": "rad"}
    time_constant: float = from_zero(0.3, "s", size=0.5, probes=(0.1, 0.5, 1.5))


@registered
class RudderRateLimit(RateLimit):
    """The servo of the rudder turns no faster than a largest rate.

    Acts on the recorded rudder angle [rad], from sample to sample: it moves towards the commanded
    angle by at most ``rate`` [rad/s] times the time between them. Null: rate = infinite.
    Source: Van Amerongen 1982, Adaptive steering of ships (model of the steering machine).

    Example:
        >>> model = dft.Vessel() + dft.effects.RudderRateLimit(rate=0.5)
        >>> model.parameters["rudder_rate_limit.rate"].range_text()
        '[0, inf) rad/s'
    """

    name = "rudder_rate_limit"
    in_words = "the rudder turns at most {rate}"
    port = "rudder_angle"
    rate: float = ceiling(
        0.5, "{rudder_angle}/s", probes=relative_to("rudder_angle", 0.1, 0.5, 2.0)
    )


@registered
class RudderOffset(Offset):
    """The rudder stands off centre when its command is zero.

    Acts on the rudder angle [rad]: angle + offset, positive where the offset alone pushes the
    stern to starboard. Null: offset = 0. Source: a servo horn mounted a tooth off, common in
    models; where the propeller walks, it looks much like the neutral rudder angle of ship trials.

    Example:
        >>> model = dft.Vessel() + dft.effects.RudderOffset(offset=0.05)
        >>> model.parameters["rudder_offset.offset"].range_text()
        '[-0.8, 0.8] rad'
    """

    name = "rudder_offset"
    in_words = "the rudder stands {offset} off centre"
    port = "rudder"
    offset: float = parameter(
        0.05, "{rudder_angle}", bounds=(-0.8, 0.8), null=0.0, size=0.1, probes=(-0.1, 0.1)
    )


@registered
class RudderInflow(Effect):
    """The rudder pushes harder the faster the water comes at it.

    Acts on the side force at the stern: force * (1 + gain * u), with u [m/s] the surge speed
    through the water, which adds to the race of the propeller; ``gain`` [s/m] is the relative
    growth of the force. Null: gain = 0. Source: Yasukawa & Yoshimura 2015, rudder normal force
    proportional to the square of the inflow speed, here to first order in u.

    Example:
        >>> model = dft.Vessel() + dft.effects.RudderInflow(gain=0.3)
        >>> model.parameters["rudder_inflow.gain"].range_text()
        '(-inf, inf) s/m'
    """

    name = "rudder_inflow"
    in_words = "the rudder pushes harder the faster the water comes"
    port = "steering"
    gain: float = parameter(
        0.3, "s/m", null=0.0, size=1.0, probes=relative_to("surge", -0.3, 0.3, 1.0, power=-1)
    )

    def __call__(self, value: Signal, s: Signals) -> Signal:
        return value * (1.0 + self.gain * s.surge_through_water)


@registered
class PropellerInflow(Effect):
    """The propeller loses thrust as the vessel gains speed.

    Acts on the thrust: thrust - loss * |thrust| * u, with u [m/s] the surge speed through the
    water; ``loss`` [s/m] is the relative fall for each metre per second. A propeller that turns
    backwards pulls harder while the vessel still runs ahead.
    Null: loss = 0. Source: Fossen 1994, bilinear thruster model T = T_|n|n |n| n - T_|n|u |n| u,
    here in proportion to the thrust, whose law in n the vessel leaves open.

    Example:
        >>> model = dft.Vessel() + dft.effects.PropellerInflow(loss=0.1)
        >>> model.parameters["propeller_inflow.loss"].range_text()
        '[0, inf) s/m'
    """

    name = "propeller_inflow"
    in_words = "the propeller loses thrust as the vessel gains speed"
    port = "propulsion"
    loss: float = from_zero(0.1, "s/m", size=0.5, probes=relative_to("surge", 0.1, 0.5, power=-1))

    def __call__(self, value: Signal, s: Signals) -> Signal:
        return value - self.loss * jnp.abs(value) * s.surge_through_water


@registered
class PropellerWalk(Effect):
    """The turning propeller also pushes the stern aside, to the other side in reverse.

    Acts on the side force at the stern: force + fraction * thrust; a positive one pushes the
    stern to starboard when the propeller drives ahead, as one that turns clockwise (seen from
    astern) does. Null: fraction = 0. Source: Brix 1993, Manoeuvring technical manual.

    Example:
        >>> model = dft.Vessel() + dft.effects.PropellerWalk(fraction=0.05)
        >>> model.parameters["propeller_walk.fraction"].range_text()
        '[-1, 1]'
    """

    name = "propeller_walk"
    in_words = "the propeller pushes the stern aside by {fraction:%} of its thrust"
    port = "steering"
    fraction: float = parameter(0.05, bounds=(-1, 1), null=0.0, size=0.1, probes=(-0.1, 0.1))

    def __call__(self, value: Signal, s: Signals) -> Signal:
        return value + self.fraction * s.propulsion


@registered
class ReversePropellerAsymmetry(ReverseAsymmetry):
    """The propeller pushes less (or more) when it drives astern.

    Acts on the thrust: multiplied by 1 + change where it is negative. Null: change = 0.
    Source: van Lammeren, van Manen & Oosterveld 1969, the B-screw series in all four quadrants.

    Example:
        >>> model = dft.Vessel() + dft.effects.ReversePropellerAsymmetry(change=-0.2)
        >>> model.parameters["reverse_propeller_asymmetry.change"].range_text()
        '[-1, inf)'
    """

    name = "reverse_propeller_asymmetry"
    in_words = "{change:more} thrust astern"
    port = "propulsion"
    change: float = parameter(-0.2, bounds=(-1, None), null=0.0, size=0.3, probes=(-0.3, 0.3))


@registered
class DifferentialGain(Effect):
    """The left and the right thruster do not give the same force.

    Acts on what commands the thrusters, their forces [N] or their efforts: left * (1 + gain),
    right * (1 - gain). Of efforts the force is a power, so that the two forces differ by
    ((1 - gain) / (1 + gain)) ** exponent: `consequence` works it out. Null: gain = 0.
    Source: thrusters of one type differ by some per cent (blade damage, mounting, the map from
    command to force); their mean belongs to the other parameters.

    Example:
        >>> model = dft.Vessel(drive="twin") + dft.effects.DifferentialGain(gain=0.05)
        >>> model.parameters["differential_gain.gain"].range_text()
        '[-1, 1]'
    """

    name = "differential_gain"
    ports = ("left_force", "right_force")
    gain: float = parameter(0.05, bounds=(-1, 1), null=0.0, size=0.2, probes=(-0.2, 0.2))

    def at(self, port: str, value: Signal, s: Signals) -> Signal:
        return value * (1.0 + self.gain if port == "left_force" else 1.0 - self.gain)

    def consequence(self, model: Component, recorded: Collection[str] = ()) -> str:
        effort = getattr(model, "command", "") == "effort"
        share = (1.0 - abs(self.gain)) / (1.0 + abs(self.gain))
        weak, strong = ("right", "left") if self.gain > 0 else ("left", "right")
        share **= float(getattr(model, "exponent", 1.0)) if effort else 1.0
        return f"the {weak} thruster gives {100.0 * share:.0f} % of the {strong} one's force"


_EXCHANGED = -0.8
"""Display: share of the logged moment up to which two thrusters are called exchanged."""


@registered
class SwappedThrusters(Effect):
    """The channels of the left and the right thruster are exchanged.

    Acts on the recorded forces [N]: left + share * (right - left) and the reverse, so that at
    share = 1 each has the other's. Between the two, the vessel steers with 1 - 2 * share of the
    moment: not at all half way, so a fit finds the exchange from share = 1, not from 0.
    Null: share = 0. Source: an error of wiring, not of physics; a yaw rate that is counted against
    the clock looks the same.

    Example:
        >>> model = dft.Vessel(drive="twin") + dft.effects.SwappedThrusters(share=1)
        >>> model.parameters["swapped_thrusters.share"].range_text()
        '[0, 1]'
    """

    name = "swapped_thrusters"
    in_words = "left and right thruster are exchanged"
    ports = ("left_force", "right_force")
    share: float = parameter(1.0, bounds=(0, 1), null=0.0, size=0.5, probes=(1.0,))

    def consequence(self, model: Component, recorded: Collection[str] = ()) -> str:
        """With how much of the logged moment the vessel steers, where that is not nearly -100 %.

        On the BlueBoat a share of 0.53 was told as an exchange: its thrusters hardly steer.
        """
        steering = 1.0 - 2.0 * self.share
        if steering < _EXCHANGED:
            return ""
        return f"the two thrusters steer with {100.0 * steering:.0f} % of the logged moment"

    def at(self, port: str, value: Signal, s: Signals) -> Signal:
        opposite = s.right_force if port == "left_force" else s.left_force
        return value + self.share * (opposite - value)


@registered
class ForceExponent(Effect):
    """The forces of two thrusters are a power of what their static map says.

    Acts on the recorded forces [N], left and right alike: multiplied by
    (|force| / reference)^(exponent - 1). ``reference`` is the force at which the map holds; it is
    held, as another one rescales the vessel's masses and dampings. A vessel whose thrusters are
    given as efforts has such an exponent of its own. Null: exponent = 1. Source: a map from the
    command to the force that was measured at another voltage, or taken for linear; Siramdasu &
    Fahimi 2013, equation 6, for the power law.

    Example:
        >>> model = dft.Vessel(drive="twin") + dft.effects.ForceExponent(exponent=1.2)
        >>> model.parameters["force_exponent.exponent"].range_text()
        '[0.3, 3]'
    """

    name = "force_exponent"
    in_words = "forces go with the power {exponent} of the map's"
    ports = ("left_force", "right_force")
    exponent: float = parameter(1.2, bounds=(0.3, 3), null=1.0, size=0.3, probes=(0.7, 1.5))
    reference: float = parameter(
        10.0, "{left_force}", bounds=(0, None), fixed=True, probes=relative_to("left_force", 0.6)
    )

    def at(self, port: str, value: Signal, s: Signals) -> Signal:
        return value * power(value, self.reference, self.exponent - 1.0)
