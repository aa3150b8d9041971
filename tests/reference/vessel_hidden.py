"""Hidden effects of the vessel; see ``hidden`` for the form of the table.

Signatures by place (forces are ratios to A; ``s`` are ``vessel.Signals``, speeds through water):

    inputs      f(time, inputs) -> time, inputs            before the run
    propeller   f(speed, s) -> speed [rev/s]
    rudder      f(angle, s) -> angle [rad]
    thrust      f(force, s) -> force along the propeller's axis
    side        f(force, s) -> side force at the stern
    hull        f((X, Y, N), s) -> (X, Y, N)
    current     f(north, east) -> north, east [m/s]
    coupling    f(mass, damping) -> mass, damping          off-diagonal, sway and yaw
"""

from __future__ import annotations

import math

import numpy as np

from .hidden import Effect, command_rate_limit


def swapped_thrusters(time, inputs, *, swapped=0.0):
    """Left and right are exchanged where ``swapped`` is not zero."""
    if not swapped:
        return time, inputs
    return time, {
        **inputs,
        "left_force": inputs["right_force"],
        "right_force": inputs["left_force"],
    }


def differential_gain(time, inputs, *, gain=0.0):
    """The left thruster gives 1 + ``gain`` of its force, the right one 1 - ``gain``."""
    return time, {
        **inputs,
        "left_force": inputs["left_force"] * (1.0 + gain),
        "right_force": inputs["right_force"] * (1.0 - gain),
    }


def force_exponent(time, inputs, *, exponent=1.0, reference=10.0):
    """Both forces by a power of the recorded ones, the same at the ``reference`` [N]."""
    both = {name: np.asarray(inputs[name], float) for name in ("left_force", "right_force")}
    powers = {
        n: np.sign(f) * reference * np.abs(f / reference) ** exponent for n, f in both.items()
    }
    return time, {**inputs, **powers}


def rudder_rate_limit(time, inputs, *, rate=math.inf):
    """The servo turns at most ``rate`` [rad/s], updated once per sample."""
    return time, {
        **inputs,
        "rudder_angle": command_rate_limit(time, inputs["rudder_angle"], rate=rate)[1],
    }


def lag(value, s, own, *, time_constant=0.0):
    """First-order lag of ``time_constant`` [s]."""
    return own, (value - own) / time_constant


def rudder_offset(angle, s, *, offset=0.0):
    """The hinge is mounted ``offset`` [rad] off."""
    return angle + offset


def reverse_propeller_asymmetry(force, s, *, change=0.0):
    """Reverse thrust is larger by the fraction ``change``."""
    return force * (1.0 + change) if force < 0.0 else force


def propeller_inflow(force, s, *, loss=0.0):
    """Thrust falls by the fraction ``loss`` of its size for each m/s of surge.

    T = T_nn |n| n - T_nu |n| u (Fossen 1994): in reverse it grows while the vessel runs ahead.
    """
    return force - loss * abs(force) * s.surge


def rudder_inflow(force, s, *, gain=0.0):
    """The side force grows by the fraction ``gain`` for each m/s of surge."""
    return force * (1.0 + gain * s.surge)


def propeller_walk(force, s, *, fraction=0.0):
    """The rotating propeller pushes the stern aside with ``fraction`` of its thrust.

    In reverse it pushes to the other side, as its blades do.
    """
    return force + fraction * s.thrust


def quadratic_surge_drag(forces, s, *, drag=0.0):
    """X loses ``drag`` u|u|."""
    x, y, n = forces
    return x - drag * s.surge * abs(s.surge), y, n


def quadratic_sway_drag(forces, s, *, drag=0.0):
    """Y loses ``drag`` v|v|."""
    x, y, n = forces
    return x, y - drag * s.sway * abs(s.sway), n


def quadratic_yaw_drag(forces, s, *, drag=0.0):
    """N loses ``drag`` r|r|."""
    x, y, n = forces
    return x, y, n - drag * s.yaw_rate * abs(s.yaw_rate)


def wind(forces, s, *, along=0.0, across=0.0, turning=0.0, speed=0.0, direction=0.0):
    """Drag of the apparent wind W = (a, b), in body axes.

    X, Y, N gain (along a, across b, turning b) |W|, ratios to A (Fossen 2011, section 8.1).
    The wind is the measured one plus a constant one of ``speed`` [m/s] from ``direction`` [rad].
    """
    north = -s.wind_speed * math.cos(s.wind_direction) - speed * math.cos(direction)
    east = -s.wind_speed * math.sin(s.wind_direction) - speed * math.sin(direction)
    c, sn = math.cos(s.heading), math.sin(s.heading)
    a = north * c + east * sn - s.surge_over_ground
    b = -north * sn + east * c - s.sway_over_ground
    size = math.hypot(a, b)
    x, y, n = forces
    return x + along * a * size, y + across * b * size, n + turning * b * size


def water_current(north, east, *, to_north=0.0, to_east=0.0):
    """The water moves over ground at (``to_north``, ``to_east``) [m/s]."""
    return north + to_north, east + to_east


def sway_yaw_coupling(m23, d23, *, mass=0.0, damping=0.0):
    """Off-diagonal added mass and damping, symmetric, ratios to A."""
    return m23 + mass, d23 + damping


VESSEL: dict[str, Effect] = {
    "swapped_thrusters": Effect("inputs", swapped_thrusters),
    "differential_gain": Effect("inputs", differential_gain),
    "force_exponent": Effect("inputs", force_exponent),
    "rudder_rate_limit": Effect("inputs", rudder_rate_limit),
    "propeller_lag": Effect("propeller", lag, state=True),
    "rudder_lag": Effect("rudder", lag, state=True),
    "rudder_offset": Effect("rudder", rudder_offset),
    "reverse_propeller_asymmetry": Effect("thrust", reverse_propeller_asymmetry),
    "propeller_inflow": Effect("thrust", propeller_inflow),
    "rudder_inflow": Effect("side", rudder_inflow),
    "propeller_walk": Effect("side", propeller_walk),
    "quadratic_surge_drag": Effect("hull", quadratic_surge_drag),
    "quadratic_sway_drag": Effect("hull", quadratic_sway_drag),
    "quadratic_yaw_drag": Effect("hull", quadratic_yaw_drag),
    "wind": Effect("hull", wind),
    "water_current": Effect("current", water_current),
    "sway_yaw_coupling": Effect("coupling", sway_yaw_coupling),
}
