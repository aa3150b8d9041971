"""The table of a look."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Protocol

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from diffthrust._support.tables import number, plain_table
from diffthrust._support.words import percent, spelt
from diffthrust.survey._rules import NO_CHANNEL, UNIT_OF

if TYPE_CHECKING:
    from pathlib import Path

    from diffthrust.survey._choice import Choice
    from diffthrust.survey._rows import ColumnRow

_WIDE = 40
"""Fields from which on only those are shown that a model may use."""
_NAME = 30
"""Characters up to which names of columns are never folded."""
_ROLES = {
    "time": "time",
    "input": "inputs",
    "measured": "measured",
    "spare": "may be used besides",
    "": "not used",
}


class Looked(Protocol):
    """What is shown."""

    @property
    def path(self) -> Path: ...

    @property
    def choice(self) -> Choice: ...

    @property
    def columns(self) -> tuple[ColumnRow, ...]: ...

    @property
    def doubts(self) -> tuple[str, ...]: ...

    @property
    def train(self) -> tuple[Path, ...]: ...

    @property
    def holdout(self) -> tuple[Path, ...]: ...


def look_table(seen: Looked, *, all: bool = False) -> RenderableType:
    """What is in a file: a line on it, a row for each column, the model, and the doubts."""
    choice, rows = seen.choice, seen.columns
    messages = choice.contents.messages
    order = list(_ROLES)
    shown, rest = sorted(rows, key=lambda row: order.index(row.role)), []
    if len(rows) > _WIDE and not all:
        shown = [row for row in shown if row.channel or _usable(row)][:_WIDE]
        rest = [row for row in rows if row not in shown]
    parts: list[RenderableType] = [Text(_first_line(seen)), Text()]
    parts.append(_table(shown, messages))
    if remarks := _remarks(shown):
        parts += [Text(), _listed(remarks)]
    if rest:
        parts += [Text(), Text(f"{len(rest)} more fields (--all shows them): {_grouped(rest)}")]
    parts += [Text(), Text(_model_line(seen))]
    if seen.doubts:
        parts += [Text(), Text("In doubt:"), _listed(seen.doubts)]
    return Group(*parts)


def _table(rows: Sequence[ColumnRow], messages: bool) -> Table:
    headings = ["Column", "Taken for", "Unit", "From", "To"]
    headings += ["Hz"] if messages else []
    table = plain_table(*headings, numbers=range(3, len(headings)))
    table.columns[0].no_wrap = max((len(row.name) for row in rows), default=0) <= _NAME
    before = None
    for row in rows:
        if row.role != before:
            table.add_row(Text(f"{_ROLES[row.role]}:", style="bold"))
            before = row.role
        cells = [f"  {row.name or '(no name)'}", _taken(row), row.unit]
        cells += [number(row.low, 3), number(row.high, 3)]
        cells += [number(row.rate, 3)] if messages else []
        table.add_row(*map(Text, cells))
    return table


def _remarks(rows: Sequence[ColumnRow]) -> list[str]:
    """What is odd, and of which columns."""
    told: dict[str, list[str]] = {}
    for row in rows:
        missing = [f"{percent(row.missing)} missing"] if 0 < row.missing < 1 else []
        for remark in (*row.remarks, *missing):
            told.setdefault(remark, []).append(row.name)
    return [f"{remark}: {', '.join(names)}" for remark, names in told.items()]


def _taken(row: ColumnRow) -> str:
    if row.channel or row.quantity == "derived":
        return row.channel or "-"
    return f"{spelt(row.quantity)}{'?' if row.sure == 'perhaps' else ''}" or "?"


def _listed(words: Iterable[str]) -> Table:
    """A list whose lines begin below each other."""
    table = Table.grid(padding=(0, 1, 0, 0))
    for word in words:
        table.add_row("-", Text(word))
    return table


def _first_line(seen: Looked) -> str:
    rows, contents = seen.columns, seen.choice.contents
    if contents.messages:
        spans = [
            f.time[-1] - f.time[0] for f in contents.fields if f.time is not None and f.time.size
        ]
        return (
            f"{seen.path.name}: {contents.kind}, {len(rows)} fields, {max(spans, default=0):.4g} s."
        )
    samples = rows[0].samples if rows else 0
    told = f"{seen.path.name}: {contents.kind}, {samples} rows of {len(rows)} columns"
    timed = next((row for row in rows if not math.isnan(row.rate)), None)
    if timed is None:
        return f"{told}, no time."
    clock = seen.choice.seconds
    assert clock is not None
    return (
        f"{told}, {number(float(clock[-1] - clock[0]))} s at {number(timed.rate, 3)} Hz, "
        f"largest gap {number(timed.gap, 3)} s."
    )


def _model_line(seen: Looked) -> str:
    choice = seen.choice
    if choice.model is None:
        return "No model suits it: see the doubts."
    told = f"Model: {choice.model}, with {', '.join(choice.channels)}."
    if seen.holdout:
        files = f"{len(seen.train)} file{'s' if len(seen.train) > 1 else ''}"
        told += (
            f" {files} to fit, {', '.join(path.name for path in seen.holdout)} to be kept unseen."
        )
    return told


def _usable(row: ColumnRow) -> bool:
    """Whether a model might use it."""
    known = row.quantity in UNIT_OF and row.quantity not in NO_CHANNEL
    return known and row.low < row.high


def _grouped(rows: Iterable[ColumnRow]) -> str:
    """Names of messages with the number of their fields."""
    counts: dict[str, int] = {}
    for row in rows:
        name = row.name.rsplit(".", 1)[0] if "." in row.name else row.name
        counts[name] = counts.get(name, 0) + 1
    return ", ".join(_counted(counts))


def _counted(counts: dict[str, int]) -> Iterator[str]:
    for name, count in counts.items():
        yield f"{name} ({count})" if count > 1 else name
