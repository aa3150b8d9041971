"""The thruster with its direct-current motor."""

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.signals import RatesAndOutputs, Relaxing, Signals


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
    inputs: ClassVar[Mapping[str, str]] = {"command": "V"}
    states: ClassVar[Mapping[str, str]] = {"current": "A", "speed": "rad/s"}
    outputs: ClassVar[Mapping[str, str]] = {"speed": "rad/s", "thrust": "N", "current": "A"}
    ports: ClassVar[Mapping[str, str]] = {
        "drive": "torque of the motor [N m]",
        "load": "torque of the propeller [N m]",
        "shaft": "net torque on the shaft [N m]",
        "propeller": "thrust of the propeller [N]",
    }
    time_scales: ClassVar[tuple[float, float]] = (0.0005, 4.0)

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
        """Aras et al. 2013, equations of the motor and of the thruster."""
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
