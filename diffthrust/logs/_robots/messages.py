"""The messages of a robot's log: all of their fields, or those that are wanted."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust.logs._field import Field
from diffthrust.logs._robots.series import (
    Series,
    absent,
    column_place,
    series_of,
    split_column,
)

LONGEST = 16
"""Longer arrays are pictures, spectra or scans: their elements are not channels."""

# SYSTEM/COMPONENT/MESSAGE[INSTANCE]; only the message is mandatory
_MESSAGE = re.compile(r"(?:(\d+)/)?(?:(\d+)/)?(\w+)(?:\[(\w+)\])?")
_ELEMENT = re.compile(r"(.+)\[(\d+)\]")


@dataclass
class Gathered:
    """The messages of one kind from one sender.

    Args:
        name: name in `Column`, such as ``"/odom"`` or ``"ESC"``.
        ticks: time stamps [ns], a list or an array of integers; None where they have none.
        values: by field, one per message: numbers ``(n,)``, arrays ``(n, k)`` or texts.
        units: units of fields stated in the file.
        source: numbers of the system and component that sent it; empty if there is only one.
        instance: such as the number of a motor; empty if there is only one.
    """

    name: str
    ticks: Any = field(default_factory=list)
    values: dict[str, Any] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    source: tuple[int, ...] = ()
    instance: str = ""


class RobotContents(NamedTuple):
    """The messages read, notes on damage, settings of an autopilot, names of all messages."""

    gathered: list[Gathered]
    notes: list[str]
    parameters: Mapping[str, float] = {}
    names: Collection[str] = ()


Reader = Callable[[Path, Collection[str] | None], RobotContents]
"""Reads the messages of some names, or everything that may be a signal."""


def damage_notes(damages: Sequence[str]) -> list[str]:
    """A sentence on bytes that could not be read, with the first place."""
    if not damages:
        return []
    places = f"{len(damages)} place{'s' if len(damages) > 1 else ''}"
    return [f"the file is damaged in {places} ({damages[0]})."]


def fields_of(gathered: Iterable[Gathered]) -> tuple[tuple[Field, ...], list[str]]:
    """The fields of all messages, by time from the first on, and notes on clocks that step back."""
    groups = [g for g in gathered if g.ticks is not None and len(g.ticks) and g.values]
    if not groups:
        return (), []
    stamps = [np.asarray(g.ticks, dtype=np.int64) for g in groups]
    origin = min(int(ticks.min()) for ticks in stamps)
    fields, notes = [], []
    for messages, ticks in zip(groups, stamps, strict=True):
        name, time = _full_name(messages, groups), (ticks - origin) / 1e9
        back = np.diff(time)
        order: slice | np.ndarray = slice(None)
        if back.size and back.min() < 0:
            order = np.argsort(ticks, kind="stable")
            # Messages of parallel tasks arrive out of order by milliseconds, which sorting mends; a
            # step of more than a second is a restart or a corrected clock.
            if back.min() < -1.0:
                where = time[int(np.argmin(back))]
                notes.append(
                    f"the clock of {name!r} steps back by {-back.min():.3g} s after {where:.6g} s: "
                    "the recording should be split there."
                )
        time = time[order]
        for key, values in _numbers(messages.values):
            numbers = values.astype(np.float64)[order]
            # Drivers publish infinity for "no echo": a log takes only missing samples.
            numbers[~np.isfinite(numbers)] = np.nan
            unit = messages.units.get(key) or messages.units.get(key.partition("[")[0], "")
            fields.append(Field(f"{name}.{key}", numbers, time, unit))
    return tuple(fields), notes


def _full_name(messages: Gathered, groups: Iterable[Gathered]) -> str:
    """``1/1/ATTITUDE`` if several systems send it, ``ESC[0]`` if there are several instances."""
    same = [g for g in groups if g.name == messages.name]
    name = messages.name
    if sum(g.source == messages.source for g in same) > 1:
        name += f"[{messages.instance}]"
    if len({g.source for g in same}) > 1:
        name = "/".join(map(str, (*messages.source, name)))
    return name


def _numbers(values: Mapping[str, Any]) -> Iterator[tuple[str, np.ndarray]]:
    """The fields with numbers, of short arrays the elements."""
    for key, held in values.items():
        array, match = np.asarray(held), _ELEMENT.fullmatch(key)
        long = match is not None and f"{match[1]}[{LONGEST}]" in values
        if array.dtype.kind not in "biuf" or long:
            continue
        if array.ndim == 1:
            yield key, array
        elif array.shape[1] <= LONGEST:
            yield from ((f"{key}[{k}]", array[:, k]) for k in range(array.shape[1]))


def wanted_series(
    path: Path, read: Reader, wanted: Sequence[str], missing: Sequence[float]
) -> dict[str, Series]:
    """The samples of each wanted field of an autopilot's log; ``missing`` numbers mean missing.

    Columns are such as ``"RCOU.C1"``, ``"ESC[0].RPM"``, ``"actuator_outputs.output[0]"``, or
    ``"1/ATTITUDE.yaw"`` if several systems send a message.
    """
    targets = {column: _parsed(path.name, column) for column in wanted}
    contents = read(path, {sent[3] for sent, _ in targets.values()})
    chosen = {c: _messages(path.name, c, sent, contents) for c, (sent, _) in targets.items()}
    origin = min(int(messages.ticks[0]) for messages in chosen.values())
    series = {}
    for column, messages in chosen.items():
        values = _values(path.name, column, messages.values, targets[column][1])
        series[column] = series_of(path.name, column, messages.ticks, values, origin, missing)
    first, notes = series[wanted[0]], (note.removesuffix(".") for note in contents.notes)
    return {**series, wanted[0]: replace(first, notes=(*first.notes, *notes))}


def _parsed(file: str, column: str) -> tuple[re.Match[str], str]:
    """The message of a column, split into its parts, and the field."""
    message, key = split_column(file, column)
    sent = _MESSAGE.fullmatch(message)
    if sent is None:
        raise InputError.at(
            column_place(file, column),
            "expected a message and one of its fields.",
            "write it as 'RCOU.C1', 'ESC[0].RPM', '1/ATTITUDE.yaw' or "
            "'esc_status[1].esc[0].esc_rpm'.",
        )
    return sent, key


def _messages(file: str, column: str, sent: re.Match[str], contents: RobotContents) -> Gathered:
    """The messages that a column names, which must be of one sender and one instance."""
    place, name, instance = column_place(file, column), sent[3], sent[4]
    if name not in contents.names:
        raise absent(file, column, "message", name, sorted(contents.names))
    # Fewer numbers match more senders: "1/ATTITUDE" takes every component of system 1.
    source = tuple(int(number) for number in sent.groups()[:2] if number is not None)
    groups = [g for g in contents.gathered if g.name == name and g.source[: len(source)] == source]
    named = [g for g in groups if instance in (None, g.instance)]
    if not named:
        rejected = sorted(g.instance for g in groups if g.instance)
        description = f"the instances {listing(rejected)}" if rejected else "none from that sender"
        raise InputError.at(
            place,
            f"expected messages {name!r} as named, found {description}.",
            "correct the number in front of the message or in the brackets.",
        )
    field_name = column.partition(".")[2]
    sources = sorted({g.source for g in named})
    if len(sources) > 1:
        senders = ["/".join(map(str, source)) for source in sources]
        raise InputError.at(
            place,
            f"{name!r} is sent by several (system/component): {listing(senders)}.",
            f"name one, such as {f'{senders[0]}/{name}.{field_name}'!r}.",
        )
    if len(named) > 1:
        instances = sorted(g.instance for g in named)
        raise InputError.at(
            place,
            f"the log has several {name!r}: {listing(instances)}.",
            f"name one, such as {f'{name}[{instances[0]}].{field_name}'!r}.",
        )
    if named[0].ticks is None:
        raise InputError(
            f"{file}: the message {name!r} has no time stamp.",
            "choose a message with a field TimeUS.",
        )
    return named[0]


def _values(file: str, column: str, fields: Mapping[str, Any], key: str) -> np.ndarray:
    """The numbers of a field, or of an element of it."""
    place, match = column_place(file, column), _ELEMENT.fullmatch(key)
    of_element = match is not None and key not in fields
    base = match[1] if match and of_element else key
    if base not in fields:
        raise absent(file, column, "field", key, fields)
    values = np.asarray(fields[base])
    first = values[0].decode("latin-1") if isinstance(values[0], bytes) else values[0]
    if match and of_element:
        if values.ndim < 2 or int(match[2]) >= values.shape[1]:
            raise InputError.at(
                place,
                f"expected an element [{match[2]}], found {str(first)[:40]!r}.",
                "name a field that is an array; its elements are counted from 0.",
            )
        values = values[:, int(match[2])]
    if values.ndim > 1:
        raise InputError.at(
            place,
            f"expected a number, found an array of {values.shape[1]}.",
            "append the element, such as [0].",
        )
    if values.dtype.kind not in "biuf":
        raise InputError.at(
            place,
            f"expected a number, found {str(first)[:40]!r}.",
            "choose a field of numbers.",
        )
    return values
