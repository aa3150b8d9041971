"""Read fields of ROS bags (ROS 2 in SQLite and MCAP, ROS 1), by topic and path.

The unpacked size of a bag's chunks is counted first, for its reader unpacks each at once.
"""

from __future__ import annotations

import math
import re
import struct
import sys
from array import array
from bz2 import BZ2File
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.extras import extra
from diffthrust._support.names import listing
from diffthrust.logs._kinds import BAG_1, MCAP, kind_of
from diffthrust.logs._robots.messages import (
    LONGEST,
    Gathered,
    RobotContents,
    absent,
    column_place,
    split_column,
)
from diffthrust.logs._untrusted import MemoryBudget, damaged

_STEP = re.compile(r"(\w+)|\[(\d+)\]|(\.)")
_ANGLES = ("yaw", "heading")
_NUMBERS = (bool, int, float, np.number, np.bool_)
_ARRAYS = (np.ndarray, list, tuple)
_SKIPPED = ("header", "stamp", "layout")

Steps = tuple[str | int, ...]
"""The names and indices that lead to a field: of ``a.b[2]`` a, b and 2."""

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


class _Topic:
    """Some fields of a topic: their numbers, one of each message, and the way to them in it."""

    def __init__(
        self, file: str, name: str, fields: Mapping[str, str], units: Mapping[str, str]
    ) -> None:
        self.file = file
        self.gathered = Gathered(name, array("q"), {key: array("d") for key in fields}, units)
        self.steps = [_steps(file, key, field) for key, field in fields.items()]
        self.checked: set[type] = set()

    def add(self, message: Any, stamp: int, strict: bool) -> None:
        """Take the numbers of a message; an element that it lacks is missing if not ``strict``."""
        # First: a stamp beyond 63 bits is refused here, and must not leave its numbers behind.
        self.gathered.ticks.append(stamp)
        # What is no number is none in any message of its type, up to the lengths of arrays.
        checked = not strict or type(message) in self.checked
        self.checked.add(type(message))
        for (key, values), steps in zip(self.gathered.values.items(), self.steps, strict=True):
            if not checked:
                _check_number(self.file, key, message, steps)
            try:
                values.append(_number(message, steps))
            except (IndexError, AttributeError, TypeError, ValueError):
                if strict:
                    _check_number(self.file, key, message, steps)
                values.append(math.nan)


def read_bag(
    path: Path, wanted: Sequence[str] | None = None, header: bool = False
) -> RobotContents:
    """Read fields of a ROS bag by column; all numbers, and notes on what is left out, if None.

    The library builds classes from message definitions in the bag: open only bags from sources that
    you trust. Columns are such as ``"/odom.twist.twist.linear.x"`` or ``"/rpm.data[0]"``; an
    orientation (x, y, z, w) also has ``.yaw`` and ``.heading`` [rad]. With ``header`` the stamp of
    the message's header counts, where it has one, and not the recorder's.
    """
    topics = _wanted_topics(path.name, wanted or ())
    stamped: set[str] = set()
    unreadable: set[str] = set()
    notes = []
    with _opened(path) as reader:
        for name, topic in topics.items():
            if name not in reader.topics:
                column = next(iter(topic.gathered.values))
                raise absent(path.name, column, "topic", name, sorted(reader.topics))
        chosen = [c for c in reader.connections if wanted is None or c.topic in topics]
        try:
            for connection, recorded, raw in reader.messages(chosen):
                name = connection.topic
                if name in unreadable or (name in topics and not topics[name].steps):
                    continue
                try:
                    message = reader.deserialize(raw, connection.msgtype)
                except Exception as error:
                    if wanted is not None:
                        raise
                    # A type that the library cannot read costs its topic, not the bag.
                    unreadable.add(name)
                    notes.append(f"{name!r} cannot be read ({_short(error)}).")
                    continue
                if name not in topics:
                    units = dict(_numeric_fields(message))
                    topics[name] = _Topic(path.name, name, {key: key for key in units}, units)
                stamp = _header_stamp(message) if header else None
                if stamp is not None:
                    stamped.add(name)
                moment = int(recorded) if stamp is None else stamp
                topics[name].add(message, moment, strict=wanted is not None)
        except Exception as error:
            if wanted is not None or not topics:
                raise
            # keep what was read up to the damage
            notes.append(f"the file is damaged; it was read up to the damage ({_short(error)}).")
    if header and not stamped:
        raise InputError(
            f"{path.name}: expected a header with a time stamp in the messages, found none.",
            "leave stamps at 'recorder'.",
        )
    for name in set(topics) - stamped if header else ():
        topics[name].gathered.note = "no header, so the recorder's stamps are taken"
    if empty := sorted(name for name, topic in topics.items() if not topic.steps):
        notes.append(f"left out, as they hold no numbers: {listing(empty, 8)}.")
    return RobotContents([topic.gathered for topic in topics.values()], notes)


def _wanted_topics(file: str, wanted: Sequence[str]) -> dict[str, _Topic]:
    fields: dict[str, dict[str, str]] = {}
    for column in wanted:
        topic, field = split_column(file, column)
        fields.setdefault(topic, {})[column] = field
    return {name: _Topic(file, name, columns, {}) for name, columns in fields.items()}


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a bag with its reader."""
    with extra("ros", f"{path.name}: reading this kind of log"):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    # Bags before ROS 2 Iron hold no message definitions; the library's own of this distribution
    # serve.
    store = Stores.ROS1_NOETIC if path.suffix.lower() == ".bag" else Stores.LATEST
    try:
        _check_unpacked(path)
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
            problem = f"expected names, dots and [numbers] in the field, found {field[position]!r}."
            mend = "write it as 'twist.twist.linear.x' or 'data[0]'."
            raise InputError.at(column_place(file, column), problem, mend)
        if not match[3]:
            steps.append(match[1] or int(match[2]))
        position = match.end()
    return tuple(steps)


def _number(message: Any, steps: Steps) -> float:
    """The number of a message to which the steps lead."""
    for step in steps:
        if isinstance(step, int):
            message = message[step]
        else:
            message = _angle(step, message) if step in _ANGLES else getattr(message, step)
    # float() takes the text "7", of another type of messages on a topic of numbers
    if not isinstance(message, _NUMBERS):
        raise TypeError
    return float(message)


def _check_number(file: str, column: str, message: Any, steps: Steps) -> None:
    """Raise InputError unless the steps lead to a number of a message."""
    place, value = column_place(file, column), message
    for step in steps:
        names = getattr(value, "__dataclass_fields__", ())
        is_field = isinstance(step, str) and step in names and not step.startswith("__")
        if isinstance(step, int) and isinstance(value, _ARRAYS):
            if step >= len(value):
                raise InputError.at(
                    place,
                    f"expected an element [{step}], found {len(value)} elements in a message; "
                    "they are counted from 0.",
                    "choose one that every message has.",
                )
            value = value[step]
        elif is_field or (step in _ANGLES and set("xyzw") <= set(names)):
            value = _angle(step, value) if step in _ANGLES else getattr(value, str(step))
        else:
            text = "".join(f"[{s}]" if isinstance(s, int) else f".{s}" for s in steps)
            paths = [name for name, _ in _numeric_fields(message)]
            raise absent(file, column, "field", text.removeprefix("."), paths)
    if isinstance(value, _NUMBERS):
        return
    mend = "choose a field of numbers."
    if isinstance(value, _ARRAYS):
        description, mend = f"an array of {len(value)}", "append the element, such as [0]."
    elif is_dataclass(value):
        description, inner = "a message", next((name for name, _ in _numeric_fields(value)), "")
        mend = f"name one of its fields, such as {inner!r}."
    else:
        description = f"{type(value).__name__} {str(value)[:40]!r}"
    raise InputError.at(place, f"expected a number, found {description}.", mend)


def _angle(word: str, value: Any) -> Any:
    """A field of this name, or else the yaw of an orientation [rad], or its heading.

    By ROS conventions (REP 103) x is east and y is north; yaw runs from east to north, heading from
    north to east. A quaternion of zeros was never set, hence is missing.
    """
    if hasattr(value, word):
        return getattr(value, word)
    w, x, y, z = (float(getattr(value, axis)) for axis in "wxyz")
    if w == x == y == z == 0.0:
        return math.nan
    yaw = math.atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return yaw if word == "yaw" else math.pi / 2 - yaw


def _header_stamp(message: Any) -> int | None:
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        return None
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:80]


def _numeric_fields(
    value: Any, path: str = "", unit: str = "", depth: int = 6
) -> Iterator[tuple[str, str]]:
    """The numbers of a message, and their units."""
    if is_dataclass(value) and depth:
        units = _UNITS.get(getattr(value, "__msgtype__", ""), {})
        names = [f.name for f in fields(value) if not f.name.startswith("__")]
        dot = f"{path}." if path else ""
        # A quaternion: its components jump and mean little as channels, so its angles are listed as
        # well.
        if set(names) == set("xyzw"):
            yield from ((f"{dot}{angle}", "rad") for angle in _ANGLES)
            unit = ""
        for name in names:
            # Bookkeeping, and 36 entries of covariance per pose, of which a model uses none.
            if name not in _SKIPPED and "covariance" not in name:
                inner = getattr(value, name), dot + name, units.get(name, unit)
                yield from _numeric_fields(*inner, depth - 1)
    elif isinstance(value, _ARRAYS) and len(value) <= LONGEST:
        for k, element in enumerate(value):
            if isinstance(element, _NUMBERS):
                yield f"{path}[{k}]", unit
    elif isinstance(value, _NUMBERS):
        yield path, unit


_CHUNK_MCAP, _CHUNK_1 = 0x06, 0x05
_PIECE = 2**20
"""Bytes that are unpacked at a time."""
_DENSE = 50
"""No real log packs better than this ratio; whatever exceeds it counts against the limit."""

Chunk = tuple[str, BinaryIO, int]
"""Its compression, a stream at its first byte, and its length."""


def _check_unpacked(path: Path) -> None:
    """Raise InputError if a bag, a file or a folder, does not fit in memory once unpacked.

    A chunk counts, and the excess of implausibly dense chunks together.
    """
    budget = MemoryBudget(path)
    for packing, stream, length in _chunks(path):
        unpacker, size = _unpacker(packing), 0
        if unpacker is None:
            continue
        if length > budget.remaining:
            budget.take(length)
        for piece in _pieces(unpacker, stream.read(length)):
            size += piece
            if size > budget.remaining:
                budget.take(size)
        # Only the implausible excess adds up over chunks: a long bag may well be larger than the
        # limit, for its reader unpacks one chunk at a time.
        budget.take(max(0, size - _DENSE * length))


def _chunks(path: Path) -> Iterator[Chunk]:
    for file in sorted(path.iterdir()) if path.is_dir() else [path]:
        if not file.is_file():
            continue
        with file.open("rb") as stream:
            end = file.stat().st_size
            if file.suffix == ".zstd":
                yield "zstd", stream, end
            elif stream.read(8) == MCAP.begins[0]:
                yield from _mcap_chunks(stream, end)
            elif kind_of(file) is BAG_1:
                yield from _bag_1_chunks(stream, end)


def _mcap_chunks(stream: BinaryIO, end: int) -> Iterator[Chunk]:
    with suppress(struct.error):  # at the end, or cut off, which its reader reports
        while True:
            kind, length = struct.unpack("<BQ", stream.read(9))
            stop = stream.tell() + length
            if kind == _CHUNK_MCAP:
                # Start and end time, size and checksum, then the length of the compression's name.
                (words,) = struct.unpack_from("<I", stream.read(32), 28)
                packing = stream.read(min(words, 16)).decode("latin-1")
                (packed,) = struct.unpack("<Q", stream.read(8))
                yield packing, stream, min(packed, end - stream.tell())
            if stop > end:
                return
            stream.seek(stop)


def _bag_1_chunks(stream: BinaryIO, end: int) -> Iterator[Chunk]:
    stream.seek(len("#ROSBAG V2.0\n"))
    while (at := stream.tell()) + 4 <= end:
        size = struct.unpack("<I", stream.read(4))[0]
        if at + 8 + size > end:
            return
        header, fields, place = stream.read(size), {}, 0
        while place + 4 <= size:
            length = struct.unpack_from("<I", header, place)[0]
            name, _, value = header[place + 4 : place + 4 + length].partition(b"=")
            fields[name] = value
            place += 4 + length
        length = struct.unpack("<I", stream.read(4))[0]
        begin = stream.tell()
        if fields.get(b"op") == bytes([_CHUNK_1]):
            packing = fields.get(b"compression", b"").decode("latin-1")
            yield packing, stream, min(length, end - begin)
        stream.seek(begin + length)


def _pieces(unpacker: Callable[[BinaryIO], BinaryIO], packed: bytes) -> Iterator[int]:
    """Unpack a chunk, of any number of frames; yields the size of each piece."""
    try:
        with unpacker(BytesIO(packed)) as unpacked:
            while piece := unpacked.read(_PIECE):
                yield len(piece)
    except Exception:  # damaged: its reader reports it
        return


def _unpacker(packing: str) -> Any:
    """What opens a packed file, of the libraries that rosbags needs; None if there is none."""
    if packing == "bz2":
        return BZ2File
    if packing == "lz4":
        from lz4.frame import LZ4FrameFile

        return LZ4FrameFile
    if packing == "zstd":
        built_in = sys.version_info >= (3, 14)  # part of the standard library since then
        return import_module("compression.zstd" if built_in else "backports.zstd").ZstdFile
    return None
