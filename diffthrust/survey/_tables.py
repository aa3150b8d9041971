"""The rows and sentences of the survey of a file."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from diffthrust._support.report import Rows, Styled
from diffthrust._support.words import humanize, number, percent
from diffthrust.logs._tables.table import Field
from diffthrust.survey._choice import Choice, Pick
from diffthrust.survey._names import NO_CHANNEL, UNIT_OF
from diffthrust.survey._values import numbers_of, sampling, varies

_GAP = 5.0
"""A step between messages above this multiple of the median is remarked."""
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


@dataclass(frozen=True)
class ColumnRow:
    """A column, or a field of a message.

    Args:
        name: as for ``Column(...)`` and spec files.
        quantity: likely quantity, as the name of a channel; empty if unknown.
        unit: assumed unit of its numbers.
        sure: "sure", "likely" or "perhaps".
        why: the evidence.
        channel: the channel of the drafted spec; empty if not in the draft.
        role: "input", "measured", "time", or "spare" for a column in a comment of the draft.
        samples: number of cells or messages.
        missing: share of samples without a number.
        low: smallest number; NaN if there is none.
        high: largest number.
        rate: samples per second; NaN if unknown.
        gap: largest step between time stamps [s].
        remarks: oddities, in words.

    Example:
        >>> row = dft.look("run1.csv").columns[1]
        >>> row.name, row.role, row.samples, "unit" in row.to_json()
        ('command', 'input', 240, True)
    """

    name: str
    quantity: str
    unit: str
    sure: str
    why: str
    channel: str
    role: str
    samples: int
    missing: float
    low: float
    high: float
    rate: float
    gap: float
    remarks: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)


def rows_of(choice: Choice) -> tuple[ColumnRow, ...]:
    """A row for each field, in the order of the file."""
    clock = choice.seconds
    common = sampling(clock) if clock is not None else (math.nan, math.nan)
    places = {pick.field.name: (name, "spare") for name, pick in choice.spare.items()}
    places |= {pick.field.name: (name, pick.role) for name, pick in choice.timed.items()}
    picks = {pick.field.name: pick for pick in choice.channels.values()}
    rows = []
    for column in choice.columns:
        field = column.field
        pick = picks.get(field.name)
        meaning = (pick or column).meaning
        channel, role = places.get(field.name, ("", ""))
        rate, gap = common if field.time is None else sampling(field.time)
        numbers = numbers_of(field.values)
        row = ColumnRow(
            name=field.name,
            quantity=meaning.quantity,
            unit=meaning.unit,
            sure=meaning.sure if meaning.quantity else "",
            why=meaning.why,
            channel=channel,
            role=role,
            samples=field.values.size,
            missing=1 - numbers.size / max(field.values.size, 1),
            low=float(numbers.min()) if numbers.size else math.nan,
            high=float(numbers.max()) if numbers.size else math.nan,
            rate=rate,
            gap=gap,
            remarks=tuple(_remarks(field, pick, rate, gap)),
        )
        rows.append(row)
    return tuple(rows)


def _remarks(field: Field, pick: Pick | None, rate: float, gap: float) -> Iterator[str]:
    numbers = numbers_of(field.values)
    if not numbers.size:
        yield f"text such as {field.text!r}" if field.text else "empty"
    elif not varies(field.values) and numbers.size > 1:
        yield "constant"
    elif field.text:
        yield f"some text such as {field.text!r}"
    if pick is not None and pick.unsigned:
        yield "no sign"
    if pick is not None and pick.meaning.scale < 0:
        yield "turned round"
    if field.time is not None and gap * rate > _GAP:
        yield f"a gap of {gap:.3g} s"


def split_rows(columns: Sequence[ColumnRow], all: bool) -> tuple[list[ColumnRow], list[ColumnRow]]:
    """The columns to list, ordered by role, and those that are only counted."""
    order = list(_ROLES)
    listed = sorted(columns, key=lambda row: order.index(row.role))
    if len(columns) <= _WIDE or all:
        return listed, []
    used = UNIT_OF.keys() - {*NO_CHANNEL}  # what a model might use, where it moves
    listed = [r for r in listed if r.channel or (r.quantity in used and r.low < r.high)][:_WIDE]
    return listed, [row for row in columns if row not in listed]


def column_rows(columns: Sequence[ColumnRow], messages: bool) -> Rows:
    """A row for each column; of messages of a robot also their rates."""
    headings = ("Column", "Taken for", "Unit", "From", "To", *(["Hz"] if messages else []))
    rows, role = [], None
    for column in columns:
        if column.role != role:
            role = column.role
            rows.append((Styled(f"{_ROLES[role]}:", "strong"), *[""] * (len(headings) - 1)))
        cells = (f"  {column.name or '(no name)'}", _meaning(column), column.unit)
        numbers = (column.low, column.high, *([column.rate] if messages else []))
        rows.append((*cells, *(number(value, 3) for value in numbers)))
    short = all(len(column.name) <= _NAME for column in columns)
    return Rows.of(headings, rows, numbers=range(3, len(headings)), unbroken=(0,) if short else ())


def _meaning(row: ColumnRow) -> str:
    if row.channel or row.quantity == "derived":
        return row.channel or "-"
    return f"{humanize(row.quantity)}{'?' if row.sure == 'perhaps' else ''}" or "?"


def remarks(rows: Sequence[ColumnRow]) -> list[str]:
    """The oddities, each with the columns that show it."""
    columns: dict[str, list[str]] = {}
    for row in rows:
        missing = [f"{percent(row.missing)} missing"] if 0 < row.missing < 1 else []
        for remark in (*row.remarks, *missing):
            columns.setdefault(remark, []).append(row.name)
    return [f"{remark}: {', '.join(names)}" for remark, names in columns.items()]


def first_line(name: str, choice: Choice, columns: Sequence[ColumnRow]) -> str:
    """The kind of a file, its size, and its sampling."""
    contents, clock = choice.contents, choice.seconds
    if contents.messages:
        stamps = [f.time for f in contents.fields if f.time is not None and f.time.size]
        span = max((time[-1] - time[0] for time in stamps), default=0)
        return f"{name}: {contents.kind}, {len(columns)} fields, {span:.4g} s."
    samples = columns[0].samples if columns else 0
    size = f"{name}: {contents.kind}, {samples} rows of {len(columns)} columns"
    if clock is None or math.isnan(columns[0].rate):
        return f"{size}, no time."
    return (
        f"{size}, {number(float(clock[-1] - clock[0]))} s at {number(columns[0].rate, 3)} Hz, "
        f"largest gap {number(columns[0].gap, 3)} s."
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


def grouped(rows: Iterable[ColumnRow]) -> str:
    """Names of messages with the number of their fields."""
    counts = Counter(row.name.rsplit(".", 1)[0] for row in rows)
    return ", ".join(f"{name} ({n})" if n > 1 else name for name, n in counts.items())
