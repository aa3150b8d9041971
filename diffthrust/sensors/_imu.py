"""Rates of turn and specific force at a place of the craft."""

from collections.abc import Mapping
from typing import Any, ClassVar

from diffthrust.models._base.component import registered
from diffthrust.models._base.signals import Signal
from diffthrust.models._craft.kinematics import Kinematics
from diffthrust.models._craft.sensor import Sensor
from diffthrust.models._craft.six import in_frame


@registered
class IMU(Sensor):
    """Gyroscopes and accelerometers along the body's axes.

        rates = omega
        force = dv/dt + omega x v + domega/dt x r + omega x (omega x r) - R' g

    ``roll_rate``, ``pitch_rate`` and ``yaw_rate`` [rad/s] are about, ``x_force``, ``y_force`` and
    ``z_force`` [m/s^2, force per mass] along the axes forward, starboard, down: at rest the last
    reads -9.81. With ``frame="FLU"``, as ROS has it, forward, port, up: at rest it reads 9.81.
    Where a command jumps, a reading is of the command that begins there.
    Source: Titterton & Weston 2004, chapter 3; Fossen 2021, section 14.1.

    Example:
        >>> boat = dft.Craft(dft.bodies.Planar(), imu=dft.sensors.IMU(frame="FLU").at((0.1, 0, 0)))
        >>> at_rest = dft.simulate(boat, dft.Log(np.array([0.0, 0.1]), {}))
        >>> at_rest["imu.z_force"]
        array([9.80665, 9.80665])
    """

    name = "imu"
    outputs: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(("roll_rate", "pitch_rate", "yaw_rate"), "rad/s"),
        **dict.fromkeys(("x_force", "y_force", "z_force"), "m/s^2"),
    }
    frames: ClassVar[tuple[str, ...]] = ("FRD", "FLU")

    def read(self, moving: Kinematics) -> Mapping[str, Signal]:
        """Rates, and the specific force of its place."""
        both = (moving.velocity.angular, moving.specific_force)
        readings = (each for triple in both for each in in_frame(self.frame, triple))
        return dict(zip(self.outputs, readings, strict=True))

    def as_of_body(self, readings: Mapping[str, Any]) -> Mapping[str, Any]:
        """About and along forward, starboard, down."""
        signs = zip(self.outputs, 2 * in_frame(self.frame, (1.0, 1.0, 1.0)), strict=True)
        return {name: sign * readings[name] for name, sign in signs if name in readings}
