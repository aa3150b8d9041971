"""Attitude as a quaternion, or as angles."""

from collections.abc import Collection, Mapping
from typing import Any, ClassVar

import numpy as np

from diffthrust.models._base.component import registered
from diffthrust.models._base.signals import Signal
from diffthrust.models._craft import attitude
from diffthrust.models._craft.attitude import Quaternion
from diffthrust.models._craft.kinematics import QUATERNION, Kinematics
from diffthrust.models._craft.sensor import Sensor

_HALF = 0.5**0.5
_TO_WORLD: Mapping[str, Quaternion] = {
    "NED": (1.0, 0.0, 0.0, 0.0),
    "ENU": (0.0, _HALF, _HALF, 0.0),  # half a turn about north-east
}
"""From north, east, down to the axes of the world in which readings are."""
_TO_BODY: Mapping[str, Quaternion] = {
    "NED": (1.0, 0.0, 0.0, 0.0),
    "ENU": (0.0, -1.0, 0.0, 0.0),  # half a turn about the bow
}
"""From the axes of the body in which readings are to forward, starboard, down."""


@registered
class Attitude(Sensor):
    """The attitude of a craft, as a quaternion or as angles.

    ``qw, qx, qy, qz`` (scalar first) turns the body's axes into those of the world; ``roll``,
    ``pitch`` and ``yaw`` are its angles about x, y and z, of which yaw comes first. With
    ``frame="NED"``, as autopilots log it, the body's axes are forward, starboard, down, and the
    world's north, east, down: yaw is the heading. With ``frame="ENU"``, as ROS has it (REP 103),
    they are forward, port, up, and east, north, up: yaw is counterclockwise from east. A
    quaternion and its negative are the same attitude: logs may have either.

    Where it sits does not matter. A fit begins at its first reading; give the quaternion or the
    angles of one unit, not both. Source: Fossen 2021, section 2.2.

    Example:
        >>> boat = dft.Craft(dft.bodies.Planar(), odom=dft.sensors.Attitude(frame="ENU"))
        >>> record = dft.Log(np.array([0.0, 0.1]), {})
        >>> east = dft.simulate(boat, record, initial={"heading": np.pi / 2})
        >>> abs(round(float(east["odom.yaw"][0]), 6))
        0.0
    """

    name = "attitude"
    outputs: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(QUATERNION, ""),
        **dict.fromkeys(("roll", "pitch", "yaw"), "rad"),
    }
    angles: ClassVar[tuple[str, ...]] = ("roll", "yaw")
    quaternions: ClassVar[tuple[tuple[str, ...], ...]] = (QUATERNION,)
    frames: ClassVar[tuple[str, ...]] = ("NED", "ENU")
    placed: ClassVar[bool] = False

    def read(self, moving: Kinematics) -> Mapping[str, Signal]:
        """The attitude between the declared axes."""
        q = moving.attitude
        if self.frame != self.frames[0]:
            q = attitude.product(attitude.product(_TO_WORLD[self.frame], q), _TO_BODY[self.frame])
        return dict(zip(self.outputs, (*q, *attitude.angles(q)), strict=True))

    def as_of_body(self, readings: Mapping[str, Any]) -> Mapping[str, Any]:
        """Roll, pitch and heading."""
        q = self.attitude_from(readings)
        if q is None:
            return {}
        angles = zip(("roll", "pitch", "heading"), attitude.angles(attitude.unit(q)), strict=True)
        return {name: np.asarray(angle) for name, angle in angles}

    def attitude_from(self, first: Mapping[str, Any]) -> Quaternion | None:
        """By the quaternion, or by the angles that are read; others are zero."""
        if all(name in first for name in QUATERNION):
            w, x, y, z = (first[name] for name in QUATERNION)
            q: Quaternion = (w, x, y, z)
        elif "yaw" in first:
            q = attitude.from_angles(first.get("roll", 0.0), first.get("pitch", 0.0), first["yaw"])
        else:
            return None
        world, body = (attitude.inverse(turn[self.frame]) for turn in (_TO_WORLD, _TO_BODY))
        return attitude.product(attitude.product(world, q), body)

    def _telling(self, channels: Collection[str]) -> tuple[str, ...]:
        """The quaternion, all angles, or that of a craft that stays level."""
        choices = (QUATERNION, ("roll", "pitch", "yaw"), ("yaw",))
        return next((names for names in choices if {*names} <= {*channels}), ())
