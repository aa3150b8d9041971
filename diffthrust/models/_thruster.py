"""The torque-driven thruster."""

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.power_law import power_law
from diffthrust.models._base.quadratic_load import QuadraticLoad
from diffthrust.models._base.signals import RatesAndOutputs, Signal, Signals


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
    options: ClassVar[tuple[str, ...]] = ("command",)
    inputs: ClassVar[Mapping[str, str]] = {"command": "V"}
    commands: tuple[str, ...] = ("V", "effort", "rad/s", "A", "N m", "N")
    commanded: tuple[str, ...] = ("command",)
    optional_inputs: ClassVar[Mapping[str, str]] = {
        "speed": "rad/s",
        "inflow": "m/s",
        "supply_voltage": "V",
    }
    states: ClassVar[Mapping[str, str]] = {"speed": "rad/s"}
    outputs: ClassVar[Mapping[str, str]] = {"speed": "rad/s", "thrust": "N"}
    ports: ClassVar[Mapping[str, str]] = {
        "drive": "acceleration of the shaft by the motor's torque [rad/s^2]",
        "load": "deceleration of the shaft by the propeller's torque [rad/s^2]",
        "shaft": "net acceleration of the shaft [rad/s^2]",
        "propeller": "thrust of the propeller [N]",
    }
    time_scales: ClassVar[tuple[float, float]] = (0.005, 4.0)

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
        """Yoerger et al. 1990, section II C."""
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
