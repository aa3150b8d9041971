"""Depth by the pressure of the water."""

from collections.abc import Mapping
from typing import Any, ClassVar

from diffthrust.models._base.component import registered
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.signals import Signal
from diffthrust.models._craft.kinematics import GRAVITY, Kinematics
from diffthrust.models._craft.sensor import Sensor


@registered
class Pressure(Sensor):
    """A sensor of pressure at its place: pressure = tare + density g down.

    ``depth`` [m] is what a unit reports that divides by density and g itself. ``tare`` [Pa] is what
    it reads at the surface, the standard atmosphere by default, and ``density`` [kg/m^3] of fresh
    water; both are held. Logs that also measure ``depth`` tell them, or begin at a known one.
    Source: the law of hydrostatics.

    Example:
        >>> dive = dft.Craft(dft.bodies.Heave(), bar=dft.sensors.Pressure().at((0, 0, 0.1)))
        >>> out = dft.simulate(dive, dft.Log(np.array([0.0, 0.1]), {}), initial={"depth": 9.9})
        >>> round(float(out["bar.pressure"][0])), float(out["bar.depth"][0])
        (199392, 10.0)
    """

    name = "pressure"
    outputs: ClassVar[Mapping[str, str]] = {"pressure": "Pa", "depth": "m"}

    density: float = parameter(1000.0, "kg/m^3", bounds=(0, None), fixed=True, size=30.0)
    tare: float = parameter(101_325.0, "Pa", fixed=True, size=2000.0, doc="at the surface")

    def read(self, moving: Kinematics) -> Mapping[str, Signal]:
        """Hydrostatic."""
        down = moving.position[2]
        return {"pressure": self.tare + self.density * GRAVITY * down, "depth": down}

    def as_of_body(self, readings: Mapping[str, Any]) -> Mapping[str, Any]:
        """The depth."""
        if "pressure" in readings:
            return {"depth": (readings["pressure"] - self.tare) / (self.density * GRAVITY)}
        return {"depth": readings["depth"]} if "depth" in readings else {}
