"""Attitudes as quaternions, and as the angles of ships."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust.models._craft.six import Triple, minus, plus, times

Quaternion = tuple[Any, Any, Any, Any]


def from_angles(roll: Any, pitch: Any, heading: Any) -> Quaternion:
    """The unit quaternion (scalar first) of the angles [rad]; Fossen 2021, equation 2.78."""
    halves = [0.5 * a for a in (roll, pitch, heading)]
    maths = jnp if any(isinstance(a, jax.Array) for a in halves) else np
    (cr, sr), (cp, sp), (ch, sh) = ((maths.cos(a), maths.sin(a)) for a in halves)
    return (
        cr * cp * ch + sr * sp * sh,
        sr * cp * ch - cr * sp * sh,
        cr * sp * ch + sr * cp * sh,
        cr * cp * sh - sr * sp * ch,
    )


def product(p: Quaternion, q: Quaternion) -> Quaternion:
    """The turn by the second, then by the first; Fossen 2021, section 2.2."""
    a, (b, c, d) = p[0], p[1:]
    w, (x, y, z) = q[0], q[1:]
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


def inverse(q: Quaternion) -> Quaternion:
    """The turn back, of a unit quaternion."""
    w, x, y, z = q
    return w, -x, -y, -z


def unit(q: Quaternion) -> Quaternion:
    """The same attitude with a quaternion of length one."""
    w, x, y, z = q
    inverse = 1.0 / jnp.sqrt(w * w + x * x + y * y + z * z)
    return w * inverse, x * inverse, y * inverse, z * inverse


def angles(q: Quaternion) -> Triple:
    """Roll, pitch and heading [rad] of a unit quaternion; Fossen 2021, equations 2.81 to 2.83."""
    w, x, y, z = q
    down_x, down_y, down_z = down(q)
    # rounding may leave the sine of a vertical pitch beyond one
    pitch = jnp.arcsin(jnp.clip(-down_x, -1.0, 1.0))
    heading = jnp.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
    return jnp.arctan2(down_y, down_z), pitch, heading


def down(q: Quaternion) -> Triple:
    """The direction of the centre of the earth in the body's axes; plain numbers if level."""
    w, x, y, z = q
    return (
        times(2.0, minus(times(x, z), times(w, y))),
        times(2.0, plus(times(y, z), times(w, x))),
        minus(1.0, times(2.0, plus(times(x, x), times(y, y)))),
    )


def to_world(q: Quaternion, body: Triple) -> Triple:
    """A vector of the body's axes in those of north, east and down."""
    w, x, y, z = q
    a, b, c = body
    # v + 2 w (q x v) + 2 q x (q x v), with q x v worked out once
    s, t, u = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return (
        a + w * s + y * u - z * t,
        b + w * t + z * s - x * u,
        c + w * u + x * t - y * s,
    )


def rates(q: Quaternion, angular: Triple) -> Quaternion:
    """Rates of a quaternion by the body's angular velocity; Fossen 2021, equation 2.72.

    A pull of 1/s towards length one keeps what integration lets slip.
    """
    w, x, y, z = q
    p, r, t = angular
    pull = 0.5 * (1.0 - (w * w + x * x + y * y + z * z))
    return (
        -0.5 * (x * p + y * r + z * t) + pull * w,
        0.5 * (w * p + y * t - z * r) + pull * x,
        0.5 * (w * r + z * p - x * t) + pull * y,
        0.5 * (w * t + x * r - y * p) + pull * z,
    )
