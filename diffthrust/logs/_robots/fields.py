"""The fields of robots' logs: all of them, or the samples of those that are wanted."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from diffthrust._support.errors import InputError, Place
from diffthrust._support.names import listing
from diffthrust.logs._kinds import BAG, BAG_1, DATAFLASH, MCAP, TELEMETRY, ULOG, Kind
from diffthrust.logs._robots.autopilots import read_dataflash, read_telemetry, read_ulog
from diffthrust.logs._robots.messages import (
    LONGEST,
    Gathered,
    Reader,
    RobotContents,
    absent,
    column_place,
    split_column,
)
from diffthrust.logs._robots.rosbag import read_bag
from diffthrust.logs._tables.table import Field
from diffthrust.logs._untrusted import MemoryBudget

_READERS: Mapping[Kind, Reader] = {
    DATAFLASH: read_dataflash,
    TELEMETRY: read_telemetry,
    ULOG: read_ulog,
}
_RESTART = 1.0
"""A clock that steps back by more than this [s] was restarted; smaller steps are late arrivals."""

# SYSTEM/COMPONENT/MESSAGE[INSTANCE]; only the message is mandatory
_MESSAGE = re.compile(r"(?:(\d+)/)?(?:(\d+)/)?(\w+)(?:\[(\w+)\])?")
_ELEMENT = re.compile(r"(.+)\[(\d+)\]")


@dataclass(frozen=True)
class Series:
    """The samples of one field, message by message.

    Args:
        place: file and field, for messages.
        time: time stamps [s], strictly increasing, shape (n,).
        values: numbers as the file has them, shape (n,).
        notes: sentences on what was left out.
        driving: it is an input.
        held: it keeps its last value between messages.
    """

    place: Place | str
    time: np.ndarray
    values: np.ndarray
    notes: tuple[str, ...] = ()
    driving: bool = False
    held: bool = False

    @property
    def period(self) -> float:
        """Median time between messages [s]; infinite for a single message."""
        return float(np.median(np.diff(self.time))) if self.time.size > 1 else float("inf")


def all_fields(path: Path, kind: Kind) -> tuple[list[Field], list[str], Mapping[str, float]]:
    """All numbers of a robot's log, notes on what is damaged or left out, and its parameters."""
    _check_file(path, kind)
    contents = _READERS[kind](path, None) if kind in _READERS else read_bag(path)
    groups = [g for g in contents.gathered if g.ticks is not None and len(g.ticks) and g.values]
    stamps = [np.asarray(g.ticks, dtype=np.int64) for g in groups]
    origin = min((int(ticks.min()) for ticks in stamps), default=0)
    fields: list[Field] = []
    notes = [*contents.notes]
    for messages, ticks in zip(groups, stamps, strict=True):
        name, time = _full_name(messages, groups), (ticks - origin) / 1e9
        order: slice | np.ndarray = slice(None)
        back = np.diff(time)
        if back.size and back.min() < 0:
            order = np.argsort(ticks, kind="stable")
            # Messages of parallel tasks arrive out of order by milliseconds, which sorting mends.
            if back.min() < -_RESTART:
                where = time[int(np.argmin(back))]
                notes.append(
                    f"the clock of {name!r} steps back by {-back.min():.3g} s after {where:.6g} s: "
                    "the recording should be split there."
                )
        for key, values in _numbers(messages.values):
            numbers = values.astype(np.float64)[order]
            # Drivers publish infinity for "no echo": a log takes only missing samples.
            numbers[~np.isfinite(numbers)] = np.nan
            unit = messages.units.get(key) or messages.units.get(key.partition("[")[0], "")
            fields.append(Field(f"{name}.{key}", numbers, time[order], unit))
    if not fields:
        raise InputError(
            f"{path.name}: expected messages with numbers, found none.",
            "check that the recording was saved.",
        )
    return fields, notes, contents.parameters


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


def series_in(
    path: Path, kind: Kind, wanted: Sequence[str], header: bool, missing: Sequence[float]
) -> dict[str, Series]:
    """The samples of the wanted fields of a robot's log.

    Columns are such as ``"/odom.twist.twist.linear.x"``, ``"RCOU.C1"``, ``"ESC[0].RPM"``,
    ``"actuator_outputs.output[0]"``, or ``"1/ATTITUDE.yaw"`` if several systems send a message.
    With ``header`` by the stamp of the message's header if it has one (ROS); ``missing`` are
    numbers that mean missing.
    """
    _check_file(path, kind)
    file = path.name
    if kind in _READERS:
        if header:
            raise InputError(
                f"{file}: only ROS bags have stamps in headers.", "leave stamps at 'recorder'."
            )
        targets = {column: _parsed(file, column) for column in wanted}
        contents = _READERS[kind](path, {sent[3] for sent, _ in targets.values()})
        chosen = {c: _messages(file, c, sent, contents) for c, (sent, _) in targets.items()}
        values = {c: _values(file, c, chosen[c].values, key) for c, (_, key) in targets.items()}
    else:
        contents = read_bag(path, wanted, header)
        chosen = {c: messages for messages in contents.gathered for c in messages.values}
        values = {c: messages.values[c] for c, messages in chosen.items()}
    origin = min((int(m.ticks[0]) for m in chosen.values() if len(m.ticks)), default=0)
    notes = [note.removesuffix(".") for note in contents.notes]
    series = {}
    for column in wanted:
        ticks, note = chosen[column].ticks, chosen[column].note
        remarks = (*([note] if note else []), *(notes if column == wanted[0] else []))
        series[column] = series_of(file, column, ticks, values[column], origin, missing, remarks)
    return series


def _check_file(path: Path, kind: Kind) -> None:
    """Raise InputError for a file that is too large, or a bag with the wrong suffix."""
    if kind in _READERS:  # these are read into memory at once
        MemoryBudget(path).take(path.stat().st_size)
    bag = path.is_file() and kind in (BAG, BAG_1, MCAP)
    if bag and path.suffix.lower() not in kind.endings:
        raise InputError(
            f"{path.name}: found {kind.article}, expected a name that ends in {kind.endings[0]}.",
            f"rename it to {path.with_suffix(kind.endings[0]).name!r}.",
        )


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
    name, instance, field = sent[3], sent[4], column.partition(".")[2]
    if name not in contents.names:
        raise absent(file, column, "message", name, sorted(contents.names))
    # Fewer numbers match more senders: "1/ATTITUDE" takes every component of system 1.
    source = tuple(int(number) for number in sent.groups()[:2] if number is not None)
    groups = [g for g in contents.gathered if g.name == name and g.source[: len(source)] == source]
    named = [g for g in groups if instance in (None, g.instance)]
    senders = ["/".join(map(str, source)) for source in sorted({g.source for g in named})]
    instances = sorted(g.instance for g in named)
    if not named:
        rejected = sorted(g.instance for g in groups if g.instance)
        description = f"the instances {listing(rejected)}" if rejected else "none from that sender"
        problem = f"expected messages {name!r} as named, found {description}."
        mend = "correct the number in front of the message or in the brackets."
    elif len(senders) > 1:
        problem = f"{name!r} is sent by several (system/component): {listing(senders)}."
        mend = f"name one, such as {f'{senders[0]}/{name}.{field}'!r}."
    elif len(named) > 1:
        problem = f"the log has several {name!r}: {listing(instances)}."
        mend = f"name one, such as {f'{name}[{instances[0]}].{field}'!r}."
    elif named[0].ticks is None:
        problem = f"the message {name!r} has no time stamp."
        mend = "choose a message with a field TimeUS."
    else:
        return named[0]
    raise InputError.at(column_place(file, column), problem, mend)


def _values(file: str, column: str, fields: Mapping[str, Any], key: str) -> np.ndarray:
    """The numbers of a field, or of an element of it."""
    match = None if key in fields else _ELEMENT.fullmatch(key)
    base = match[1] if match else key
    if base not in fields:
        raise absent(file, column, "field", key, fields)
    values = np.asarray(fields[base])
    first = values[0].decode("latin-1") if isinstance(values[0], bytes) else values[0]
    text = repr(str(first)[:40])
    if match and (values.ndim < 2 or int(match[2]) >= values.shape[1]):
        problem = f"expected an element [{match[2]}], found {text}."
        mend = "name a field that is an array; its elements are counted from 0."
    elif not match and values.ndim > 1:
        problem = f"expected a number, found an array of {values.shape[1]}."
        mend = "append the element, such as [0]."
    elif values.dtype.kind not in "biuf":
        problem, mend = f"expected a number, found {text}.", "choose a field of numbers."
    else:
        return values[:, int(match[2])] if match else values
    raise InputError.at(column_place(file, column), problem, mend)


def series_of(
    file: str,
    column: str,
    nanoseconds: ArrayLike,
    values: ArrayLike,
    origin: int,
    missing: Iterable[float] = (),
    remarks: Iterable[str] = (),
) -> Series:
    """Clean the samples of one field: sorted by time, one per time stamp, none missing.

    Time stamps and their ``origin`` are integers [ns]: a float64 resolves a date only to 0.2 us.
    """
    place = column_place(file, column)
    ticks = np.asarray(nanoseconds, np.int64) - origin
    numbers = np.array(values, np.float64)  # a copy: missing values are marked in it
    notes = []
    for number in missing:
        numbers[numbers == number] = np.nan
    keep = ~np.isnan(numbers)
    if not keep.any():
        problem = f"expected numbers, found none in {numbers.size} messages."
        mend = "choose another field, or check that the recording was complete."
        raise InputError.at(place, problem, mend)
    bad = np.flatnonzero(np.isinf(numbers))
    if bad.size:
        problem = f"expected a finite number, found {numbers[bad[0]]}."
        mend = "choose another field; a missing sample is written as nan."
        raise InputError.at(column_place(file, column, f", message {bad[0] + 1}"), problem, mend)
    if not keep.all():
        notes.append(f"{int((~keep).sum())} of {keep.size} messages held no number")
        ticks, numbers = ticks[keep], numbers[keep]
    back = np.diff(ticks)
    if (back < -_RESTART * 1e9).any():
        index = int(np.argmax(back < -_RESTART * 1e9)) + 1
        raise InputError.at(
            column_place(file, column, f", message {index + 1}"),
            f"the clock steps back by {-back[index - 1] / 1e9:.6g} s "
            f"at {ticks[index - 1] / 1e9:.6g} s.",
            "the clock was restarted: split the recording there.",
        )
    if (back < 0).any():
        notes.append(f"{int((back < 0).sum())} messages were not in order and were sorted")
        order = np.argsort(ticks, kind="stable")
        ticks, numbers = ticks[order], numbers[order]
    last = np.append(np.diff(ticks) > 0, True)  # of several at one time stamp, keep the last
    if not last.all():
        count = int((~last).sum())
        notes.append(f"{count} messages had the stamp of the next one, which was taken")
        ticks, numbers = ticks[last], numbers[last]
    return Series(place, ticks / 1e9, numbers, (*notes, *remarks))
