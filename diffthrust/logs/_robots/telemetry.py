"""Iterate over the messages of ArduPilot's telemetry logs (.tlog)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from diffthrust.logs._robots.dataflash import LATEST


@dataclass(frozen=True)
class Received:
    """One message.

    Args:
        stamp: its time stamp [ns].
        name: kind of message.
        source: system and component that sent it.
        instance: the instance, such as the number of a motor; empty if there is only one.
        fields: names of its fields.
        get: returns the value of a field.
        units: units of fields defined by MAVLink.
    """

    stamp: int
    name: str
    source: tuple[int, ...]
    instance: str
    fields: Sequence[str]
    get: Callable[[str], Any]
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Recording:
    """An open file.

    Args:
        message_names: the kinds of messages in it.
        messages: the requested messages, in the file's order.
        damages: what could not be read, and where; complete once all messages were read.
    """

    message_names: set[str]
    messages: Iterator[Received]
    damages: list[str] = field(default_factory=list)


@contextmanager
def telemetry(path: Path, names: set[str] | None) -> Iterator[Recording]:
    """Open a telemetry log: frames of MAVLink 1 and 2, each preceded by its time of reception [us].

    Only messages of the names are read; all if None.

    Raises:
        ValueError: it holds no such frame.
    """
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    data = path.read_bytes()
    kinds: Any = dialect.mavlink_map
    damages: list[str] = []
    frames = [frame for frame in _frames(data, damages) if frame[1] in kinds]
    if not frames:
        raise ValueError("no MAVLink message with a time stamp before it")
    decoder: Any = dialect.MAVLink(None)

    def messages() -> Iterator[Received]:
        for stamp, number, begin, end in frames:
            name = kinds[number].msgname
            if names is not None and name not in names:
                continue
            try:
                message = decoder.decode(bytearray(data[begin:end]))
            except dialect.MAVError as error:
                damages.append(f"at byte {begin}: {error}")
                continue
            source = (message.get_srcSystem(), message.get_srcComponent())
            which = message.instance_field
            instance = "" if which is None else str(getattr(message, which))
            get = partial(getattr, message)
            units = message.fieldunits_by_name
            yield Received(stamp * 1_000, name, source, instance, message.fieldnames, get, units)

    yield Recording({kinds[number].msgname for _, number, _, _ in frames}, messages(), damages)


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
        if stamp > LATEST:
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
