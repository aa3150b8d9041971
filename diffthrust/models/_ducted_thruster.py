"""The torque-driven thruster in the sizes of its duct, with the water that leaves it."""

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.signals import RatesAndOutputs, Signals


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
    inputs: ClassVar[Mapping[str, str]] = {"command": "N m"}
    optional_inputs: ClassVar[Mapping[str, str]] = {
        "speed": "rad/s",
        "inflow": "m/s",
        "supply_voltage": "V",
    }
    states: ClassVar[Mapping[str, str]] = {"speed": "rad/s"}
    outputs: ClassVar[Mapping[str, str]] = {"speed": "rad/s", "thrust": "N", "flow": "m/s"}
    ports: ClassVar[Mapping[str, str]] = {
        "drive": "acceleration of the shaft by the motor's torque [rad/s^2]",
        "load": "deceleration of the shaft by the propeller's torque [rad/s^2]",
        "shaft": "net acceleration of the shaft [rad/s^2]",
        "propeller": "thrust of the propeller [N]",
    }
    time_scales: ClassVar[tuple[float, float]] = (0.005, 4.0)

    efficiency: float = parameter(0.2, bounds=(0, None), doc="1 - slip")
    volume: float = parameter(0.016, "m^3", bounds=(0, None), doc="of the water that moves along")
    pitch: float = parameter(0.101, "m/rad", bounds=(0, None), fixed=True)
    area: float = parameter(0.0527, "m^2", bounds=(0, None), fixed=True, doc="of the duct")
    density: float = parameter(1000.0, "kg/m^3", bounds=(0, None), fixed=True)

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        """Yoerger et al. 1990, section II B."""
        advance = self.efficiency * self.pitch
        swept = s.speed * jnp.abs(s.speed)
        thrust = port("propeller", self.density * self.area * advance**2 * swept)
        outputs = {"speed": s.speed, "thrust": thrust, "flow": advance * s.speed}
        if "command" not in s:  # the speed is prescribed by the log: nothing drives the shaft
            return {}, outputs
        drive = port("drive", s.command / (self.density * self.volume * advance**2))
        load = port("load", self.area * advance / (2.0 * self.volume) * swept)
        return {"speed": port("shaft", drive - load)}, outputs
