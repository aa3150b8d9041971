"""Read logs of autopilots: ArduPilot's DataFlash (.bin) and telemetry (.tlog), PX4's ULog (.ulg).

The last two are read by libraries. DataFlash is self-describing: each message has two marker bytes,
the number of its kind and a body of fixed length, and messages `FMT` list the fields of a kind. One
pass finds where messages begin; the bodies of a kind are then one array of records. This takes 0.5
s for a million messages, where pymavlink, reading one at a time, takes a minute.
Source: ArduPilot's libraries/AP_Logger (LogStructure.h, README.md).
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust._support.extras import extra
from diffthrust.logs._robots.messages import Gathered, RobotContents, damage_notes
from diffthrust.logs._units import unit_in
from diffthrust.logs._untrusted import damaged, reading

_MARKS = (0xA3, 0x95)
_FMT = 0x80
_FMT_BODY = struct.Struct("<BB4s16s64s")

# The letters of a format: type in a record, and divisor of the numbers.
_LETTERS = {
    "a": ("(32,)<i2", 1), "b": ("i1", 1), "B": ("u1", 1), "h": ("<i2", 1), "H": ("<u2", 1),
    "i": ("<i4", 1), "I": ("<u4", 1), "q": ("<i8", 1), "Q": ("<u8", 1), "g": ("<f2", 1),
    "f": ("<f4", 1), "d": ("<f8", 1), "n": ("S4", 1), "N": ("S16", 1), "Z": ("S64", 1),
    "c": ("<i2", 100), "C": ("<u2", 100), "e": ("<i4", 100), "E": ("<u4", 100),
    "L": ("<i4", 10**7), "M": ("u1", 1),
}  # fmt: skip
_PREFIXES = {1.0: "", 1e-1: "d", 1e-2: "c", 1e-3: "m", 1e-6: "u", 1e-9: "n"}

# Time stamps beyond this are damaged, whether counted from the start or from 1970 [us].
_LATEST = 2**53

# The logger pads pages of its memory after the last message; up to a page is no damage.
_PAGE = 528


@dataclass
class Message:
    """The messages of one kind: letter and name of each field, and offsets of the bodies.

    ``instance`` is the field that identifies the sender, if there is one.
    """

    name: str
    letters: str
    columns: Sequence[str]
    offsets: list[int] = field(default_factory=list)
    instance: str = ""
    units: dict[str, str] = field(default_factory=dict)

    @property
    def record(self) -> np.dtype:
        """The type of a body; ValueError if the format is invalid."""
        if len(self.letters) != len(self.columns) or not set(self.letters) <= set(_LETTERS):
            raise ValueError(f"the message {self.name!r} has the format {self.letters!r}")
        kinds = (_LETTERS[letter][0] for letter in self.letters)
        return np.dtype(list(zip(self.columns, kinds, strict=True)))


@dataclass(frozen=True)
class Dataflash:
    """An indexed log: its bytes, the kinds of messages that occur by name, and damages."""

    data: np.ndarray
    messages: dict[str, Message]
    damages: list[str]

    def records(self, message: Message) -> np.ndarray:
        """The bodies of a kind as an array of records, in the order of the file."""
        record = message.record
        offsets = np.array(message.offsets, dtype=np.int64)
        offsets = offsets[offsets + record.itemsize <= self.data.size]
        bodies = self.data[offsets[:, None] + np.arange(record.itemsize)]
        return np.ascontiguousarray(bodies).view(record).reshape(-1)


def read_dataflash(path: Path, names: Collection[str] | None) -> RobotContents:
    """Read the messages of some names, or all that may be signals.

    Time stamps are ``TimeUS`` (``TimeMS`` in old logs), the autopilot's time since power-up.
    """
    gathered: list[Gathered] = []
    with reading(path, "DataFlash"):
        log = _indexed(path)
        for message in log.messages.values():
            if message.name in names if names is not None else message.name not in _METADATA:
                gathered += _gathered(message, log, named=names is not None)
        parameters = _parameters(log)
    return RobotContents(gathered, damage_notes(log.damages), parameters, log.messages)


# Messages that describe the log or hold settings: no signals.
_METADATA = {"FMT", "FMTU", "UNIT", "MULT", "PARM", "FILE", "MSG", "CMD"}


def _gathered(message: Message, log: Dataflash, *, named: bool) -> Iterator[Gathered]:
    """The messages of one kind, for each instance."""
    try:
        records = log.records(message)
    except ValueError as error:  # one invalid format does not spoil the log
        if named:
            raise
        log.damages.append(str(error))
        return
    ticks = _stamps(records)
    if ticks is None:
        yield Gathered(message.name, None)
        return
    if lost := int((ticks < 0).sum()):
        log.damages.append(f"{lost} messages {message.name!r} with an impossible time stamp")
    records, ticks = records[ticks >= 0], ticks[ticks >= 0]
    about = {"TimeUS", "TimeMS", message.instance}
    columns = [name for name in message.columns if name not in about]
    which = records[message.instance] if message.instance else np.zeros(records.size, np.uint8)
    for key in np.unique(which):
        rows = records[which == key]
        values = {name: _values_of(message, rows, name) for name in columns}
        instance = _text(key.item()) if message.instance else ""
        yield Gathered(message.name, ticks[which == key], values, message.units, (), instance)


def _values_of(message: Message, records: np.ndarray, column: str) -> np.ndarray:
    """A field as numbers, ``(n,)``, or ``(n, 32)`` for an array; text as bytes."""
    values = records[column]
    if values.dtype.kind == "S":
        return values
    divisor = _LETTERS[message.letters[list(message.columns).index(column)]][1]
    return values.astype(np.float64) / divisor


def _parameters(log: Dataflash) -> dict[str, float]:
    """The settings that a log begins with, and those that were changed while it was written."""
    message = log.messages.get("PARM")
    if message is None or not {"Name", "Value"} <= set(message.columns):
        return {}
    rows = log.records(message)
    values = rows["Value"].astype(np.float64).tolist()
    return dict(zip(map(_text, rows["Name"].tolist()), values, strict=True))


def _text(value: bytes | int) -> str:
    """A name, or the number of an instance, as text."""
    return value.rstrip(b"\0").decode("latin-1") if isinstance(value, bytes) else str(value)


def _stamps(records: np.ndarray) -> np.ndarray | None:
    """The time stamps [ns], ``(n,)``, -1 if impossible; None if there is no such field."""
    names = records.dtype.names or ()
    for name, tick in (("TimeUS", 1_000), ("TimeMS", 1_000_000)):
        if name in names and records[name].dtype.kind in "iu":
            # 2^53 us is year 2255: a larger stamp is damage, and would overflow int64 once in
            # nanoseconds.
            sound = records[name] <= _LATEST * 1_000 // tick
            return np.where(sound, records[name], 0).astype(np.int64) * tick - ~sound
    return None


def _indexed(path: Path) -> Dataflash:
    """Index the messages of a log; ValueError if it holds none."""
    data = path.read_bytes()
    kinds = {_FMT: Message("FMT", "BBnNZ", ["Type", "Length", "Name", "Format", "Columns"])}
    lengths = [0] * 256
    lengths[_FMT] = 3 + _FMT_BODY.size
    starts: list[list[int]] = [[] for _ in range(256)]
    damages: list[tuple[int, int]] = []
    at, end, lost = 0, len(data), -1
    while at + 3 <= end:
        length = lengths[data[at + 2]]
        # Damage (a flash page lost as power failed) is skipped byte by byte until the next marks
        # and a kind that some FMT has described.
        if data[at] != _MARKS[0] or data[at + 1] != _MARKS[1] or not length:
            lost = at if lost < 0 else lost
            at += 1
            continue
        if at + length > end:
            break
        if lost >= 0:
            damages.append((lost, at))
            lost = -1
        number = data[at + 2]
        starts[number].append(at + 3)
        if number == _FMT:
            kind, size, *texts = _FMT_BODY.unpack_from(data, at + 3)
            name, letters, columns = (t.split(b"\0")[0].decode("latin-1") for t in texts)
            message = Message(name, letters, columns.split(",") if columns else [])
            sound = message.columns and len(set(message.columns)) == len(message.columns)
            if size > 3 and sound:
                # The first description of a kind counts. The logger writes it again after each
                # restart, and what reads as another length for the same number is damage.
                kinds.setdefault(kind, message)
                lengths[kind] = lengths[kind] or size
        at += length
    if at < end or lost >= 0:
        damages.append((at if lost < 0 else lost, end))
    for number, message in kinds.items():
        message.offsets = starts[number]
    by_name = {m.name: m for m in kinds.values() if m.offsets}
    if not set(by_name) - {"FMT"}:
        raise ValueError("it holds no message")
    log = Dataflash(np.frombuffer(data, np.uint8), by_name, [])
    log.damages.extend(
        f"at byte {begin}: {stop - begin} bytes are no message"
        for begin, stop in damages
        if stop < end or stop - begin >= _PAGE  # padding at the end is no damage
    )
    _read_units(log, kinds)
    return log


def _read_units(log: Dataflash, kinds: dict[int, Message]) -> None:
    """Read units and instance fields from the messages that describe the log."""

    def table(name: str, key: str, value: str) -> dict[str, object]:
        if name not in log.messages or not {key, value} <= set(log.messages[name].columns):
            return {}
        rows = log.records(log.messages[name])
        return {chr(int(k) % 256): v for k, v in zip(rows[key], rows[value], strict=True)}

    try:
        units, factors = table("UNIT", "Id", "Label"), table("MULT", "Id", "Mult")
        unit_rows = log.records(log.messages["FMTU"]) if "FMTU" in log.messages else ()
        for row in unit_rows:
            message = kinds.get(int(row["FmtType"]))
            if message is None:
                continue
            letters = row["UnitIds"].decode("latin-1")
            powers = row["MultIds"].decode("latin-1").ljust(len(letters))
            for column, unit, power in zip(message.columns, letters, powers, strict=False):
                # ArduPilot marks the field of the instance by the unit "#" (older logs have none).
                if unit == "#":
                    message.instance = column
                label = units.get(unit)
                if not isinstance(label, bytes) or not label:
                    continue
                factor = factors.get(power, 1.0)
                divisor = _LETTERS.get(message.letters[message.columns.index(column)], ("", 1))[1]
                # MULT is the factor to SI of the number in the file. Letters with a divisor (c, C,
                # e, E, L) are divided in `values_of` already: their factor must not count twice.
                prefix = "" if divisor != 1 else _PREFIXES.get(float(f"{factor:.6g}") or 1.0)
                text = label.decode("latin-1").replace("degheading", "deg")
                if prefix is not None and (recognized := unit_in(f"[{prefix}{text}]")):
                    message.units[column] = recognized
    except (ValueError, IndexError, KeyError, TypeError):  # the describing messages are damaged
        log.damages.append("the units of its fields cannot be read")


def read_telemetry(path: Path, names: Collection[str] | None) -> RobotContents:
    """Read the messages of some names, or all that may be signals.

    Frames of MAVLink 1 and 2 are each preceded by their time of reception at the ground station
    [us], which jitters with the link. Parameters are those that the vehicle has told.
    """
    with extra("ardupilot", f"{path.name}: reading this kind of log"):
        from pymavlink.dialects.v20 import ardupilotmega as dialect
    kinds: Any = dialect.mavlink_map
    decoder: Any = dialect.MAVLink(None)
    groups: dict[tuple[str, tuple[int, ...], str], Gathered] = {}
    parameters: dict[str, float] = {}
    damages: list[str] = []
    with reading(path, "telemetry"):
        data = path.read_bytes()
        frames = [frame for frame in _frames(data, damages) if frame[1] in kinds]
        if not frames:
            raise ValueError("no MAVLink message with a time stamp before it")
        for stamp, number, begin, end in frames:
            name = kinds[number].msgname
            if name not in names if names is not None else name == "STATUSTEXT":
                continue
            try:
                message = decoder.decode(bytearray(data[begin:end]))
            except dialect.MAVError as error:
                damages.append(f"at byte {begin}: {error}")
                continue
            if names is None and name == "PARAM_VALUE":
                parameters[str(message.param_id)] = float(message.param_value)
                continue
            source = (message.get_srcSystem(), message.get_srcComponent())
            which = message.instance_field
            instance = "" if which is None else str(getattr(message, which))
            if (key := (name, source, instance)) not in groups:
                units = {n: unit_in(f"[{u}]") for n, u in message.fieldunits_by_name.items()}
                values = {n: [] for n in message.fieldnames}
                groups[key] = Gathered(name, [], values, units, source, instance)
            groups[key].ticks.append(stamp * 1_000)
            for n, held in groups[key].values.items():
                held.append(getattr(message, n))
    present = {kinds[number].msgname for _, number, _, _ in frames}
    return RobotContents([*groups.values()], damage_notes(damages), parameters, present)


def _frames(data: bytes, damages: list[str]) -> Iterator[tuple[int, int, int, int]]:
    """Time stamp [us], message number, begin and end of each frame; other bytes are skipped."""
    at = 0
    skipped = None
    while at + 8 + 8 <= len(data):
        begin = at + 8
        marker, length = data[begin], data[begin + 1]
        # Ground stations write the stamp big-endian, while MAVLink itself is little-endian.
        stamp = int.from_bytes(data[at:begin], "big")
        # A marker byte also occurs inside payloads: with an impossible stamp before it, it is none.
        if stamp > _LATEST:
            marker = 0
        if marker == 0xFD and begin + 10 <= len(data):
            # Header 10 and checksum 2 around the payload; a signed frame (bit 0 of its flags) has
            # 13 bytes more.
            end = begin + length + 12 + (13 if data[begin + 2] & 1 else 0)
            number = int.from_bytes(data[begin + 7 : begin + 10], "little")
        elif marker == 0xFE:
            end = begin + length + 8
            # MAVLink 1: header 6 and checksum 2, and a message number of one byte.
            number = data[begin + 5]
        else:
            skipped = at if skipped is None else skipped
            at += 1
            continue
        if end > len(data):
            break
        if skipped is not None:
            damages.append(f"at byte {skipped}: {at - skipped} bytes are no MAVLink message")
            skipped = None
        yield stamp, number, begin, end
        at = end
    if at < len(data):
        damages.append(f"at byte {at}: the last message is cut off")


def read_ulog(path: Path, names: Collection[str] | None) -> RobotContents:
    """Read the messages of some names, or all; time stamps count from the autopilot's power-up."""
    # pyulog parses only the named messages: a flight log has many more.
    log = _load(path, names)
    present = {data.name for data in log.data_list}
    if names is not None and not set(names) <= present:  # for the message, which lists all
        present = {data.name for data in _load(path, None).data_list}
    gathered = []
    for data in log.data_list:
        values = {key: values for key, values in data.data.items() if key != "timestamp"}
        ticks = data.data["timestamp"].astype(np.int64) * 1_000
        gathered.append(Gathered(data.name, ticks, values, instance=str(data.multi_id)))
    # those that were changed while it recorded: stamp, name, value
    changed = {name: value for _, name, value in log.changed_parameters}
    parameters = {n: float(v) for n, v in {**log.initial_parameters, **changed}.items()}
    return RobotContents(gathered, _damages(log), parameters, present)


def _load(path: Path, names: Collection[str] | None) -> Any:
    with extra("px4", f"{path.name}: reading this kind of log"):
        from pyulog import ULog
    printed = StringIO()
    # pyulog prints what it skips, and given a path it leaves a damaged file open.
    silent = redirect_stdout(printed), redirect_stderr(printed)
    with reading(path, "ULog"), path.open("rb") as stream, silent[0], silent[1]:
        log = ULog(stream, None if names is None else list(names))
    # PX4 subscribes to topics that then never publish.
    log.data_list[:] = [d for d in log.data_list if len(d.data.get("timestamp", ()))]
    if names is None and not log.data_list:
        raise damaged(path, "ULog", ValueError("it holds no message"))
    return log


def _damages(log: Any) -> list[str]:
    notes = []
    if log.file_corruption:
        notes.append("the file is damaged; what could be read is used.")
    if log.dropouts:
        total = sum(d.duration for d in log.dropouts) / 1e3
        notes.append(f"the recorder lost messages {len(log.dropouts)} times, {total:.3g} s in all.")
    return notes
