"""A body that moves along one axis."""

from collections.abc import Mapping
from typing import ClassVar

from diffthrust.models._axis_vehicle import PORTS, STATES, along_axis
from diffthrust.models._base.component import registered
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.signals import Rate, RatesAndOutputs, Signals
from diffthrust.models._craft.body import Body
from diffthrust.models._craft.kinematics import Kinematics, kinematics_of
from diffthrust.models._craft.six import Six


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
    states: ClassVar[Mapping[str, str]] = STATES
    outputs: ClassVar[Mapping[str, str]] = STATES
    ports: ClassVar[Mapping[str, str]] = PORTS

    mass: float = parameter(340.0, "kg", bounds=(0, None))
    drag: float = parameter(67.0, "N s^2/m^2", bounds=(0, None))

    def motion(self, s: Signals, port: Ports) -> Six:
        """Along x."""
        return Six(surge=s.velocity)

    def equations(self, s: Signals, port: Ports, water: Six, forces: Six) -> RatesAndOutputs:
        """Yoerger et al. 1990, section IV."""
        thrust = forces.surge + 0.0 * s.velocity
        port.tell(thrust=thrust)
        return along_axis(s, port, thrust, self.mass, self.drag)

    def kinematics(self, s: Signals, rates: Mapping[str, Rate]) -> Kinematics:
        """To the north."""
        named = {"surge": s.velocity, "north": s.position}
        return kinematics_of(Signals(named), {"surge": rates["velocity"]})
