"""Motion in the plane, which vessels and bodies share: states, ports, and rates over ground."""

from collections.abc import Mapping

import jax.numpy as jnp

from diffthrust.models._base.effect import Ports
from diffthrust.models._base.signals import Rate, Signal, Signals

STATES: Mapping[str, str] = {
    "surge": "m/s",
    "sway": "m/s",
    "yaw_rate": "rad/s",
    "north": "m",
    "east": "m",
    "heading": "rad",
}
WATER_PORTS: Mapping[str, str] = {
    "surge_through_water": "speed through the water along x, which the forces depend on [m/s]",
    "sway_through_water": "speed through the water along y [m/s]",
}
FORCE_PORTS: Mapping[str, str] = {
    "surge_force": "force along x [N]",
    "sway_force": "force along y [N]",
    "yaw_moment": "moment about z [N m]",
    "surge_acceleration": "rate of the speed over ground along x [m/s^2]",
    "sway_acceleration": "rate of the speed over ground along y [m/s^2]",
    "yaw_acceleration": "rate of the yaw rate [rad/s^2]",
}


def through_water(s: Signals, port: Ports) -> tuple[Signal, Signal]:
    """The speeds through the water along x and y."""
    u = port("surge_through_water", s.surge)
    v = port("sway_through_water", s.sway)
    port.tell(surge_through_water=u, sway_through_water=v)
    return u, v


def rates_of(
    s: Signals, port: Ports, surging: Signal, swaying: Signal, yawing: Signal
) -> dict[str, Rate]:
    """The rates of all states from the three accelerations (Fossen 2021, equation 2.41)."""
    # a coupling of sway and yaw needs both accelerations as they are without it
    port.tell(sway_alone=swaying, yaw_alone=yawing)
    cos, sin = jnp.cos(s.heading), jnp.sin(s.heading)
    return {
        "surge": port("surge_acceleration", surging),
        "sway": port("sway_acceleration", swaying),
        "yaw_rate": port("yaw_acceleration", yawing),
        "north": s.surge * cos - s.sway * sin,
        "east": s.surge * sin + s.sway * cos,
        "heading": s.yaw_rate,
    }
