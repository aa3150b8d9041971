"""Fields of ArduPilot's logs: DataFlash (.bin) and telemetry (.tlog), by message and field."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.logs._robots.ardupilot_files import Received, telemetry
from diffthrust.logs._robots.dataflash import (
    Dataflash,
    instance_of,
    open_dataflash,
    stamps,
    values_of,
)
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

# SYSTEM/COMPONENT/MESSAGE[INSTANCE], all but the message left out where there is one only
_MESSAGE = re.compile(r"(?:(\d+)/)?(?:(\d+)/)?(\w+)(?:\[(\w+)\])?")
_ELEMENT = re.compile(r"(\w+)(?:\[(\d+)\])?")


@dataclass
class _Target:
    """A column that is wanted, and what was found of it."""

    column: str
    source: tuple[int, ...]
    name: str
    instance: str
    key: str
    element: int | None
    ticks: list[int] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    seen: set[tuple[tuple[int, ...], str]] = field(default_factory=set)
    others: set[str] = field(default_factory=set)


def read_ardupilot(
    path: Path, binary: bool, wanted: Sequence[str], missing: Sequence[float]
) -> dict[str, Series]:
    """Read fields of a DataFlash or telemetry log.

    Stamps of a DataFlash log are ``TimeUS`` (``TimeMS`` in old ones), the autopilot's time since it
    was switched on. Those of a telemetry log are the moments at which the ground station received
    the message: they jitter with the link.

    Args:
        path: the file.
        binary: it is a DataFlash log, not a telemetry log.
        wanted: columns such as ``"RCOU.C1"``, ``"ESC[0].RPM"``, ``"SERVO_OUTPUT_RAW.servo1_raw"``,
            or ``"1/ATTITUDE.yaw"`` where several systems send a message.
        missing: numbers that mean missing.

    Returns:
        The samples of each column.

    Raises:
        InputError: the file is damaged, pymavlink is not installed (telemetry needs it), or a
            message or field is absent, is no number, or comes from several senders or instances.
    """
    targets = [_target(path.name, column) for column in wanted]
    try:
        if binary:
            log = open_dataflash(path)
            for target in targets:
                _check_known(path.name, target, set(log.messages))
                _take_all(path.name, target, log)
            damages = log.damages
        else:
            with telemetry(path, {target.name for target in targets}) as recording:
                for target in targets:
                    _check_known(path.name, target, recording.known)
                for message in recording.messages:
                    for target in targets:
                        if target.name == message.name:
                            _take(path.name, target, message)
            damages = recording.damages
    except ImportError as error:
        raise lacking(path.name, "pymavlink", "ardupilot", error) from None
    except InputError:
        raise
    except Exception as error:  # a damaged log raises whatever the reader came across
        raise damaged(path, "DataFlash" if binary else "telemetry", error) from None
    for target in targets:
        _check_alone(path.name, target)
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
    source = tuple(int(number) for number in sent.groups()[:2] if number is not None)
    element = None if of[2] is None else int(of[2])
    return _Target(column, source, sent[3], sent[4] or "", of[1], element)


def _take(file: str, target: _Target, message: Received) -> None:
    if target.source != message.source[: len(target.source)]:
        return
    if target.instance and target.instance != message.instance:
        target.others.add(message.instance)
        return
    if target.key not in message.fields:
        raise no_field(file, target.column, target.key, message.fields)
    target.ticks.append(message.stamp)
    target.values.append(_number(file, target, message.get(target.key)))
    target.seen.add((message.source, message.instance))


def _take_all(file: str, target: _Target, log: Dataflash) -> None:
    """Take a field of all messages of a DataFlash log at once."""
    message = log.messages[target.name]
    records = log.records(message)
    ticks = stamps(records)
    if ticks is None:
        raise InputError(
            f"{file}: the message {target.name!r} has no time stamp.",
            "choose a message with a field TimeUS.",
        )
    if lost := int((ticks < 0).sum()):
        log.damages.append(f"{lost} messages {target.name!r} with a time stamp that cannot be")
    records, ticks = records[ticks >= 0], ticks[ticks >= 0]
    instances = [""]
    if message.instance:
        which = np.array([instance_of(value) for value in records[message.instance]], dtype=str)
        instances = sorted(set(which.tolist()))
        if target.instance:
            keep = which == target.instance
            target.others.update(set(instances) - {target.instance})
            records, ticks, instances = records[keep], ticks[keep], [target.instance]
    if not ticks.size or (target.instance and not message.instance) or target.source:
        return
    if target.key not in message.columns:
        raise no_field(file, target.column, target.key, message.columns)
    values = values_of(message, records, target.key)
    first = instance_of(values[0]) if values.dtype.kind == "S" else values[0].tolist()
    _number(file, target, first)
    target.ticks = ticks.tolist()
    target.values = (values if target.element is None else values[:, target.element]).tolist()
    target.seen.update(((), instance) for instance in instances)


def _number(file: str, target: _Target, value: Any) -> float:
    """A field's value, or its element, as a number; raises InputError where it is none."""
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
        found = f"an array of {len(value)}" if array else repr(str(value)[:40])
        raise InputError.at(
            place,
            f"expected a number, found {found}.",
            "write the element, such as [0], behind it." if array else "choose a field of numbers.",
        )
    return float(value)


def _check_known(file: str, target: _Target, known: set[str]) -> None:
    if not known:
        raise ValueError("it holds no message")
    if target.name not in known:
        raise no_message(file, target.column, target.name, known, "message")


def _check_alone(file: str, target: _Target) -> None:
    """Raise InputError where a column mixes what several have sent, or holds nothing."""
    place = column_place(file, target.column)
    field_name = target.column.partition(".")[2]
    if not target.ticks:
        others = sorted(target.others)
        found = f"the instances {listing(others)}" if others else "none from that sender"
        raise InputError.at(
            place,
            f"expected messages {target.name!r} as named, found {found}.",
            "correct the number before the message or in the brackets.",
        )
    sources = sorted({source for source, _ in target.seen})
    if len(sources) > 1:
        senders = listing("/".join(map(str, source)) for source in sources)
        name = "/".join(map(str, sources[0]))
        raise InputError.at(
            place,
            f"{target.name!r} is sent by several (system/component): {senders}.",
            f"name one, such as {f'{name}/{target.name}.{field_name}'!r}.",
        )
    instances = sorted({instance for _, instance in target.seen})
    if len(instances) > 1:
        raise InputError.at(
            place,
            f"the log has several {target.name!r}: {listing(instances)}.",
            f"name one, such as {f'{target.name}[{instances[0]}].{field_name}'!r}.",
        )
