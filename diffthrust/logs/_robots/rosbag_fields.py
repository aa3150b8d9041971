"""All fields of the topics of a ROS bag."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust._support.names import listing
from diffthrust.logs._robots.gathered import LONGEST, Gathered
from diffthrust.logs._robots.rosbag import angle_of, opened

# REP 103 has the standard messages in SI units. By type of message: what its fields are in.
_UNITS = {
    "geometry_msgs/msg/Twist": {"linear": "m/s", "angular": "rad/s"},
    "geometry_msgs/msg/Accel": {"linear": "m/s^2", "angular": "rad/s^2"},
    "geometry_msgs/msg/Wrench": {"force": "N", "torque": "N*m"},
    "geometry_msgs/msg/Pose": {"position": "m"},
    "geometry_msgs/msg/Transform": {"translation": "m"},
    "sensor_msgs/msg/Imu": {"angular_velocity": "rad/s", "linear_acceleration": "m/s^2"},
    "sensor_msgs/msg/FluidPressure": {"fluid_pressure": "Pa"},
    "sensor_msgs/msg/Temperature": {"temperature": "degC"},
    "sensor_msgs/msg/Range": {"range": "m"},
    "sensor_msgs/msg/BatteryState": {"voltage": "V", "current": "A", "temperature": "degC"},
}

Leaf = tuple[str, str, int | str | None, str]
"""The name of a field, the path to it, its element or angle, and its unit."""


def bag_fields(path: Path) -> tuple[list[Gathered], list[str]]:
    """Read all numbers of all topics.

    Args:
        path: a bag, as for `read_bag`.

    Returns:
        The messages by topic, and sentences on what was left out.

    Raises:
        InputError: rosbags is not installed, or the bag is damaged.
    """
    topics: dict[str, Gathered] = {}
    leaves: dict[str, list[Leaf]] = {}
    readers: dict[str, list[Any]] = {}
    silent: set[str] = set()
    notes = []
    with opened(path) as reader:
        try:
            for connection, recorded, raw in reader.messages():
                topic = connection.topic
                if topic in silent:
                    continue
                try:
                    message = reader.deserialize(raw, connection.msgtype)
                except Exception as error:  # one kind that the library cannot read is not the bag
                    silent.add(topic)
                    notes.append(f"{topic!r} cannot be read ({_short(error)}).")
                    continue
                if topic not in topics:
                    leaves[topic] = list(_leaves(message))
                    readers[topic] = [
                        attrgetter(at) if at else _itself for _, at, *_ in leaves[topic]
                    ]
                    units = {name: unit for name, _, _, unit in leaves[topic] if unit}
                    values = {name: array("d") for name, *_ in leaves[topic]}
                    topics[topic] = Gathered(topic, array("q"), values, units)
                    if not values:
                        silent.add(topic)
                one = topics[topic]
                one.ticks.append(int(recorded))
                for (name, _, part, _), get in zip(leaves[topic], readers[topic], strict=True):
                    one.values[name].append(_number(get(message), part))
        except Exception as error:  # what was read before the damage is of use
            if not topics:
                raise
            notes.append(f"the file is damaged, and read up to there ({_short(error)}).")
    empty = sorted(silent & set(topics))
    if empty:
        notes.append(f"left out, as they hold no numbers: {listing(empty, 8)}.")
    return list(topics.values()), notes


def _itself(message: Any) -> Any:
    return message


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:80]


def _number(value: Any, part: int | str | None) -> float:
    if isinstance(part, str):
        return angle_of(value, part)
    if part is not None:
        return float(value[part]) if part < len(value) else np.nan
    return float(value)


def _leaves(value: Any, path: str = "", unit: str = "", depth: int = 6) -> Iterator[Leaf]:
    if is_dataclass(value) and depth:
        known = _UNITS.get(getattr(value, "__msgtype__", ""), {})
        names = [f.name for f in fields(value) if not f.name.startswith("__")]
        if set(names) == set("xyzw"):
            yield f"{path}.yaw".removeprefix("."), path, "yaw", "rad"
            yield f"{path}.heading".removeprefix("."), path, "heading", "rad"
            unit = ""
        for name in names:
            if name in ("header", "stamp", "layout") or "covariance" in name:
                continue
            deeper = f"{path}.{name}" if path else name
            yield from _leaves(getattr(value, name), deeper, known.get(name, unit), depth - 1)
    elif isinstance(value, np.ndarray | list | tuple):
        if len(value) <= LONGEST:
            for k, one in enumerate(value):
                if isinstance(one, bool | int | float | np.number | np.bool_):
                    yield f"{path}[{k}]", path, k, unit
    elif isinstance(value, bool | int | float | np.number | np.bool_):
        yield path, path, None, unit
