"""Surge, sway and yaw, which several bodies share."""

from collections.abc import Mapping
from typing import NamedTuple

from diffthrust.models._base.effect import Ports
from diffthrust.models._base.signals import Rate, Signal, Signals
from diffthrust.models._craft.six import Six
from diffthrust.models._planar_motion import (
    FORCE_PORTS,
    WATER_PORTS,
    rates_of,
    through_water,
)

PORTS: Mapping[str, str] = {
    **WATER_PORTS,
    "propulsion": "force of all actuators along x [N]",
    **FORCE_PORTS,
}


class Inertia(NamedTuple):
    """Masses with added masses, and the centre ``x_g`` where that of sway acts."""

    m11: Signal | float
    m22: Signal | float
    i33: Signal | float
    x_g: Signal | float


class Damping(NamedTuple):
    """Forces and the moment against the motion, over the velocity each; sway's acts at ``x_d``."""

    d11: Signal | float
    d22: Signal | float
    d33: Signal | float
    x_d: Signal | float


def motion(s: Signals, port: Ports) -> Six:
    """The velocities through the water."""
    u, v = through_water(s, port)
    return Six(surge=u, sway=v, yaw=s.yaw_rate)


def rates(
    s: Signals, port: Ports, water: Six, forces: Six, inertia: Inertia, damping: Damping
) -> dict[str, Rate]:
    """Rates of the velocities and of the place over ground.

    In axes through the centre of mass the mass matrix is diagonal: it is positive definite for any
    ``x_g``, Coriolis forces do no work, and the damping is dissipative for any ``x_d``.
    Source: Fossen 2021, sections 6.3 to 6.5, equations 3.46 and 6.1 in three degrees of freedom.
    """
    m11, m22, i33, x_g = inertia
    u, v, r = water.surge, water.sway, water.yaw
    port.tell(m22=m22, i33=i33)
    # 0.0 * r and not 0.0: outputs of a whole log have its shape
    ahead = port("propulsion", forces.surge + 0.0 * r)
    port.tell(propulsion=ahead)
    v_mass, v_damping = v + x_g * r, v + damping.x_d * r
    drag = damping.d22 * v_damping
    across = forces.sway + 0.0 * r
    about = forces.yaw - x_g * across - (damping.x_d - x_g) * drag - damping.d33 * r
    surge = port("surge_force", ahead + m22 * v_mass * r - damping.d11 * u)
    sway = port("sway_force", across - m11 * u * r - drag)
    yaw = port("yaw_moment", about - (m22 - m11) * u * v_mass)
    yawing = yaw / i33
    surging, swaying = surge / m11, sway / m22 - x_g * yawing
    return rates_of(s, port, surging, swaying, yawing)
