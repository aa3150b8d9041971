"""Velocities over ground at a place of the craft."""

from collections.abc import Mapping
from typing import Any, ClassVar

from diffthrust.models._base.component import registered
from diffthrust.models._base.signals import Signal
from diffthrust.models._craft.kinematics import Kinematics
from diffthrust.models._craft.sensor import Sensor
from diffthrust.models._craft.six import in_frame


@registered
class DVL(Sensor):
    """A Doppler velocity log with bottom track: v + omega x r along the body's axes.

    ``surge``, ``sway`` and ``heave`` [m/s] are forward, to starboard and down; with
    ``frame="FLU"``, as ROS has it, forward, to port and up. Source: Fossen 2021, section 13.1.

    Example:
        >>> rov = dft.Craft(dft.bodies.SixDegrees(), dvl=dft.sensors.DVL().at((-0.3, 0, 0.1)))
        >>> list(rov.outputs)[-3:]
        ['dvl.surge', 'dvl.sway', 'dvl.heave']
    """

    name = "dvl"
    outputs: ClassVar[Mapping[str, str]] = dict.fromkeys(("surge", "sway", "heave"), "m/s")
    frames: ClassVar[tuple[str, ...]] = ("FRD", "FLU")

    def read(self, moving: Kinematics) -> Mapping[str, Signal]:
        """The velocity of its place."""
        return dict(zip(self.outputs, in_frame(self.frame, moving.velocity.linear), strict=True))

    def as_of_body(self, readings: Mapping[str, Any]) -> Mapping[str, Any]:
        """Forward, to starboard, down."""
        signs = zip(self.outputs, in_frame(self.frame, (1.0, 1.0, 1.0)), strict=True)
        return {name: sign * readings[name] for name, sign in signs if name in readings}
