"""Bodies with one degree of freedom: along an axis, and in heave."""

from collections.abc import Mapping

import jax.numpy as jnp

from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.signals import Rate, RatesAndOutputs, Signals
from diffthrust.models._craft.body import Body
from diffthrust.models._craft.kinematics import Kinematics, kinematics_of
from diffthrust.models._craft.six import Six
from diffthrust.models._one_axis import PORTS, STATES, along_axis


@registered
class Axis(Body):
    """One degree of freedom with quadratic drag, along x: `AxisVehicle` without its thrust.

        mass * d(velocity)/dt = force - drag * velocity |velocity|
        d(position)/dt        = velocity

    ``mass`` includes the added mass. Source: Yoerger, Cooke & Slotine 1990, section IV; the
    defaults are one axis of Jason Jr.

    Example:
        >>> axis = dft.Craft(dft.bodies.Axis(), aft=dft.Thruster().at((-0.5, 0, 0)))
        >>> list(axis.outputs)
        ['position', 'velocity', 'aft.speed', 'aft.thrust']
    """

    name = "axis"
    states = outputs = STATES
    ports = PORTS

    mass: float = parameter(340.0, "kg", bounds=(0, None))
    drag: float = parameter(67.0, "N s^2/m^2", bounds=(0, None))

    def motion(self, s: Signals, port: Ports) -> Six:
        return Six(surge=s.velocity)

    def equations(self, s: Signals, port: Ports, water: Six, forces: Six) -> RatesAndOutputs:
        thrust = forces.surge + 0.0 * s.velocity
        port.tell(thrust=thrust)
        return along_axis(s, port, thrust, self.mass, self.drag)

    def kinematics(self, s: Signals, rates: Mapping[str, Rate]) -> Kinematics:
        named = {"surge": s.velocity, "north": s.position}
        return kinematics_of(Signals(named), {"surge": rates["velocity"]})


@registered
class Heave(Body):
    """Heave alone, down positive, under weight and buoyancy.

        m33 * d(heave)/dt = force - d33 * heave - q33 * heave |heave| + weight - buoyancy
        d(depth)/dt       = heave

    ``m33`` includes the added mass. Only the difference of weight and buoyancy acts: the weight is
    held, as it was weighed in air. Thrusters that push down have ``pointing=(0, 0, 1)``.
    Source: Fossen 2021, sections 4.1 (weight and buoyancy) and 6.4 (damping); the defaults are of
    a remotely operated vehicle of 11 kg.

    Example:
        >>> dive = dft.Craft(
        ...     dft.bodies.Heave(), lift=dft.Thruster().at((0, 0, 0), pointing=(0, 0, 1))
        ... )
        >>> dive.parameters["weight"].fixed
        True
    """

    name = "heave"
    states = {"depth": "m", "heave": "m/s"}
    outputs = states
    ports = {"hull": "force of the water on the hull [N]", "force": "net force [N]"}

    m33: float = parameter(26.0, "kg", bounds=(0, None), doc="mass with added mass")
    d33: float = parameter(5.0, "N s/m", bounds=(0, None), null=0.0, size=5.0, doc="linear damping")
    q33: float = parameter(
        37.0, "N s^2/m^2", bounds=(0, None), null=0.0, size=40.0, doc="quadratic damping"
    )
    weight: float = parameter(
        112.8, "N", bounds=(0, None), fixed=True, transform="linear", size=10.0
    )
    buoyancy: float = parameter(114.8, "N", bounds=(0, None), transform="linear", size=10.0)

    def motion(self, s: Signals, port: Ports) -> Six:
        return Six(heave=s.heave)

    def equations(self, s: Signals, port: Ports, water: Six, forces: Six) -> RatesAndOutputs:
        w = s.heave
        thrust = forces.heave + 0.0 * w
        port.tell(thrust=thrust)
        hull = port("hull", -(self.d33 + self.q33 * jnp.abs(w)) * w)
        force = port("force", thrust + hull + self.weight - self.buoyancy)
        return {"depth": w, "heave": force / self.m33}, {"depth": s.depth, "heave": w}
