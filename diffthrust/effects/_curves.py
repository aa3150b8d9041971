"""Static curves that are not the square, or the straight line, of the basic model.

Offsets of such curves are effects of other places: that of a thrust is `thrust_sensor_offset`, that
of a load against the motion `coulomb_friction`, and a constant torque `command_offset`.
"""

import jax.numpy as jnp

from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.parameter import parameter, relative_to
from diffthrust.models._base.signals import Signal, Signals

_REST = 0.02
"""Below this share of its reference a power is constant: its slope is infinite at rest."""


def power(size: Signal, reference: Signal | float, exponent: Signal | float) -> Signal:
    """The power of a size over its reference; finite, with its derivatives, also at rest."""
    return (jnp.maximum(jnp.abs(size) / reference, _REST)) ** exponent


class _SpeedExponent(Effect, abstract=True):
    """What grows with the square of the speed, with another power of it."""

    exponent: float = parameter(1.8, bounds=(0.5, 4), null=2.0, size=0.3, probes=(1.7, 2.3))
    reference: float = parameter(
        40.0, "{speed}", bounds=(0, None), fixed=True, probes=relative_to("speed", 0.6)
    )

    def __call__(self, value: Signal, s: Signals) -> Signal:
        return value * power(s.speed, self.reference, self.exponent - 2.0)


@registered
class ThrustExponent(_SpeedExponent):
    """The thrust grows with another power of the speed than the second.

    Acts on the thrust [N]: multiplied by (|speed| / reference)^(exponent - 2), so that a quadratic
    thrust becomes one of the power ``exponent``. ``reference`` [rad/s] is the speed at which the
    thrust is that of the model; it is held, as another one rescales the model's coefficient.
    Null: exponent = 2. Source: the thrust coefficient varies with the Reynolds number of the
    blades (Oosterveld & van Oossanen 1975), and maps of small thrusters are fitted by powers
    (Siramdasu & Fahimi 2013, equation 6).

    Example:
        >>> model = dft.Thruster() + dft.effects.ThrustExponent(exponent=1.8)
        >>> model.parameters["thrust_exponent.exponent"].range_text()
        '[0.5, 4]'
    """

    name = "thrust_exponent"
    in_words = "thrust goes with speed to the power {exponent}"
    port = "propeller"


@registered
class LoadExponent(_SpeedExponent):
    """The propeller brakes the shaft with another power of the speed than the second.

    Acts on the load [rad/s^2]: multiplied by (|speed| / reference)^(exponent - 2), so that a
    quadratic load becomes one of the power ``exponent``; ``reference`` [rad/s] as of
    `ThrustExponent`. Null: exponent = 2. Source: the torque coefficient varies with the Reynolds
    number of the blades (Oosterveld & van Oossanen 1975), and losses of a motor grow with less
    than the square of its speed (Fitzgerald, Kingsley & Umans 2003).

    Example:
        >>> model = dft.Thruster() + dft.effects.LoadExponent(exponent=1.8)
        >>> model.parameters["load_exponent.exponent"].range_text()
        '[0.5, 4]'
    """

    name = "load_exponent"
    in_words = "the load goes with speed to the power {exponent}"
    port = "load"
