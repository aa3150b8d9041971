"""Read fields of ArduPilot's logs: DataFlash (.bin) and telemetry (.tlog)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.logs._robots.dataflash import (
    Dataflash,
    Message,
    instance_of,
    open_dataflash,
    stamps,
    values_of,
)
from diffthrust.logs._robots.gathered import LONGEST, Gathered, RobotContents
from diffthrust.logs._robots.series import (
    Series,
    column_place,
    lacking,
    no_field,
    no_message,
    series_of,
    split_column,
)
from diffthrust.logs._robots.telemetry import Received, telemetry
from diffthrust.logs._tables.table import damaged
from diffthrust.logs._units import unit_in

# SYSTEM/COMPONENT/MESSAGE[INSTANCE]; only the message is mandatory
_MESSAGE = re.compile(r"(?:(\d+)/)?(?:(\d+)/)?(\w+)(?:\[(\w+)\])?")
_ELEMENT = re.compile(r"(\w+)(?:\[(\d+)\])?")


@dataclass
class _Target:
    """A wanted column and its samples so far."""

    column: str
    source: tuple[int, ...]
    name: str
    instance: str
    key: str
    element: int | None
    ticks: list[int] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    senders: set[tuple[tuple[int, ...], str]] = field(default_factory=set)
    rejected: set[str] = field(default_factory=set)


def read_ardupilot(
    path: Path, binary: bool, wanted: Sequence[str], missing: Sequence[float]
) -> dict[str, Series]:
    """Read fields of a DataFlash (``binary``) or telemetry log, the samples of each column.

    Time stamps of a DataFlash log are ``TimeUS`` (``TimeMS`` in old logs), the autopilot's time
    since power-up. Those of a telemetry log are the times of reception at the ground station, which
    jitter with the link. Columns are such as ``"RCOU.C1"``, ``"ESC[0].RPM"``, or
    ``"1/ATTITUDE.yaw"`` if several systems send a message.
    """
    targets = [_target(path.name, column) for column in wanted]
    try:
        if binary:
            log = open_dataflash(path)
            for target in targets:
                _check_present(path.name, target, set(log.messages))
                _take_all(path.name, target, log)
            damages = log.damages
        else:
            with telemetry(path, {target.name for target in targets}) as recording:
                for target in targets:
                    _check_present(path.name, target, recording.message_names)
                for message in recording.messages:
                    for target in targets:
                        if target.name == message.name:
                            _take(path.name, target, message)
            damages = recording.damages
    except ImportError as error:
        raise lacking(path.name, "pymavlink", "ardupilot", error) from None
    except InputError:
        raise
    except Exception as error:  # a damaged log raises exceptions of any kind
        raise damaged(path, "DataFlash" if binary else "telemetry", error) from None
    for target in targets:
        _check_unambiguous(path.name, target)
    origin = min(target.ticks[0] for target in targets)
    series = {
        t.column: series_of(path.name, t.column, t.ticks, t.values, origin, missing)
        for t in targets
    }
    if damages:
        first = series[wanted[0]]
        places = f"{len(damages)} place{'s' if len(damages) > 1 else ''}"
        note = f"the file is damaged in {places} ({damages[0]})"
        series[wanted[0]] = replace(first, notes=(*first.notes, note))
    return series


def _target(file: str, column: str) -> _Target:
    message, key = split_column(file, column)
    sent, of = _MESSAGE.fullmatch(message), _ELEMENT.fullmatch(key)
    if not sent or not of:
        raise InputError.at(
            column_place(file, column),
            "expected a message and one of its fields.",
            "write it as 'RCOU.C1', 'ESC[0].RPM', 'ESC_STATUS.rpm[0]' or '1/ATTITUDE.yaw'.",
        )
    # Fewer numbers match more senders: "1/ATTITUDE" takes every component of system 1.
    source = tuple(int(number) for number in sent.groups()[:2] if number is not None)
    element = None if of[2] is None else int(of[2])
    return _Target(column, source, sent[3], sent[4] or "", of[1], element)


def _take(file: str, target: _Target, message: Received) -> None:
    if target.source != message.source[: len(target.source)]:
        return
    if target.instance and target.instance != message.instance:
        target.rejected.add(message.instance)
        return
    if target.key not in message.fields:
        raise no_field(file, target.column, target.key, message.fields)
    target.ticks.append(message.stamp)
    target.values.append(_number(file, target, message.get(target.key)))
    target.senders.add((message.source, message.instance))


def _take_all(file: str, target: _Target, log: Dataflash) -> None:
    """Read a field of all messages of a DataFlash log at once."""
    message = log.messages[target.name]
    records = log.records(message)
    ticks = stamps(records)
    if ticks is None:
        raise InputError(
            f"{file}: the message {target.name!r} has no time stamp.",
            "choose a message with a field TimeUS.",
        )
    if lost := int((ticks < 0).sum()):
        log.damages.append(f"{lost} messages {target.name!r} with an impossible time stamp")
    records, ticks = records[ticks >= 0], ticks[ticks >= 0]
    instances = [""]
    if message.instance:
        which = np.array([instance_of(value) for value in records[message.instance]], dtype=str)
        instances = sorted(set(which.tolist()))
        if target.instance:
            keep = which == target.instance
            target.rejected.update(set(instances) - {target.instance})
            records, ticks, instances = records[keep], ticks[keep], [target.instance]
    if not ticks.size or (target.instance and not message.instance) or target.source:
        return
    if target.key not in message.columns:
        raise no_field(file, target.column, target.key, message.columns)
    values = values_of(message, records, target.key)
    # The first sample stands for all, since a DataFlash field has one type: text and whole arrays
    # are refused with it.
    first = instance_of(values[0]) if values.dtype.kind == "S" else values[0].tolist()
    _number(file, target, first)
    target.ticks = ticks.tolist()
    target.values = (values if target.element is None else values[:, target.element]).tolist()
    target.senders.update(((), instance) for instance in instances)


def _number(file: str, target: _Target, value: Any) -> float:
    """A field's value, or its element, as a number; raises InputError if it is not one."""
    place = column_place(file, target.column)
    if target.element is not None:
        if isinstance(value, str) or not hasattr(value, "__len__") or target.element >= len(value):
            raise InputError.at(
                place,
                f"expected an element [{target.element}], found {str(value)[:40]!r}.",
                "name a field that is an array; its elements are counted from 0.",
            )
        value = value[target.element]
    if not isinstance(value, bool | int | float):
        array = not isinstance(value, str) and hasattr(value, "__len__")
        description = f"an array of {len(value)}" if array else repr(str(value)[:40])
        raise InputError.at(
            place,
            f"expected a number, found {description}.",
            "append the element, such as [0]." if array else "choose a field of numbers.",
        )
    return float(value)


def _check_present(file: str, target: _Target, names: set[str]) -> None:
    if not names:
        raise ValueError("it holds no message")
    if target.name not in names:
        raise no_message(file, target.column, target.name, names, "message")


def _check_unambiguous(file: str, target: _Target) -> None:
    """Raise InputError if a column mixes several senders or instances, or is empty."""
    place = column_place(file, target.column)
    field_name = target.column.partition(".")[2]
    if not target.ticks:
        rejected = sorted(target.rejected)
        description = f"the instances {listing(rejected)}" if rejected else "none from that sender"
        raise InputError.at(
            place,
            f"expected messages {target.name!r} as named, found {description}.",
            "correct the number in front of the message or in the brackets.",
        )
    sources = sorted({source for source, _ in target.senders})
    if len(sources) > 1:
        senders = listing("/".join(map(str, source)) for source in sources)
        name = "/".join(map(str, sources[0]))
        raise InputError.at(
            place,
            f"{target.name!r} is sent by several (system/component): {senders}.",
            f"name one, such as {f'{name}/{target.name}.{field_name}'!r}.",
        )
    instances = sorted({instance for _, instance in target.senders})
    if len(instances) > 1:
        raise InputError.at(
            place,
            f"the log has several {target.name!r}: {listing(instances)}.",
            f"name one, such as {f'{target.name}[{instances[0]}].{field_name}'!r}.",
        )


# Messages that describe the log or hold settings: no signals.
_METADATA = {
    "FMT",
    "FMTU",
    "UNIT",
    "MULT",
    "PARM",
    "FILE",
    "MSG",
    "CMD",
    "PARAM_VALUE",
    "STATUSTEXT",
}


def dataflash_fields(path: Path) -> RobotContents:
    """Read all numbers of a DataFlash log; of several instances the messages are ``ESC[0]``, ..."""
    gathered = []
    try:
        log = open_dataflash(path)
        for message in log.messages.values():
            if message.name not in _METADATA:
                gathered += _messages(message, log)
        parameters = _parameters(log)
    except Exception as error:  # a damaged log raises exceptions of any kind
        raise damaged(path, "DataFlash", error) from None
    return RobotContents(gathered, _damage_notes(log.damages), parameters)


def _parameters(log: Dataflash) -> dict[str, float]:
    """The settings that a log begins with, and those that were changed while it was written."""
    message = log.messages.get("PARM")
    if message is None or not {"Name", "Value"} <= set(message.columns):
        return {}
    rows = log.records(message)
    values = rows["Value"].astype(np.float64).tolist()
    return dict(zip(map(instance_of, rows["Name"].tolist()), values, strict=True))


def _messages(message: Message, log: Dataflash) -> list[Gathered]:
    """The messages of one kind, split by instance if there are several."""
    try:
        records = log.records(message)
    except ValueError as error:  # one invalid format does not spoil the log
        log.damages.append(str(error))
        return []
    ticks = stamps(records)
    if ticks is None or not ticks.size:
        return []
    records, ticks = records[ticks >= 0], ticks[ticks >= 0]
    about = {"TimeUS", "TimeMS", message.instance}
    fields = {
        name: values
        for name in message.columns
        if name not in about and (values := values_of(message, records, name)).dtype.kind == "f"
    }
    fields = {name: values for name, values in fields.items() if values.ndim == 1}
    which = records[message.instance] if message.instance else np.zeros(records.size, np.uint8)
    keys = np.unique(which)
    out = []
    for key in keys:
        selected = which == key
        name = message.name if len(keys) == 1 else f"{message.name}[{instance_of(key)}]"
        columns = {field: values[selected] for field, values in fields.items()}
        out.append(Gathered(name, ticks[selected], columns, message.units))
    return out


def telemetry_fields(path: Path) -> RobotContents:
    """Read all numbers of a telemetry log, with the parameters that the vehicle has told.

    Messages are named ``1/1/ATTITUDE`` if several systems send them, and ``ESC[0]`` if they have
    several instances.
    """
    gathered: dict[tuple[str, tuple[int, ...], str], Gathered] = {}
    parameters: dict[str, float] = {}
    try:
        with telemetry(path, None) as recording:
            for message in recording.messages:
                if message.name == "PARAM_VALUE":
                    parameters[str(message.get("param_id"))] = float(message.get("param_value"))
                if message.name in _METADATA:
                    continue
                key = (message.name, message.source, message.instance)
                group = gathered.setdefault(key, Gathered(message.name))
                values = {}
                for field in message.fields:
                    value = message.get(field)
                    if isinstance(value, int | float):
                        values[field] = value
                    # A name that MAVLink lists as an array becomes one column per element.
                    elif isinstance(value, list | tuple) and len(value) <= LONGEST:
                        values |= {f"{field}[{k}]": v for k, v in enumerate(value)}
                # The first message fixes the columns, so that all have one value per message.
                if not group.values:
                    group.values.update({name: [] for name in values})
                    units = {n: message.units.get(n.split("[")[0], "") for n in values}
                    group.units = {n: unit_in(f"[{unit}]") for n, unit in units.items() if unit}
                group.ticks.append(message.stamp)
                for name, held in group.values.items():
                    held.append(values.get(name, np.nan))
            damages = list(recording.damages)
    except ImportError as error:
        raise lacking(path.name, "pymavlink", "ardupilot", error) from None
    except Exception as error:  # a damaged log raises exceptions of any kind
        raise damaged(path, "telemetry", error) from None
    for (name, source, instance), group in gathered.items():
        senders = {of for kind, of, _ in gathered if kind == name}
        instances = {which for kind, of, which in gathered if kind == name and of == source}
        if len(instances) > 1:
            group.name += f"[{instance}]"
        if len(senders) > 1:
            group.name = "/".join(map(str, source)) + f"/{group.name}"
    return RobotContents(list(gathered.values()), _damage_notes(damages), parameters)


def _damage_notes(damages: list[str]) -> list[str]:
    if not damages:
        return []
    places = f"{len(damages)} place{'s' if len(damages) > 1 else ''}"
    return [f"the file is damaged in {places} ({damages[0]})."]
