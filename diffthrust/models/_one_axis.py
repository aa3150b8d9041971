"""A vehicle that moves along one axis, and a sensor of its depth."""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp

from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.signals import RatesAndOutputs, Signal, Signals

STATES: Mapping[str, str] = {"position": "m", "velocity": "m/s"}
PORTS: Mapping[str, str] = {
    "hull": "force of the water on the hull [N]",
    "force": "net force [N]",
}


def along_axis(s: Signals, port: Ports, thrust: Signal, mass: Any, drag: Any) -> RatesAndOutputs:
    """The motion along one axis under a thrust (Yoerger et al. 1990, section IV)."""
    hull = port("hull", -drag * s.velocity * jnp.abs(s.velocity))
    force = port("force", thrust + hull)
    rates = {"position": s.velocity, "velocity": force / mass}
    return rates, {"position": s.position, "velocity": s.velocity}


@registered
class AxisVehicle(Model):
    """One degree of freedom of an underwater vehicle with quadratic drag.

        mass * d(velocity)/dt = thrust - drag * velocity |velocity|
        d(position)/dt        = velocity

    ``mass`` includes the added mass. Source: Yoerger, Cooke & Slotine 1990, section IV; the
    defaults are one axis of Jason Jr.

    Example:
        >>> time = 0.1 * np.arange(100)
        >>> record = dft.Log(time, {"thrust": np.full(100, 20.0)})
        >>> result = dft.simulate(dft.AxisVehicle(mass=340.0, drag=67.0), record)
        >>> round(float(result["velocity"][-1]), 2)
        0.43
    """

    name = "axis_vehicle"
    inputs = {"thrust": "N"}
    states = outputs = STATES
    ports = PORTS
    time_scales = (0.05, 40.0)

    mass: float = parameter(340.0, "kg", bounds=(0, None))
    drag: float = parameter(67.0, "N s^2/m^2", bounds=(0, None))

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        return along_axis(s, port, s.thrust, self.mass, self.drag)


@registered
class LinearSensor(Model):
    """A depth sensor with a straight calibration line: reading = slope * depth + offset.

    A static model: its log may be a table without time. Source: Aras et al. 2013; the defaults
    are the datasheet line of that paper, which its own table 4 contradicts.

    Example:
        >>> depth = np.array([0.0, 1.0, 2.0, 3.0])
        >>> record = dft.Log(depth, {"depth": depth}, {"reading": 0.2 * depth + 0.5})
        >>> sensor = dft.LinearSensor(slope=0.2, offset=0.5)
        >>> dft.simulate(sensor, record)["reading"]
        array([0.5, 0.7, 0.9, 1.1])
    """

    name = "linear_sensor"
    inputs = {"depth": "m"}
    outputs = {"reading": "V"}
    ports = {"line": "reading of the sensor [V]"}

    slope: float = parameter(0.1901, "V/m", size=0.1)
    offset: float = parameter(-0.0973, "V", size=1.0)

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        return {}, {"reading": port("line", self.slope * s.depth + self.offset)}
