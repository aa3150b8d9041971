"""Read fields of ROS bags (ROS 2 in SQLite and MCAP, ROS 1), by topic and path."""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.logs._robots.messages import LONGEST, Gathered, RobotContents
from diffthrust.logs._robots.packed import check_unpacked
from diffthrust.logs._robots.series import (
    Series,
    absent,
    column_place,
    lacking,
    series_of,
    split_column,
)
from diffthrust.logs._tables.table import damaged

_STEP = re.compile(r"(\w+)|\[(\d+)\]|(\.)")
Steps = tuple[str | int, ...]


def read_bag(
    path: Path, wanted: Sequence[str], header: bool, missing: Sequence[float]
) -> dict[str, Series]:
    """Read fields of a ROS bag, the samples of each column.

    The library builds classes from message definitions in the bag: open only bags from sources that
    you trust. Columns are such as ``"/odom.twist.twist.linear.x"`` or ``"/rpm.data[0]"``; an
    orientation (x, y, z, w) also has ``.yaw`` and ``.heading`` [rad]. With ``header`` the stamp of
    the message's header counts, where it has one, and not the recorder's.
    """
    targets: dict[str, list[tuple[str, Steps]]] = {}
    for column in wanted:
        topic, field = split_column(path.name, column)
        targets.setdefault(topic, []).append((column, _steps(path.name, column, field)))
    ticks = {column: array("q") for column in wanted}
    values = {column: array("d") for column in wanted}
    stamped: dict[str, bool] = {}
    with opened(path) as reader:
        for topic, columns in targets.items():
            if topic not in reader.topics:
                raise absent(path.name, columns[0][0], "topic", topic, sorted(reader.topics))
        chosen = [c for c in reader.connections if c.topic in targets]
        for connection, recorded, raw in reader.messages(chosen):
            message = reader.deserialize(raw, connection.msgtype)
            stamp = _header_stamp(message) if header else None
            stamped[connection.topic] = stamp is not None
            for column, steps in targets[connection.topic]:
                values[column].append(_number(path.name, column, message, steps))
                ticks[column].append(int(recorded) if stamp is None else stamp)
    if header and not any(stamped.values()):
        raise InputError(
            f"{path.name}: expected a header with a time stamp in the messages, found none.",
            "leave stamps at 'recorder'.",
        )
    origin = min((stamps[0] for stamps in ticks.values() if stamps), default=0)
    series = {c: series_of(path.name, c, ticks[c], values[c], origin, missing) for c in wanted}
    for topic, columns in targets.items() if header else ():
        if not stamped[topic]:
            note = "no header, so the recorder's stamps are taken"
            for column, _ in columns:
                series[column] = replace(series[column], notes=(*series[column].notes, note))
    return series


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """Open a bag with its reader."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise lacking(path.name, "rosbags", "ros", error) from None
    # Bags before ROS 2 Iron hold no message definitions; the library's own of this distribution
    # serve.
    store = Stores.ROS1_NOETIC if path.suffix.lower() == ".bag" else Stores.LATEST
    try:
        check_unpacked(path)
        with AnyReader([path], default_typestore=get_typestore(store)) as reader:
            yield reader
    except InputError:
        raise
    except Exception as error:  # a damaged bag raises exceptions of any kind
        # The library raises one exception for all defects; only its message identifies a recording
        # that was cut off. If its words change, the general message below is given instead.
        for words, tool in (
            ("end magic", "`mcap recover FILE -o NEW`, a tool of the MCAP project,"),
            ("not indexed", "`rosbag reindex FILE`, a tool of ROS 1,"),
        ):
            if words in str(error):
                raise InputError(
                    f"{path.name}: expected a complete recording, found one that was cut off "
                    f"({error}).",
                    f"{tool} saves what was written.",
                ) from None
        raise damaged(path, "ROS bag", error) from None


def _steps(file: str, column: str, field: str) -> Steps:
    """Split ``a.b[2].c`` into names and indices."""
    steps: list[str | int] = []
    position = 0
    while position < len(field):
        match = _STEP.match(field, position)
        if not match:
            raise InputError.at(
                column_place(file, column),
                f"expected names, dots and [numbers] in the field, found {field[position]!r}.",
                "write it as 'twist.twist.linear.x' or 'data[0]'.",
            )
        if not match[3]:
            steps.append(match[1] or int(match[2]))
        position = match.end()
    return tuple(steps)


def _number(file: str, column: str, message: Any, steps: Steps) -> float:
    value = message
    for step in steps:
        field_names = getattr(value, "__dataclass_fields__", ())
        if isinstance(step, str) and step in field_names and not step.startswith("__"):
            value = getattr(value, step)
        elif isinstance(step, int) and isinstance(value, np.ndarray | list | tuple):
            if step >= len(value):
                raise InputError.at(
                    column_place(file, column),
                    f"expected an element [{step}], found "
                    f"{len(value)} elements in a message; they are counted from 0.",
                    "choose one that every message has.",
                )
            value = value[step]
        elif step in ("yaw", "heading") and all(axis in field_names for axis in "xyzw"):
            value = angle_of(value, str(step))
        else:
            raise absent(file, column, "field", _written(steps), _paths(message))
    if isinstance(value, bool | int | float | np.number | np.bool_):
        return float(value)
    if isinstance(value, np.ndarray | list | tuple):
        description, mend = f"an array of {len(value)}", "append the element, such as [0]."
    elif is_dataclass(value):
        description, mend = (
            "a message",
            f"name one of its fields, such as {next(iter(_paths(value)), '')!r}.",
        )
    else:
        description, mend = (
            f"{type(value).__name__} {str(value)[:40]!r}",
            "choose a field of numbers.",
        )
    raise InputError.at(
        column_place(file, column), f"expected a number, found {description}.", mend
    )


def angle_of(quaternion: Any, word: str) -> float:
    """The yaw of an orientation [rad], or its heading, by ROS conventions (REP 103).

    x is east and y is north; yaw runs from east to north, heading from north to east. A quaternion
    of zeros was never set, hence is missing.
    """
    w, x, y, z = (float(getattr(quaternion, axis)) for axis in "wxyz")
    if w == x == y == z == 0.0:
        return math.nan
    yaw = math.atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return yaw if word == "yaw" else math.pi / 2 - yaw


def _written(steps: Steps) -> str:
    text = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in steps)
    return text.removeprefix(".")


def _header_stamp(message: Any) -> int | None:
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        return None
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


# Standard messages are in SI units (REP 103). Units of fields, by type of message.
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

NumericField = tuple[str, str, int | str | None, str]
"""The name of a field, the path to it, its element or angle, and its unit."""


def bag_fields(path: Path) -> RobotContents:
    """Read all numbers of all topics, with notes on what was left out."""
    topics: dict[str, Gathered] = {}
    leaves: dict[str, list[NumericField]] = {}
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
                # A type that the library cannot read costs its topic, not the bag.
                except Exception as error:
                    silent.add(topic)
                    notes.append(f"{topic!r} cannot be read ({_short(error)}).")
                    continue
                if topic not in topics:
                    leaves[topic] = list(_numeric_fields(message))
                    readers[topic] = [
                        attrgetter(at) if at else _itself for _, at, *_ in leaves[topic]
                    ]
                    units = {name: unit for name, _, _, unit in leaves[topic] if unit}
                    values = {name: array("d") for name, *_ in leaves[topic]}
                    topics[topic] = Gathered(topic, array("q"), values, units)
                    if not values:
                        silent.add(topic)
                gathered = topics[topic]
                gathered.ticks.append(int(recorded))
                for (name, _, element, _), get in zip(leaves[topic], readers[topic], strict=True):
                    gathered.values[name].append(_leaf_number(get(message), element))
        except Exception as error:  # keep what was read up to the damage
            if not topics:
                raise
            notes.append(f"the file is damaged; it was read up to the damage ({_short(error)}).")
    empty = sorted(silent & set(topics))
    if empty:
        notes.append(f"left out, as they hold no numbers: {listing(empty, 8)}.")
    return RobotContents(list(topics.values()), notes)


def _paths(message: Any) -> list[str]:
    """Paths to the numbers of a message, for errors."""
    return [name for name, *_ in _numeric_fields(message)]


def _itself(message: Any) -> Any:
    return message


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:80]


def _leaf_number(value: Any, element: int | str | None) -> float:
    if isinstance(element, str):
        return angle_of(value, element)
    if element is not None:
        return float(value[element]) if element < len(value) else np.nan
    return float(value)


def _numeric_fields(
    value: Any, path: str = "", unit: str = "", depth: int = 6
) -> Iterator[NumericField]:
    if is_dataclass(value) and depth:
        units = _UNITS.get(getattr(value, "__msgtype__", ""), {})
        names = [f.name for f in fields(value) if not f.name.startswith("__")]
        # A quaternion: its components jump and mean little as channels, so its angles are listed as
        # well.
        if set(names) == set("xyzw"):
            yield f"{path}.yaw".removeprefix("."), path, "yaw", "rad"
            yield f"{path}.heading".removeprefix("."), path, "heading", "rad"
            unit = ""
        for name in names:
            # Bookkeeping, and 36 entries of covariance per pose, of which a model uses none.
            if name in ("header", "stamp", "layout") or "covariance" in name:
                continue
            deeper = f"{path}.{name}" if path else name
            yield from _numeric_fields(
                getattr(value, name), deeper, units.get(name, unit), depth - 1
            )
    elif isinstance(value, np.ndarray | list | tuple):
        if len(value) <= LONGEST:
            for k, element in enumerate(value):
                if isinstance(element, bool | int | float | np.number | np.bool_):
                    yield f"{path}[{k}]", path, k, unit
    elif isinstance(value, bool | int | float | np.number | np.bool_):
        yield path, path, None, unit
