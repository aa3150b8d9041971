"""Sensors of a craft, with their readings as vehicles log them."""

from collections.abc import Collection, Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from diffthrust.models._base.component import registered
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.signals import Signal
from diffthrust.models._craft import attitude
from diffthrust.models._craft.attitude import Quaternion
from diffthrust.models._craft.kinematics import GRAVITY, QUATERNION, Kinematics
from diffthrust.models._craft.sensor import Sensor
from diffthrust.models._craft.six import dot, in_frame, minus, times

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
    outputs = {
        **dict.fromkeys(QUATERNION, ""),
        **dict.fromkeys(("roll", "pitch", "yaw"), "rad"),
    }
    angles = ("roll", "yaw")
    quaternions = (QUATERNION,)
    frames = ("NED", "ENU")
    placed = False

    def read(self, moving: Kinematics) -> Mapping[str, Signal]:
        q = moving.attitude
        if self.frame != self.frames[0]:
            q = attitude.product(attitude.product(_TO_WORLD[self.frame], q), _TO_BODY[self.frame])
        return dict(zip(self.outputs, (*q, *attitude.angles(q)), strict=True))

    def as_of_body(self, readings: Mapping[str, Any]) -> Mapping[str, Any]:
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


class _OfAxes(Sensor):
    """Readings along, or about, the axes of the body: three, or two triples."""

    frames = ("FRD", "FLU")

    def as_of_body(self, readings: Mapping[str, Any]) -> Mapping[str, Any]:
        signs = (len(self.outputs) // 3) * in_frame(self.frame, (1.0, 1.0, 1.0))
        pairs = zip(self.outputs, signs, strict=True)
        return {name: sign * readings[name] for name, sign in pairs if name in readings}


@registered
class DVL(_OfAxes):
    """A Doppler velocity log with bottom track: v + omega x r along the body's axes.

    ``surge``, ``sway`` and ``heave`` [m/s] are forward, to starboard and down; with
    ``frame="FLU"``, as ROS has it, forward, to port and up. Source: Fossen 2021, section 13.1.

    Example:
        >>> rov = dft.Craft(dft.bodies.SixDegrees(), dvl=dft.sensors.DVL().at((-0.3, 0, 0.1)))
        >>> list(rov.outputs)[-3:]
        ['dvl.surge', 'dvl.sway', 'dvl.heave']
    """

    name = "dvl"
    outputs = dict.fromkeys(("surge", "sway", "heave"), "m/s")

    def read(self, moving: Kinematics) -> Mapping[str, Signal]:
        return dict(zip(self.outputs, in_frame(self.frame, moving.velocity.linear), strict=True))


@registered
class GNSS(Sensor):
    """A receiver of satellites, or what else fixes a place of the craft: a beacon, a camera.

    ``north``, ``east`` and ``down`` [m] are where its antenna is, ``velocity_north``,
    ``velocity_east`` and ``velocity_down`` [m/s] how it moves, and ``speed`` [m/s] is its speed
    over ground without direction. A latitude named ``gps.north`` and a longitude named
    ``gps.east``, in deg, become metres from the first fix of the log. The place of the antenna is
    held; logs that turn tell it: ``craft.free("gps.x", "gps.y")``.
    Source: Fossen 2021, section 13.1 (sensors), 2.2 (a vector of the body in axes of the world).

    Example:
        >>> boat = dft.Craft(dft.bodies.Planar(), gps=dft.sensors.GNSS().at((0.4, 0, -1)))
        >>> out = dft.simulate(boat, dft.Log(np.array([0.0, 0.1]), {}), initial={"yaw_rate": 0.5})
        >>> round(float(out["gps.north"][0]), 3), round(float(out["gps.velocity_east"][0]), 3)
        (0.4, 0.2)
    """

    name = "gnss"
    outputs = {
        **dict.fromkeys(("north", "east", "down"), "m"),
        **dict.fromkeys(("velocity_north", "velocity_east", "velocity_down", "speed"), "m/s"),
    }

    def read(self, moving: Kinematics) -> Mapping[str, Signal]:
        velocity = moving.velocity.linear
        # not by north and east: a speed would seem to tell the heading, which no error then moves.
        # The root has no derivative at rest: a micrometre per second stands in for it.
        diving = dot(moving.down, velocity)
        speed = jnp.sqrt(minus(dot(velocity, velocity), times(diving, diving)) + 1e-12)
        readings = (*moving.position, *moving.to_world(velocity), speed)
        return dict(zip(self.outputs, readings, strict=True))

    def as_of_body(self, readings: Mapping[str, Any]) -> Mapping[str, Any]:
        names = {"north": "north", "east": "east", "down": "depth"}
        return {names[name]: readings[name] for name in names if name in readings}


@registered
class IMU(_OfAxes):
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
    outputs = {
        **dict.fromkeys(("roll_rate", "pitch_rate", "yaw_rate"), "rad/s"),
        **dict.fromkeys(("x_force", "y_force", "z_force"), "m/s^2"),
    }

    def read(self, moving: Kinematics) -> Mapping[str, Signal]:
        both = (moving.velocity.angular, moving.specific_force)
        readings = (each for triple in both for each in in_frame(self.frame, triple))
        return dict(zip(self.outputs, readings, strict=True))


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
    outputs = {"pressure": "Pa", "depth": "m"}

    density: float = parameter(1000.0, "kg/m^3", bounds=(0, None), fixed=True, size=30.0)
    tare: float = parameter(101_325.0, "Pa", fixed=True, size=2000.0, doc="at the surface")

    def read(self, moving: Kinematics) -> Mapping[str, Signal]:
        down = moving.position[2]
        return {"pressure": self.tare + self.density * GRAVITY * down, "depth": down}

    def as_of_body(self, readings: Mapping[str, Any]) -> Mapping[str, Any]:
        if "pressure" in readings:
            return {"depth": (readings["pressure"] - self.tare) / (self.density * GRAVITY)}
        return {"depth": readings["depth"]} if "depth" in readings else {}
