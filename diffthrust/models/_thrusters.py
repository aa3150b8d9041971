"""Thrusters: driven by a torque, behind a speed controller, in a duct, with its motor."""

from collections.abc import Mapping
from typing import Self

import jax.numpy as jnp

from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.quadratic_load import QuadraticLoad
from diffthrust.models._base.signals import RatesAndOutputs, Relaxing, Signal, Signals, power_law

_TORQUE_DRIVEN = {
    "drive": "acceleration of the shaft by the motor's torque [rad/s^2]",
    "load": "deceleration of the shaft by the propeller's torque [rad/s^2]",
    "shaft": "net acceleration of the shaft [rad/s^2]",
    "propeller": "thrust of the propeller [N]",
}
"""The ports of models whose command is, or makes, a torque."""


@registered
class Thruster(Model):
    """A propeller in a duct, driven by a torque that follows the command.

        d(speed)/dt = beta * command - alpha * speed |speed|
        thrust      = ct * speed |speed|

    Steady thrust is proportional to the command, and small steps settle more slowly than large
    ones. With ``speed`` given as an input of the log, the thrust part alone is simulated. The
    optional ``inflow`` and ``supply_voltage`` are there for effects; these equations do not read
    them. The command is a voltage, or with ``command="effort"`` a share of the full command (of
    PWM widths, per cent, duty), or the set point of a speed ("rad/s"), current ("A"), torque
    ("N m") or thrust ("N"): ``beta`` is per that unit.

    Source: Yoerger, Cooke & Slotine 1990, section II C; the defaults are the dynamic test of the
    Jason thruster, figure 10.

    Example:
        >>> speed = dft.simulate(dft.Thruster(alpha=0.03), log)["speed"]
        >>> speed.shape
        (240,)
    """

    name = "thruster"
    options = ("command",)
    inputs = {"command": "V"}
    commands = ("V", "effort", "rad/s", "A", "N m", "N")
    commanded = ("command",)
    optional_inputs = {"speed": "rad/s", "inflow": "m/s", "supply_voltage": "V"}
    states = {"speed": "rad/s"}
    outputs = {"speed": "rad/s", "thrust": "N"}
    ports = _TORQUE_DRIVEN
    time_scales = (0.005, 4.0)

    alpha: float = parameter(0.037, "1/rad", bounds=(0, None), doc="propeller load")
    beta: float = parameter(
        42.0, "rad/({command} s^2)", bounds=(0, None), doc="drive by the command"
    )
    ct: float = parameter(0.019, "N s^2/rad^2", bounds=(0, None), doc="thrust")

    @property
    def quadratic_load(self) -> QuadraticLoad:
        """All of these equations."""
        return QuadraticLoad(drive_gain=self.beta, load=self.alpha, thrust_gain=self.ct)

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        swept = s.speed * jnp.abs(s.speed)
        thrust = port("propeller", self.ct * swept)
        outputs = {"speed": s.speed, "thrust": thrust}
        if "command" not in s:  # the speed is prescribed by the log: nothing drives the shaft
            return {}, outputs
        drive = port("drive", self.beta * s.command)
        load = port("load", self.alpha * swept)
        return {"speed": port("shaft", drive - load)}, outputs

    def settled(self, s: Signals) -> Mapping[str, Signal | float]:
        """At the speed at which the load holds the drive."""
        if "command" not in s:
            return {}
        return {"speed": power_law(self.beta / self.alpha * s.command, 0.5)}


@registered
class SpeedLoopThruster(Model):
    """A propeller whose motor controller (ESC) holds the speed that the command asks for.

        target      = gain * sign(command) |command|^exponent
        d(speed)/dt = (target - speed) / time_constant
        thrust      = ct * speed |speed|

    Small and large steps settle alike, and the propeller's load does not show: where instead small
    steps settle more slowly, the command drives a torque (`Thruster`). A dead band before the
    static curve is the effect `command_deadband`, a limit of the acceleration `slew_limit`. The
    command is an effort, or a voltage or the set point of the speed, which the speed follows in
    proportion (``exponent`` is 1).

    Source: the speed loop as a first-order lag, Fossen 2011, section 12.3 (actuators under
    low-level control); thrust as in Yoerger, Cooke & Slotine 1990, section II C. The defaults are
    of a thruster of 0.1 m at some 3000 rpm.

    Example:
        >>> model = dft.SpeedLoopThruster(command="effort") + "command_deadband"
        >>> model.inputs, list(model.parameters)[:4]
        ({'command': 'effort'}, ['gain', 'exponent', 'time_constant', 'ct'])
    """

    name = "speed_loop_thruster"
    options = ("command",)
    inputs = {"command": "effort"}
    commands = ("effort", "V", "rad/s")
    commanded = ("command",)
    optional_inputs = {"speed": "rad/s", "inflow": "m/s", "supply_voltage": "V"}
    states = {"speed": "rad/s"}
    outputs = {"speed": "rad/s", "thrust": "N"}
    ports = {
        "target": "speed that the controller aims at [rad/s]",
        "loop": "acceleration of the shaft by the controller [rad/s^2]",
        "propeller": "thrust of the propeller [N]",
    }
    time_scales = (0.005, 4.0)

    gain: float = parameter(
        300.0, "rad/({command} s)", bounds=(0, None), doc="speed at full command"
    )
    exponent: float = parameter(1.0, bounds=(0.05, 4.0), transform="log", doc="of the static curve")
    time_constant: float = parameter(0.2, "s", bounds=(0, None), doc="of the speed loop")
    ct: float = parameter(6e-4, "N s^2/rad^2", bounds=(0, None), doc="thrust")

    def commanded_in(self, unit: str) -> Self:
        """The thruster with its command in another unit; only of an effort is the curve fitted."""
        converted, bends = super().commanded_in(unit), unit == "effort"
        if bends == (self.command in ("effort", "")):
            return converted
        return converted.replace(exponent={"fixed": not bends})

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        thrust = port("propeller", self.ct * s.speed * jnp.abs(s.speed))
        outputs = {"speed": s.speed, "thrust": thrust}
        if "command" not in s:  # the speed is prescribed by the log: nothing drives the shaft
            return {}, outputs
        target = port("target", self.gain * power_law(s.command, self.exponent))
        lag = (target - s.speed) / self.time_constant
        return {"speed": Relaxing(port("loop", lag), 1.0 / self.time_constant)}, outputs

    def settled(self, s: Signals) -> Mapping[str, Signal | float]:
        """At the speed that the controller aims at."""
        if "command" not in s:
            return {}
        return {"speed": self.gain * power_law(s.command, self.exponent)}


@registered
class DuctedThruster(Model):
    """A propeller in a duct, from a torque to the thrust and to the flow that leaves the duct.

        d(speed)/dt = beta * command - alpha * speed |speed|
        thrust      = ct * speed |speed|
        flow        = efficiency * pitch * speed

    with ``alpha = area efficiency pitch / (2 volume)``, ``beta = 1 / (density volume efficiency^2
    pitch^2)`` and ``ct = density area efficiency^2 pitch^2``: the `Thruster` whose command is a
    torque [N m], in the sizes behind its three parameters. A current meter in the outlet measures
    ``flow`` [m/s]. Pitch, area and density are taken as known: speed and flow determine the
    efficiency, and the thrust determines it independently. With ``speed`` given as an input of the
    log, thrust and flow alone are simulated.

    Source: Yoerger, Cooke & Slotine 1990, section II B, equations 1 to 4; the defaults are of the
    Jason thruster, section III, with the efficiency that its static ct of 0.022 N s^2 stands for.

    Example:
        >>> model = dft.models.DuctedThruster(pitch=0.101, area=0.0527)
        >>> model.inputs, sorted(model.outputs)
        ({'command': 'N m'}, ['flow', 'speed', 'thrust'])
    """

    name = "ducted_thruster"
    inputs = {"command": "N m"}
    optional_inputs = {"speed": "rad/s", "inflow": "m/s", "supply_voltage": "V"}
    states = {"speed": "rad/s"}
    outputs = {"speed": "rad/s", "thrust": "N", "flow": "m/s"}
    ports = _TORQUE_DRIVEN
    time_scales = (0.005, 4.0)

    efficiency: float = parameter(0.2, bounds=(0, None), doc="1 - slip")
    volume: float = parameter(0.016, "m^3", bounds=(0, None), doc="of the water that moves along")
    pitch: float = parameter(0.101, "m/rad", bounds=(0, None), fixed=True)
    area: float = parameter(0.0527, "m^2", bounds=(0, None), fixed=True, doc="of the duct")
    density: float = parameter(1000.0, "kg/m^3", bounds=(0, None), fixed=True)

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        advance = self.efficiency * self.pitch
        swept = s.speed * jnp.abs(s.speed)
        thrust = port("propeller", self.density * self.area * advance**2 * swept)
        outputs = {"speed": s.speed, "thrust": thrust, "flow": advance * s.speed}
        if "command" not in s:  # the speed is prescribed by the log: nothing drives the shaft
            return {}, outputs
        drive = port("drive", s.command / (self.density * self.volume * advance**2))
        load = port("load", self.area * advance / (2.0 * self.volume) * swept)
        return {"speed": port("shaft", drive - load)}, outputs


@registered
class DCMotorThruster(Model):
    """A propeller driven by a DC motor, from the terminal voltage to the thrust.

        inductance * d(current)/dt = command - resistance * current - back_emf * speed
        inertia * d(speed)/dt      = torque_constant * current - viscous * speed
                                     - coulomb * tanh(speed / 0.1 rad/s) - load * speed |speed|
        thrust                     = thrust_linear * speed + thrust_quadratic * speed |speed|

    Where the electrical time constant inductance / resistance vanishes this is the torque-driven
    `Thruster` with ``beta = torque_constant / (resistance * inertia)``, ``alpha = load / inertia``
    and a damping in proportion to speed. The current is integrated as a `Relaxing` state, so the
    electrical time constant may lie far below the log's step. It begins as measured; where the log
    has no current it begins at zero, and settles within a few electrical time constants.

    Source: Aras et al. 2013, motor equations and table of motor data. The propeller's load and
    thrust coefficients are not printed there; the defaults are of a propeller of that size.

    Example:
        >>> model = dft.DCMotorThruster().fix("inductance", "resistance")
        >>> model.inputs
        {'command': 'V'}
        >>> [name for name, p in model.parameters.items() if not p.fixed]
        ['back_emf', 'torque_constant', 'inertia', 'viscous', 'coulomb', 'load', 'thrust_quadratic']
    """

    name = "dc_motor_thruster"
    inputs = {"command": "V"}
    states = {"current": "A", "speed": "rad/s"}
    outputs = {"speed": "rad/s", "thrust": "N", "current": "A"}
    ports = {
        "drive": "torque of the motor [N m]",
        "load": "torque of the propeller [N m]",
        "shaft": "net torque on the shaft [N m]",
        "propeller": "thrust of the propeller [N]",
    }
    time_scales = (0.0005, 4.0)

    resistance: float = parameter(2.5604031, "ohm", bounds=(0, None))
    inductance: float = parameter(0.0046909, "H", bounds=(0, None), fixed=True)
    back_emf: float = parameter(0.0182595, "V s/rad", bounds=(0, None), null=0.0, size=0.02)
    torque_constant: float = parameter(0.0182595, "N m/A", bounds=(0, None))
    inertia: float = parameter(7.2019e-5, "kg m^2", bounds=(0, None))
    viscous: float = parameter(9.1358e-5, "N m s/rad", bounds=(0, None), null=0.0, size=1e-4)
    coulomb: float = parameter(3.3109e-4, "N m", bounds=(0, None), null=0.0, size=1e-3)
    load: float = parameter(1e-6, "N m s^2/rad^2", bounds=(0, None))
    thrust_linear: float = parameter(0.0, "N s/rad", null=0.0, size=0.01, fixed=True)
    thrust_quadratic: float = parameter(1e-4, "N s^2/rad^2", bounds=(0, None))

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        swept = s.speed * jnp.abs(s.speed)
        thrust = port("propeller", self.thrust_linear * s.speed + self.thrust_quadratic * swept)
        drive = port("drive", self.torque_constant * s.current)
        # a sign would switch at every step near rest; 0.1 rad/s lies far below any working speed
        friction = self.viscous * s.speed + self.coulomb * jnp.tanh(s.speed / 0.1)
        torque = port("shaft", drive - friction - port("load", self.load * swept))
        voltage = s.command - self.resistance * s.current - self.back_emf * s.speed
        rates = {
            "current": Relaxing(voltage / self.inductance, self.resistance / self.inductance),
            "speed": torque / self.inertia,
        }
        return rates, {"speed": s.speed, "thrust": thrust, "current": s.current}
