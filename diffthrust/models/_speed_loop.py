"""The thruster behind a speed controller."""

from collections.abc import Mapping
from typing import ClassVar, Self

import jax.numpy as jnp

from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.power_law import power_law
from diffthrust.models._base.signals import RatesAndOutputs, Relaxing, Signal, Signals


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
    options: ClassVar[tuple[str, ...]] = ("command",)
    inputs: ClassVar[Mapping[str, str]] = {"command": "effort"}
    commands: tuple[str, ...] = ("effort", "V", "rad/s")
    commanded: tuple[str, ...] = ("command",)
    optional_inputs: ClassVar[Mapping[str, str]] = {
        "speed": "rad/s",
        "inflow": "m/s",
        "supply_voltage": "V",
    }
    states: ClassVar[Mapping[str, str]] = {"speed": "rad/s"}
    outputs: ClassVar[Mapping[str, str]] = {"speed": "rad/s", "thrust": "N"}
    ports: ClassVar[Mapping[str, str]] = {
        "target": "speed that the controller aims at [rad/s]",
        "loop": "acceleration of the shaft by the controller [rad/s^2]",
        "propeller": "thrust of the propeller [N]",
    }
    time_scales: ClassVar[tuple[float, float]] = (0.005, 4.0)

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
        """Fossen 2011, section 12.3, behind a static curve."""
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
