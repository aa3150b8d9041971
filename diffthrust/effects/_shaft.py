"""Effects between the motor's torque and the shaft."""

from collections.abc import Mapping

import jax
import jax.numpy as jnp

from diffthrust._support.words import percent
from diffthrust.effects._forms import ReverseAsymmetry, ReverseSpeedAsymmetry, ceiling, from_zero
from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.parameter import parameter, relative_to
from diffthrust.models._base.signals import Rate, Relaxing, Signal, Signals


@registered
class ActuatorLag(Effect):
    """The motor's torque follows the command as a first-order lag.

    Acts on the drive: time_constant * d(response)/dt = drive - response. Of an electric motor the
    time constant is inductance / resistance. Null: time_constant = 0. The response is integrated
    exactly (`Relaxing`), so any time constant may be tried, however short against the step.
    Source: Aras et al. 2013, electrical equation of the motor.

    Example:
        >>> model = dft.Thruster() + dft.effects.ActuatorLag(time_constant=0.05)
        >>> model.parameters["actuator_lag.time_constant"].range_text()
        '[0, inf) s'
    """

    name = "actuator_lag"
    in_words = "the motor's torque lags by {time_constant}"
    port = "drive"
    states = {"response": ""}
    time_constant: float = from_zero(0.05, "s", size=0.1, probes=(0.03, 0.1, 0.3))

    def __call__(self, value: Signal, s: Signals) -> Signal:
        # at zero the response itself is a step behind: the value is the drive, the derivative that
        # of the response, which is what a fit that starts from the null needs
        null = jax.lax.stop_gradient(value) + (s.response - jax.lax.stop_gradient(s.response))
        return jnp.where(self.time_constant > 0, s.response, null)

    def rates(self, value: Signal, s: Signals) -> Mapping[str, Rate]:
        """First-order lag; a nanosecond keeps value and derivative finite at the null."""
        decay = 1.0 / (self.time_constant + 1e-9)
        return {"response": Relaxing(decay * (value - s.response), decay)}

    def initial(self, value: Signal, s: Signals) -> Mapping[str, Signal | float]:
        return {"response": value}


@registered
class ReverseDriveAsymmetry(ReverseAsymmetry):
    """The motor pulls less (or more) when it is commanded backwards.

    Acts on the drive [rad/s^2]: multiplied by 1 + change where it is negative. Null: change = 0.
    Source: Fitzgerald, Kingsley & Umans 2003, chapter 7: commutation that is timed for one
    direction of rotation is wrong for the other.

    Example:
        >>> model = dft.Thruster() + dft.effects.ReverseDriveAsymmetry(change=-0.1)
        >>> model.parameters["reverse_drive_asymmetry.change"].range_text()
        '[-1, inf)'
    """

    name = "reverse_drive_asymmetry"
    in_words = "{change:more} torque in reverse"
    port = "drive"


@registered
class SupplyVoltageSag(Effect):
    """The drive falls with the supply voltage.

    Acts on the drive [rad/s^2]: multiplied by 1 + share * (supply_voltage / nominal - 1). A motor
    on a plain switching controller has share = 1, one whose controller makes up for the supply
    share = 0. Null: share = 0. ``nominal`` [V] is where the drive has its full value; another one
    rescales share and the model's drive coefficient. Source: Aras et al. 2013, electrical equation
    of the motor, whose voltage is the supply's times the duty ratio.

    Example:
        >>> model = dft.Thruster() + dft.effects.SupplyVoltageSag(share=0.5)
        >>> model.parameters["supply_voltage_sag.share"].range_text()
        '[0, 1]'
    """

    name = "supply_voltage_sag"
    in_words = "the drive weakens as the supply voltage falls"
    port = "drive"
    needs = ("supply_voltage",)
    share: float = parameter(0.5, bounds=(0, 1), null=0.0, size=0.5, probes=(0.3, 0.9))
    nominal: float = parameter(24.0, "V", bounds=(0, None), fixed=True)

    def __call__(self, value: Signal, s: Signals) -> Signal:
        return value * (1.0 + self.share * (s.supply_voltage / self.nominal - 1.0))

    def over_logs(self, ranges: Mapping[str, tuple[float, float]]) -> str:
        ends = ranges["supply_voltage"]
        low, high = (1.0 + self.share * (volts / self.nominal - 1.0) for volts in ends)
        least, most = (f"{volts:.3g} V" for volts in ends)
        return f"the drive at {least} is {percent(low / high)} of that at {most}"


@registered
class ReverseLoadAsymmetry(ReverseSpeedAsymmetry):
    """The propeller brakes the shaft less (or more) when it turns backwards.

    Acts on the load [rad/s^2]: multiplied by 1 + change where speed < 0. Null: change = 0.
    Source: van Lammeren, van Manen & Oosterveld 1969, whose torque coefficients over all four
    quadrants differ between ahead and astern.

    Example:
        >>> model = dft.Thruster() + dft.effects.ReverseLoadAsymmetry(change=-0.1)
        >>> model.parameters["reverse_load_asymmetry.change"].range_text()
        '[-1, inf)'
    """

    name = "reverse_load_asymmetry"
    in_words = "{change:more} load in reverse"
    port = "load"


@registered
class InflowLoadRelief(Effect):
    """Water that already flows through the propeller loads it less.

    Acts on the load [rad/s^2]: load - relief * |speed| * inflow. Null: relief = 0. Source: the
    bilinear torque of Fossen & Blanke 2000; Fossen 1994.

    Example:
        >>> model = dft.Thruster() + dft.effects.InflowLoadRelief(relief=0.2)
        >>> model.parameters["inflow_load_relief.relief"].range_text()
        '[0, inf) 1/m'
    """

    name = "inflow_load_relief"
    in_words = "inflow relieves the propeller's load"
    port = "load"
    needs = ("inflow",)
    relief: float = from_zero(
        0.2, "1/m", size=0.3, probes=relative_to("inflow", 0.1, 0.4, power=-1)
    )

    def __call__(self, value: Signal, s: Signals) -> Signal:
        return value - self.relief * jnp.abs(s.speed) * s.inflow


@registered
class SlewLimit(Effect):
    """The motor controller lets the speed change no faster than at a largest rate.

    Acts on the acceleration that a speed loop asks for [rad/s^2]: held within -rate and rate.
    Null: rate infinite. Source: the slew rate limit of Goodwin, Graebe & Salgado 2001, chapter 11.

    Example:
        >>> model = dft.SpeedLoopThruster() + dft.effects.SlewLimit(rate=1000)
        >>> model.parameters["slew_limit.rate"].range_text()
        '[0, inf) rad/s^2'
    """

    name = "slew_limit"
    in_words = "the controller ramps the speed, at most {rate}"
    port = "loop"
    rate: float = ceiling(1000.0, "rad/s^2", probes=relative_to("loop", 0.3, 1.0))

    def __call__(self, value: Signal, s: Signals) -> Signal:
        return jnp.clip(value, -self.rate, self.rate)


@registered
class LinearDamping(Effect):
    """Back-EMF of the motor, or viscous friction of seals and bearings: the same term.

    Acts on the shaft's acceleration [rad/s^2]: less rate * speed. Null: rate = 0. Source: Aras et
    al. 2013, equations of the motor, where rate = km ke / (R J) + b / J.

    Example:
        >>> model = dft.Thruster() + dft.effects.LinearDamping(rate=0.3)
        >>> model.parameters["linear_damping.rate"].range_text()
        '[0, inf) 1/s'
    """

    name = "linear_damping"
    in_words = "a brake in proportion to speed (friction or back-EMF), {rate}"
    port = "shaft"
    rate: float = from_zero(0.3, "1/s", size=0.5, probes=(0.1, 0.5, 2.0))

    def __call__(self, value: Signal, s: Signals) -> Signal:
        return value - self.rate * s.speed


@registered
class CoulombFriction(Effect):
    """Dry friction of seals and bearings: a torque of constant size against the motion.

    Acts on the shaft's acceleration [rad/s^2]: less level * sign(speed), where the sign is a
    straight line within level * settling of rest. A push below the level then turns the shaft no
    faster than that, and a shaft that comes to rest does so within ``settling`` [s], whatever the
    level: the equation is no stiffer for strong friction than for weak. Null: level = 0.
    Source: Armstrong-Hélouvry, Dupont & Canudas de Wit 1994, section 2.

    Example:
        >>> model = dft.Thruster() + dft.effects.CoulombFriction(level=2)
        >>> model.parameters["coulomb_friction.level"].range_text()
        '[0, inf) rad/s^2'
    """

    name = "coulomb_friction"
    in_words = "dry friction brakes the shaft by {level}"
    port = "shaft"
    level: float = from_zero(2.0, "rad/s^2", size=5.0, probes=relative_to("drive", 0.02, 0.1))
    settling: float = parameter(0.03, "s", bounds=(0, None), fixed=True)

    def __call__(self, value: Signal, s: Signals) -> Signal:
        # the line near rest is as steep as the settling time allows, not 1 / width: no friction
        # level makes the equation stiffer than the step
        slow = s.speed / self.settling
        return value - jnp.where(jnp.abs(slow) < self.level, slow, self.level * jnp.sign(slow))


@registered
class StaticFriction(Effect):
    """Stiction: a shaft at rest bears pushes up to a level.

    Acts on the shaft's acceleration [rad/s^2]. While the push, which is the value that arrives, is
    below level and the shaft is slower than level * settling, the push is borne and the shaft
    brought to rest with the time constant ``settling`` [s]; a larger push, or a shaft in motion,
    is left alone. What is borne goes from all to nothing as the push passes from 1 - spread / 2 to
    1 + spread / 2 of the level, so that a fit can feel the edge. Null: level = 0.
    Source: Karnopp 1985; Armstrong-Hélouvry, Dupont & Canudas de Wit 1994, section 2.

    Example:
        >>> model = dft.Thruster() + dft.effects.StaticFriction(level=4)
        >>> model.parameters["static_friction.level"].range_text()
        '[0, inf) rad/s^2'
    """

    name = "static_friction"
    in_words = "stiction holds the shaft up to {level}"
    port = "shaft"
    level: float = from_zero(
        4.0, "rad/s^2", size=5.0, probes=relative_to("drive", 0.04, 0.08, 0.16)
    )
    settling: float = parameter(0.03, "s", bounds=(0, None), fixed=True)
    spread: float = parameter(0.3, bounds=(0, 2), fixed=True)

    def __call__(self, value: Signal, s: Signals) -> Signal:
        near = s.speed / (self.level * self.settling + 1e-9)
        margin = (self.level - jnp.abs(value)) / (self.spread * self.level + 1e-9)
        # near**4 is flat around rest and falls steeply at the edge: a smooth switch that hardly
        # brakes a shaft in motion
        borne = jnp.maximum(1.0 - near**4, 0.0) * jnp.clip(0.5 + margin, 0.0, 1.0)
        return value - borne * (value + s.speed / self.settling)
