"""Small real logs of robots, written by the libraries that read them."""

import struct
from pathlib import Path

import numpy as np

START = 1_700_000_000_000_000_000  # ns


def write_bag(folder: Path, topics, storage="sqlite3", name="bag"):
    """Write a ROS 2 bag.

    Args:
        folder: where the bag's folder goes.
        topics: by topic, the type of its messages and pairs of stamp [s] and message; a message is
            a function of the types. Pairs of topic and these where a topic has several types.
        storage: ``"sqlite3"`` or ``"mcap"``.
        name: name of the bag.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    with Writer(folder / name, version=9, storage_plugin=plugin) as writer:
        _write_topics(writer, topics, store, store.serialize_cdr)
    return folder / name


def _write_topics(writer, topics, store, serialized):
    for topic, (kind, messages) in topics.items() if isinstance(topics, dict) else topics:
        connection = writer.add_connection(topic, kind, typestore=store)
        for stamp, message in messages:
            raw = serialized(message(store.types), kind)
            writer.write(connection, START + round(stamp * 1e9), raw)


def number(value):
    return lambda types: types["std_msgs/msg/Float64"](data=float(value))


def numbers(values):
    def make(types):
        layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        data = np.array(values, dtype=np.float64)
        return types["std_msgs/msg/Float64MultiArray"](layout=layout, data=data)

    return make


def twist(forward, stamp, yaw_rate=0.0, **of_the_header):
    def make(types):
        seconds, rest = divmod(START + round(stamp * 1e9), 10**9)
        time = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest)
        header = types["std_msgs/msg/Header"](stamp=time, frame_id="base", **of_the_header)
        body = plain_twist(forward, 0.0, yaw_rate)(types)
        return types["geometry_msgs/msg/TwistStamped"](header=header, twist=body)

    return make


def plain_twist(forward, sideways, yaw_rate):
    def make(types):
        vector = types["geometry_msgs/msg/Vector3"]
        return types["geometry_msgs/msg/Twist"](
            linear=vector(x=float(forward), y=float(sideways), z=0.0),
            angular=vector(x=0.0, y=0.0, z=float(yaw_rate)),
        )

    return make


def orientation(yaw, length=1.0):
    """An orientation that is turned by yaw [rad] about the vertical axis, nothing else."""

    def make(types):
        half = yaw / 2
        z, w = length * float(np.sin(half)), length * float(np.cos(half))
        return types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=z, w=w)

    return make


# the letters of DataFlash, as its format message explains them
_CODES = {
    **dict.fromkeys("Q", "Q"), **dict.fromkeys("q", "q"), **dict.fromkeys("iLe", "i"),
    **dict.fromkeys("IE", "I"), **dict.fromkeys("hc", "h"), **dict.fromkeys("HC", "H"),
    **dict.fromkeys("BM", "B"), "b": "b", "g": "e", "f": "f", "d": "d",
    "a": "64s", "n": "4s", "N": "16s", "Z": "64s",
}  # fmt: skip


def write_dataflash(path: Path, formats, rows, instances=None):
    """Write a DataFlash log: the formats of its messages first, then the messages.

    Args:
        path: a file ending in .bin.
        formats: by message, its letters and its fields.
        rows: pairs of message and values, in order.
        instances: by message, the field that tells one sender from another.
    """
    numbers = {name: 129 + index for index, name in enumerate(formats)}

    def format_message(number, name, letters, columns):
        length = 3 + struct.calcsize("<" + "".join(_CODES[c] for c in letters))
        return struct.pack(
            "<BBBBB4s16s64s", 0xA3, 0x95, 0x80, number, length,
            name.encode(), letters.encode(), ",".join(columns).encode(),
        )  # fmt: skip

    out = struct.pack(
        "<BBBBB4s16s64s", 0xA3, 0x95, 0x80, 0x80, 89, b"FMT", b"BBnNZ",
        b"Type,Length,Name,Format,Columns",
    )  # fmt: skip
    for name, (letters, columns) in formats.items():
        out += format_message(numbers[name], name, letters, columns)
    if instances:
        out += format_message(120, "FMTU", "QBNN", ["TimeUS", "FmtType", "UnitIds", "MultIds"])
        for name, which in instances.items():
            units = "".join("#" if c == which else "-" for c in formats[name][1]).encode()
            plain = b"-" * len(units)
            out += struct.pack("<BBBQB16s16s", 0xA3, 0x95, 120, 0, numbers[name], units, plain)
    for name, values in rows:
        codes = "<" + "".join(_CODES[c] for c in formats[name][0])
        packed = [v.encode() if isinstance(v, str) else v for v in values]
        out += struct.pack("<BBB", 0xA3, 0x95, numbers[name]) + struct.pack(codes, *packed)
    path.write_bytes(out)
    return path


def write_telemetry(path: Path, messages):
    """Write a telemetry log: before each frame eight bytes, the microsecond of its reception.

    Args:
        path: a file ending in .tlog.
        messages: triples of stamp [s], system, and a message as a function of the dialect.
    """
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    out = b""
    for stamp, system, message in messages:
        sender = dialect.MAVLink(None, srcSystem=system, srcComponent=1)
        out += struct.pack(">Q", START // 1000 + round(stamp * 1e6))
        out += message(dialect).pack(sender)
    path.write_bytes(out)
    return path


def attitude(yaw, boot=0):
    return lambda d: d.MAVLink_attitude_message(boot, 0.0, 0.0, yaw, 0.0, 0.0, 0.0)


def servos(first):
    return lambda d: d.MAVLink_servo_output_raw_message(0, 0, first, *[1500] * 7)


def parameter(name, value):
    """A setting, as ArduPilot tells it to a ground station."""
    return lambda d: d.MAVLink_param_value_message(name.encode(), value, 9, 1, 0)


def dataflash_parameters(values):
    """The format of parameters in a DataFlash log, and their messages."""
    rows = [("PARM", (1000 * k, name, value)) for k, (name, value) in enumerate(values.items())]
    return {"PARM": ("QNf", ["TimeUS", "Name", "Value"])}, rows


def write_bag_1(path: Path, topics):
    """Write a ROS 1 bag; the topics as for `write_bag`, but with types and stamps of ROS 1."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer(path) as writer:
        _write_topics(writer, topics, store, store.serialize_ros1)
    return path


def twist_1(forward, stamp):
    """A TwistStamped of ROS 1, whose header counts messages."""
    return twist(forward, stamp, seq=0)


_ULOG = {"uint64_t": "Q", "uint32_t": "I", "uint16_t": "H", "uint8_t": "B", "int32_t": "i",
         "float": "f", "double": "d", "bool": "?"}  # fmt: skip


def write_ulog(path: Path, formats, subscriptions, rows, dropouts=(), parameters=None):
    """Write a PX4 log, as "ULog File Format" of the PX4 guide has it.

    Args:
        path: a file ending in .ulg.
        formats: by message, pairs of type and field; ``timestamp`` [us] first. A type is one of C,
            an array such as ``float[2]``, or another message.
        subscriptions: pairs of message and instance.
        rows: pairs of the number of a subscription and flat values, in order.
        dropouts: lengths of time [ms] in which the recorder lost messages.
        parameters: settings by name; those that are integers are written as such.
    """

    def message(kind, content):
        return struct.pack("<HB", len(content), ord(kind)) + content

    def codes(name):
        out = ""
        for kind, _ in formats[name]:
            base, _, count = kind.rstrip("]").partition("[")
            one = codes(base) if base in formats else _ULOG[base]
            out += one * int(count or 1)
        return out

    out = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)
    out += message("B", bytes(40))
    for name, fields in formats.items():
        text = f"{name}:" + "".join(f"{kind} {field};" for kind, field in fields)
        out += message("F", text.encode())
    for name, value in (parameters or {}).items():
        code, kind = ("<i", "int32_t") if isinstance(value, int) else ("<f", "float")
        key = f"{kind} {name}".encode()
        out += message("P", struct.pack("<B", len(key)) + key + struct.pack(code, value))
    for number_, (name, instance) in enumerate(subscriptions):
        out += message("A", struct.pack("<BH", instance, number_) + name.encode())
    for number_, values in rows:
        packed = struct.pack("<" + codes(subscriptions[number_][0]), *values)
        out += message("D", struct.pack("<H", number_) + packed)
    for lost in dropouts:
        out += message("O", struct.pack("<H", lost))
    path.write_bytes(out)
    return path
