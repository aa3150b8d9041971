"""Velocities of a body, and forces on it, in six degrees of freedom."""

from __future__ import annotations

from typing import Any, NamedTuple

Triple = tuple[Any, Any, Any]


class Six(NamedTuple):
    """One number for each axis: velocities [m/s, rad/s], or forces and moments [N, N m].

    Axes are those of the body: x forward, y to starboard, z down; roll, pitch and yaw about them.
    What a body does not have is the plain number 0.0, and costs nothing in compiled code.

    Example:
        >>> turning = dft.bodies.Six(surge=1.0, yaw=0.2)
        >>> turning.at((0.0, 0.5, 0.0)), turning.linear, turning.angular
        ((0.9, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.2))
        >>> dft.bodies.Six().pushed((10.0, 0.0, 0.0), (0.0, 0.5, 0.0)).yaw
        -5.0
    """

    surge: Any = 0.0
    sway: Any = 0.0
    heave: Any = 0.0
    roll: Any = 0.0
    pitch: Any = 0.0
    yaw: Any = 0.0

    @property
    def linear(self) -> Triple:
        """Along the axes."""
        return self.surge, self.sway, self.heave

    @property
    def angular(self) -> Triple:
        """About the axes."""
        return self.roll, self.pitch, self.yaw

    def at(self, place: Triple) -> Triple:
        """The velocity of the body at a place, of a `Six` of velocities."""
        return summed(self.linear, cross(self.angular, place))

    def pushed(self, force: Triple, place: Triple, moment: Triple = (0.0, 0.0, 0.0)) -> Six:
        """A `Six` of forces with one more, which acts at a place."""
        moments = summed(summed(self.angular, cross(place, force)), moment)
        return Six(*summed(self.linear, force), *moments)


def times(a: Any, b: Any) -> Any:
    """A product; plainly zero where a factor is."""
    return 0.0 if _is_zero(a) or _is_zero(b) else b if _is_one(a) else a * b


def plus(a: Any, b: Any) -> Any:
    """A sum; the other term where one is plainly zero."""
    return b if _is_zero(a) else a if _is_zero(b) else a + b


def minus(a: Any, b: Any) -> Any:
    """A difference; the first term where the second is plainly zero."""
    return a if _is_zero(b) else -b if _is_zero(a) else a - b


def cross(a: Triple, b: Triple) -> Triple:
    """The vector product."""
    (ax, ay, az), (bx, by, bz) = a, b
    return (
        minus(times(ay, bz), times(az, by)),
        minus(times(az, bx), times(ax, bz)),
        minus(times(ax, by), times(ay, bx)),
    )


def dot(a: Triple, b: Triple) -> Any:
    """The scalar product."""
    x, y, z = map(times, a, b)
    return plus(plus(x, y), z)


def summed(a: Triple, b: Triple) -> Triple:
    """The sum of two vectors."""
    x, y, z = map(plus, a, b)
    return x, y, z


def lessened(a: Triple, b: Triple) -> Triple:
    """The difference of two vectors."""
    x, y, z = map(minus, a, b)
    return x, y, z


def scaled(factor: Any, a: Triple) -> Triple:
    """A vector times a number."""
    x, y, z = (times(each, factor) for each in a)
    return x, y, z


def in_frame(frame: str, a: Triple) -> Triple:
    """A vector along forward, starboard, down in the axes of a sensor.

    These are "FRD", or "FLU" for forward, port, up.
    """
    x, y, z = a
    return (x, -y, -z) if frame == "FLU" else a


# Python's own numbers only: a traced zero is not known to be one. XLA keeps x * 0.0, which is NaN
# for an infinite x, so these products would cost in every step of a simulation.
def _is_zero(value: Any) -> bool:
    return isinstance(value, float) and value == 0.0


def _is_one(value: Any) -> bool:
    return isinstance(value, float) and value == 1.0
