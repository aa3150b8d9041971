"""The rows and sentences of the survey of a file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from diffthrust._support.report import Rows, Styled
from diffthrust._support.words import humanize, number, percent
from diffthrust.survey._choice import Choice
from diffthrust.survey._rows import ColumnRow
from diffthrust.survey._rules import NO_CHANNEL, UNIT_OF

_WIDE = 40
"""With more fields than this, only those that a model may use are listed."""
_NAME = 30
"""Characters up to which names of columns are never folded."""
_ROLES = {
    "time": "time",
    "input": "inputs",
    "measured": "measured",
    "spare": "may be used besides",
    "": "not used",
}


def split_rows(columns: Sequence[ColumnRow], all: bool) -> tuple[list[ColumnRow], list[ColumnRow]]:
    """The columns to list, ordered by role, and those that are only counted."""
    order = list(_ROLES)
    listed, remaining = sorted(columns, key=lambda row: order.index(row.role)), []
    if len(columns) > _WIDE and not all:
        listed = [row for row in listed if row.channel or _usable(row)][:_WIDE]
        remaining = [row for row in columns if row not in listed]
    return listed, remaining


def column_rows(columns: Sequence[ColumnRow], messages: bool) -> Rows:
    """A row for each column; of messages of a robot also their rates."""
    headings = ("Column", "Taken for", "Unit", "From", "To", *(["Hz"] if messages else []))
    rows, role = [], None
    for column in columns:
        if column.role != role:
            heading = Styled(f"{_ROLES[column.role]}:", "strong")
            rows.append((heading, *[""] * (len(headings) - 1)))
            role = column.role
        cells = (f"  {column.name or '(no name)'}", _meaning(column), column.unit)
        numbers = (column.low, column.high, *([column.rate] if messages else []))
        rows.append((*cells, *(number(value, 3) for value in numbers)))
    short = max((len(column.name) for column in columns), default=0) <= _NAME
    return Rows.of(headings, rows, numbers=range(3, len(headings)), unbroken=(0,) if short else ())


def remarks(rows: Sequence[ColumnRow]) -> list[str]:
    """The oddities, each with the columns that show it."""
    columns: dict[str, list[str]] = {}
    for row in rows:
        missing = [f"{percent(row.missing)} missing"] if 0 < row.missing < 1 else []
        for remark in (*row.remarks, *missing):
            columns.setdefault(remark, []).append(row.name)
    return [f"{remark}: {', '.join(names)}" for remark, names in columns.items()]


def _meaning(row: ColumnRow) -> str:
    if row.channel or row.quantity == "derived":
        return row.channel or "-"
    return f"{humanize(row.quantity)}{'?' if row.sure == 'perhaps' else ''}" or "?"


def first_line(name: str, choice: Choice, columns: Sequence[ColumnRow]) -> str:
    """The kind of file, its size, and its sampling.

    Args:
        name: of the file.
        choice: its contents and channels.
        columns: its columns.
    """
    contents, clock = choice.contents, choice.seconds
    if contents.messages:
        spans = [
            f.time[-1] - f.time[0] for f in contents.fields if f.time is not None and f.time.size
        ]
        return f"{name}: {contents.kind}, {len(columns)} fields, {max(spans, default=0):.4g} s."
    samples = columns[0].samples if columns else 0
    size = f"{name}: {contents.kind}, {samples} rows of {len(columns)} columns"
    timed = next((row for row in columns if not math.isnan(row.rate)), None)
    if timed is None:
        return f"{size}, no time."
    assert clock is not None
    return (
        f"{size}, {number(float(clock[-1] - clock[0]))} s at {number(timed.rate, 3)} Hz, "
        f"largest gap {number(timed.gap, 3)} s."
    )


def model_line(choice: Choice, train: Sequence[Path], holdout: Sequence[Path]) -> str:
    """The model that suits the file, and which files it is fitted to."""
    if choice.model is None:
        return "No model suits it: see the doubts."
    line = f"Model: {choice.model}, with {', '.join(choice.channels)}."
    if holdout:
        files = f"{len(train)} file{'s' if len(train) > 1 else ''}"
        line += f" {files} to fit, {', '.join(path.name for path in holdout)} to be kept unseen."
    return line


def _usable(row: ColumnRow) -> bool:
    """Whether a model might use it."""
    has_channel = row.quantity in UNIT_OF and row.quantity not in NO_CHANNEL
    return has_channel and row.low < row.high


def grouped(rows: Iterable[ColumnRow]) -> str:
    """Names of messages with the number of their fields."""
    counts: dict[str, int] = {}
    for row in rows:
        name = row.name.rsplit(".", 1)[0] if "." in row.name else row.name
        counts[name] = counts.get(name, 0) + 1
    return ", ".join(_counted(counts))


def _counted(counts: dict[str, int]) -> Iterator[str]:
    for name, count in counts.items():
        yield f"{name} ({count})" if count > 1 else name
