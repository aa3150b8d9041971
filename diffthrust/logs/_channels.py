"""The standard channel names, with the unit that each has inside the library."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True)
class Channel:
    """A standard channel of a log: its name, the unit of its samples here, and what it is."""

    name: str
    unit: str
    description: str


_ALL = (
    Channel("command", "V", "command to the motor controller"),
    Channel("speed", "rad/s", "speed of rotation of the propeller shaft"),
    Channel("thrust", "N", "force of the propeller along its axis"),
    Channel("inflow", "m/s", "speed of the water that reaches the propeller"),
    Channel("flow", "m/s", "speed of the water that leaves the duct"),
    Channel("supply_voltage", "V", "voltage of the supply or the battery"),
    Channel("torque", "N m", "torque on the propeller shaft"),
    Channel("current", "A", "current through the motor"),
    Channel("propeller_speed", "rev/s", "propeller speed of a vessel"),
    Channel("rudder_angle", "rad", "angle of the rudder or of a steerable propeller"),
    Channel("left_force", "N", "force of the left (port) thruster"),
    Channel("right_force", "N", "force of the right (starboard) thruster"),
    Channel("wind_speed", "m/s", "speed of the wind"),
    Channel("wind_direction", "rad", "direction of the wind"),
    Channel("surge", "m/s", "forward speed of the vessel"),
    Channel("sway", "m/s", "speed of the vessel to starboard"),
    Channel("yaw_rate", "rad/s", "rate of turn of the vessel, positive to starboard"),
    Channel("north", "m", "position to the north"),
    Channel("east", "m", "position to the east"),
    Channel("heading", "rad", "heading of the vessel, positive clockwise from north"),
    Channel("position", "m", "position along one axis"),
    Channel("velocity", "m/s", "speed along one axis"),
)

CHANNELS: Mapping[str, Channel] = MappingProxyType({channel.name: channel for channel in _ALL})
"""The standard channels by name. A user's own model may have other channels."""
