"""Read logs of autopilots by libraries: ArduPilot's telemetry (.tlog), PX4's ULog (.ulg)."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust._support.extras import extra
from diffthrust.logs._robots.dataflash import LATEST
from diffthrust.logs._robots.messages import Gathered, RobotContents, damage_notes
from diffthrust.logs._units import unit_in
from diffthrust.logs._untrusted import damaged, reading


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
