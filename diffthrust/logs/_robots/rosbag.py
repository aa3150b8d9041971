"""Fields of ROS bags (ROS 2 in SQLite and MCAP, ROS 1), by topic and path."""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.logs._robots.packed import check_unpacked
from diffthrust.logs._robots.series import (
    Series,
    column_place,
    lacking,
    no_field,
    no_message,
    series_of,
    split_column,
)
from diffthrust.logs._tables.table import damaged

_STEP = re.compile(r"(\w+)|\[(\d+)\]|(\.)")
Steps = tuple[str | int, ...]


def read_bag(
    path: Path, wanted: Sequence[str], header: bool, missing: Sequence[float]
) -> dict[str, Series]:
    """Read fields of a ROS bag.

    The library builds classes from the message definitions that the bag holds: open bags of those
    whom you trust.

    Args:
        path: the folder of a bag, or a file ending in .mcap, .db3 or, of ROS 1, .bag.
        wanted: columns such as ``"/odom.twist.twist.linear.x"`` or ``"/rpm.data[0]"``; of an
            orientation (x, y, z, w) also ``.yaw`` and ``.heading`` [rad].
        header: take the stamp of the message's header where it has one, not the recorder's.
        missing: numbers that mean missing.

    Returns:
        The samples of each column.

    Raises:
        InputError: rosbags is not installed, the bag is damaged, or a topic or field is absent or
            holds no numbers.
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
                raise no_message(path.name, columns[0][0], topic, reader.topics, "topic")
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
    """Open a bag with its reader.

    Raises:
        InputError: rosbags is not installed, or the bag takes more memory than a log may; or, also
            while it is read, it is damaged.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise lacking(path.name, "rosbags", "ros", error) from None
    store = Stores.ROS1_NOETIC if path.suffix.lower() == ".bag" else Stores.LATEST
    try:
        check_unpacked(path)
        with AnyReader([path], default_typestore=get_typestore(store)) as reader:
            yield reader
    except InputError:
        raise
    except Exception as error:  # a damaged bag raises whatever the reader came across
        # A recorder was switched off. The library has one exception for all defects of a file, and
        # only its words tell these; where they change, the message below is told instead.
        for words, tool in (
            ("end magic", "`mcap recover FILE -o NEW`, a tool of the MCAP project,"),
            ("not indexed", "`rosbag reindex FILE`, a tool of ROS 1,"),
        ):
            if words in str(error):
                raise InputError(
                    f"{path.name}: expected a whole recording, found one that was cut off "
                    f"({error}).",
                    f"{tool} saves what was written.",
                ) from None
        raise damaged(path, "ROS bag", error) from None


def _steps(file: str, column: str, field: str) -> Steps:
    """Take ``a.b[2].c`` apart."""
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
        known = getattr(value, "__dataclass_fields__", ())
        if isinstance(step, str) and step in known and not step.startswith("__"):
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
        elif step in ("yaw", "heading") and all(axis in known for axis in "xyzw"):
            value = angle_of(value, str(step))
        else:
            raise no_field(file, column, _written(steps), _leaves(message))
    if isinstance(value, bool | int | float | np.number | np.bool_):
        return float(value)
    if isinstance(value, np.ndarray | list | tuple):
        found, mend = f"an array of {len(value)}", "write the element, such as [0], behind it."
    elif is_dataclass(value):
        found, mend = "a message", f"name one of its fields, such as {next(_leaves(value), '')!r}."
    else:
        found, mend = f"{type(value).__name__} {str(value)[:40]!r}", "choose a field of numbers."
    raise InputError.at(column_place(file, column), f"expected a number, found {found}.", mend)


def angle_of(quaternion: Any, word: str) -> float:
    """The yaw of an orientation [rad], or the heading, as ROS counts them (REP 103).

    There x is east and y is north, and yaw runs from east to north; a heading runs from north to
    east. An orientation of zeros is one that was never set, hence missing.
    """
    w, x, y, z = (float(getattr(quaternion, axis)) for axis in "wxyz")
    if w == x == y == z == 0.0:
        return math.nan
    yaw = math.atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return yaw if word == "yaw" else math.pi / 2 - yaw


def _leaves(value: Any, prefix: str = "", depth: int = 5) -> Iterator[str]:
    """The paths that lead to numbers, for messages; of an array the first element."""
    if is_dataclass(value) and depth:
        for f in fields(value):
            dot = "." if prefix else ""
            yield from _leaves(getattr(value, f.name), f"{prefix}{dot}{f.name}", depth - 1)
    elif isinstance(value, np.ndarray | list | tuple):
        if len(value):
            yield from _leaves(value[0], f"{prefix}[0]", depth)
    elif isinstance(value, bool | int | float | np.number | np.bool_):
        yield prefix


def _written(steps: Steps) -> str:
    text = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in steps)
    return text.removeprefix(".")


def _header_stamp(message: Any) -> int | None:
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        return None
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)
