"""Messages of robots' logs, as their readers give them, and the errors of readers."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from diffthrust._support.errors import InputError, Place
from diffthrust._support.names import listing, nearest

LONGEST = 16
"""Longer arrays are pictures, spectra or scans: their elements are not channels."""


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
        note: a sentence on how they were read, without a full stop.
    """

    name: str
    ticks: Any = field(default_factory=list)
    values: dict[str, Any] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    source: tuple[int, ...] = ()
    instance: str = ""
    note: str = ""


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


def column_place(file: str, column: str, detail: str = "") -> Place:
    """Name a place as ``run.mcap, column '/odom.twist.twist.linear.x'``, plus a detail."""
    return Place(f"{file}, column {column!r}{detail}", column)


def split_column(file: str, column: str) -> tuple[str, str]:
    """Split ``MESSAGE.FIELD`` at its first dot."""
    message, _, field = column.partition(".")
    if not message or not field:
        problem = "expected a message and its field with a dot between."
        mend = "write it as '/odom.twist.twist.linear.x', 'RCOU.C1' or 'ATTITUDE.yaw'."
        raise InputError.at(column_place(file, column), problem, mend)
    return message, field


def absent(file: str, column: str, what: str, name: str, names: Iterable[str]) -> InputError:
    """The error for a topic or message that is not in the file, or a field not in a message."""
    names = list(names)
    return InputError.at(
        column_place(file, column),
        f"expected the {what} {name!r}, found {listing(names)}.",
        f"name a {what} that is there{nearest(name, names, '; ')}.",
    )
