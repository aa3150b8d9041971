"""Positions and velocities of an antenna over ground."""

from collections.abc import Mapping
from typing import Any, ClassVar

import jax.numpy as jnp

from diffthrust.models._base.component import registered
from diffthrust.models._base.signals import Signal
from diffthrust.models._craft.kinematics import Kinematics
from diffthrust.models._craft.sensor import Sensor
from diffthrust.models._craft.six import dot, minus, times


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
    outputs: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(("north", "east", "down"), "m"),
        **dict.fromkeys(("velocity_north", "velocity_east", "velocity_down", "speed"), "m/s"),
    }

    def read(self, moving: Kinematics) -> Mapping[str, Signal]:
        """Place and motion of the antenna."""
        velocity = moving.velocity.linear
        # not by north and east: a speed would seem to tell the heading, which no error then moves.
        # The root has no derivative at rest: a micrometre per second stands in for it.
        diving = dot(moving.down, velocity)
        speed = jnp.sqrt(minus(dot(velocity, velocity), times(diving, diving)) + 1e-12)
        readings = (*moving.position, *moving.to_world(velocity), speed)
        return dict(zip(self.outputs, readings, strict=True))

    def as_of_body(self, readings: Mapping[str, Any]) -> Mapping[str, Any]:
        """The position."""
        names = {"north": "north", "east": "east", "down": "depth"}
        return {names[name]: readings[name] for name in names if name in readings}
