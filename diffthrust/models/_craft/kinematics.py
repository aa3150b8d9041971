"""How a body moves over ground, at its origin or at another place of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp

from diffthrust.models._base.signals import Rate, Relaxing, Signals
from diffthrust.models._craft import attitude
from diffthrust.models._craft.attitude import Quaternion
from diffthrust.models._craft.six import Six, Triple, cross, lessened, scaled, summed

GRAVITY = 9.80665  # m/s^2, the standard one
_AXES = ("surge", "sway", "heave", "roll_rate", "pitch_rate", "yaw_rate")
_PLACE = ("north", "east", "depth")
QUATERNION = ("qw", "qx", "qy", "qz")


class Kinematics(NamedTuple):
    """What the sensors at a place of a craft are moved by.

    Args:
        velocity: over ground, along and about the body's axes.
        acceleration: the rates of these.
        position: to the north, to the east and down [m].
        attitude: unit quaternion from the body's axes to north, east, down, scalar first.

    Example:
        >>> turning = dft.sensors.Kinematics(dft.bodies.Six(surge=1.0, yaw=0.5))
        >>> ahead = turning.at((2.0, 0.0, 0.0))
        >>> ahead.velocity.linear, ahead.position
        ((1.0, 1.0, 0.0), (2.0, 0.0, 0.0))
        >>> ahead.specific_force  # at rest it would be (0, 0, -g)
        (-0.5, 0.5, -9.80665)
        >>> ahead.down, ahead.to_world((1.0, 0.0, 0.0))
        ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    """

    velocity: Six = Six()
    acceleration: Six = Six()
    position: Triple = (0.0, 0.0, 0.0)
    attitude: Quaternion = (1.0, 0.0, 0.0, 0.0)

    def at(self, place: Triple) -> Kinematics:
        """The same of another place of the body, forward, to starboard and down of this one."""
        return Kinematics(
            Six(*self.velocity.at(place), *self.velocity.angular),
            Six(*self.acceleration.at(place), *self.acceleration.angular),
            summed(self.position, self.to_world(place)),
            self.attitude,
        )

    def to_world(self, body: Triple) -> Triple:
        """A vector of the body's axes in those of north, east and down."""
        return attitude.to_world(self.attitude, body)

    @property
    def down(self) -> Triple:
        """The direction of the centre of the earth in the body's axes."""
        return attitude.down(self.attitude)

    @property
    def specific_force(self) -> Triple:
        """What an accelerometer feels [m/s^2]: dv/dt + omega x v - R' g.

        Source: Fossen 2021, section 14.1; Titterton & Weston 2004, chapter 3.
        """
        turning = cross(self.velocity.angular, self.velocity.linear)
        moving = summed(self.acceleration.linear, turning)
        return lessened(moving, scaled(GRAVITY, self.down))


def kinematics_of(s: Signals, rates: Mapping[str, Rate]) -> Kinematics:
    """The motion of a body whose states have the usual names; what it lacks is plainly zero."""

    def rate(name: str) -> Any:
        value = rates.get(name, 0.0)
        return value.rate if isinstance(value, Relaxing) else value

    if "qw" in s:
        turned = attitude.unit((s.qw, s.qx, s.qy, s.qz))
    elif "heading" in s:
        turned = (jnp.cos(0.5 * s.heading), 0.0, 0.0, jnp.sin(0.5 * s.heading))
    else:
        turned = (1.0, 0.0, 0.0, 0.0)
    north, east, down = (s.get(name, 0.0) for name in _PLACE)
    return Kinematics(
        Six(*(s.get(name, 0.0) for name in _AXES)),
        Six(*(rate(name) for name in _AXES)),
        (north, east, down),
        turned,
    )
