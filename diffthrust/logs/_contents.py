"""Everything that is in a file of a log, as far as it can be read: what `look` is built on."""

from __future__ import annotations

import re
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np

from diffthrust.logs._tables.csv import split_text
from diffthrust.logs._tables.table import BadCell, cells_to_column


@dataclass(frozen=True)
class Field:
    """One column of a table, or one field of a message or topic.

    Args:
        name: what ``Column(...)`` takes: ``"rpm"``, ``"/odom.twist.twist.linear.x"``, ``"RCOU.C1"``.
        values: numbers, ``(n,)``, NaN where missing or no number.
        time: own stamps [s] from the log's first message, ``(n,)``; None in a table.
        unit: what the file itself says, empty where it says nothing.
        text: an example of a cell that is no number, empty where there is none.
        dates: a column of dates; its values are seconds after the first.
    """

    name: str
    values: np.ndarray
    time: np.ndarray | None = None
    unit: str = ""
    text: str = ""
    dates: bool = False


@dataclass(frozen=True)
class Contents:
    """What is in a file.

    Args:
        path: the file.
        kind: what it is, for people: ``"CSV table"``, ``"ROS 2 bag"``.
        messages: its fields have clocks of their own and are read by `read_robot_log`.
        fields: its columns or fields, in the order of the file.
        notes: sentences on what was left out or is damaged.
    """

    path: Path
    kind: str
    messages: bool
    fields: tuple[Field, ...]
    notes: tuple[str, ...] = ()


def contents(path: str | PathLike[str]) -> Contents:
    """List everything that is in a file of a log; what cannot be read is left out and told.

    Args:
        path: a file or folder that `read_log` or `read_robot_log` reads.

    Raises:
        InputError: there is no such file, or nobody reads it.
    """
    file = Path(path)
    text = split_text(file, ())
    fields = []
    rows = [text.split(line) for line in text.lines if line.strip()]
    for index, name in enumerate(text.header):
        cells = [row[index] if index < len(row) else "" for row in rows]
        fields.append(_field(name, cells, text.delimiter != ","))
    return Contents(file, "CSV table", False, tuple(fields))


_UNIT = re.compile(r"[\[(]([^\])]+)[\])]\s*$")


def _field(name: str, cells: list[str], comma: bool) -> Field:
    missing: set[str] = set()
    text = ""
    unit = found[1] if (found := _UNIT.search(name)) else ""
    while True:
        try:
            values, how = cells_to_column(cells, missing, comma=comma, is_time=True)
        except BadCell as bad:
            text = text or cells[bad.index].strip()
            missing.add(cells[bad.index].strip())
            continue
        return Field(name, values, unit=unit, text=text, dates=how == "date")
