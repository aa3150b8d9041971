"""Read ArduPilot's DataFlash logs (.bin), all messages of a kind at once.

The format is self-describing: each message has two marker bytes, the number of its kind and a body
of fixed length, and messages `FMT` list the fields of a kind. One pass finds where messages begin;
the bodies of a kind are then one array of records. This takes 0.5 s for a million messages, where
pymavlink, reading one at a time, takes a minute.
Source: ArduPilot's libraries/AP_Logger (LogStructure.h, README.md).
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from diffthrust.logs._robots.messages import Gathered, RobotContents, damage_notes
from diffthrust.logs._units import unit_in
from diffthrust.logs._untrusted import reading

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
LATEST = 2**53

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
            sound = records[name] <= LATEST * 1_000 // tick
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
