"""A table as its reader found it: names of columns, and cells that are numbers or not yet."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.logs._columns import Column
from diffthrust.logs._tables.cells import BadCell, number_cells
from diffthrust.logs._tables.dates import OtherDate, formats_of, is_date, other_date, seconds_of
from diffthrust.logs._tables.table import Table, absent_column, not_a_number, twice


@dataclass(frozen=True)
class Dates:
    """Cells that the file itself holds as dates: seconds after the first, ``(n,)``, NaN missing."""

    seconds: np.ndarray


@dataclass(frozen=True)
class Other:
    """Cells that are no column of numbers, in words such as ``an array of shape (2, 4)``."""

    found: str


COMMAS = ": decimal commas were read as decimal points."

Cells = np.ndarray | Dates | Other | Sequence[str | None]
"""Numbers ``(n,)``, dates, text, or what they are instead."""


@dataclass(frozen=True)
class OpenTable:
    """An open table.

    Args:
        file: how messages name it.
        kind: what it is, for people: ``"CSV table"``.
        names: of its columns, in their order.
        read: gives the cells of some columns by name; the second argument are texts that mean
            missing.
        rows: where each sample stands in the file, ``(n,)``, counted from 1; None for 1, 2, ...
        row_word: what a row is called there: ``"line"``, ``"row"`` or ``"element"``.
        column_word: what a column is called there: ``"column"`` or ``"variable"``.
        comma: commas in its numbers are decimal ones; else only where they can be nothing else.
        units: what the file itself says of the unit of a column.
        notes: sentences on how it was read.
        sheet: the sheet of an Excel file that has several.
        other: what to do about a column that holds no numbers.
    """

    file: str
    kind: str
    names: Sequence[str]
    read: Callable[[Sequence[str], Collection[str]], Mapping[str, Cells]]
    rows: np.ndarray | None = None
    row_word: str = "row"
    column_word: str = "column"
    comma: bool = False
    units: Mapping[str, str] = field(default_factory=dict)
    notes: Sequence[str] = ()
    sheet: str = ""
    other: str = "choose a column of numbers."


def table_of(
    source: OpenTable, wanted: Sequence[str], clock: Column | None, missing: Collection[str]
) -> Table:
    """The wanted columns as numbers.

    Args:
        source: the table.
        wanted: names of the columns.
        clock: the column of the time, which alone may hold dates.
        missing: texts that mean missing.

    Raises:
        InputError: a column is absent, double, holds no numbers, or is of another length.
    """
    for name in wanted:
        if name not in source.names:
            raise absent_column(source.file, name, source.names, source.column_word)
        if list(source.names).count(name) > 1:
            raise twice(source.file, name, source.column_word)
    table = Table(
        source.file,
        {},
        np.zeros(0, dtype=np.int64),
        row_word=source.row_word,
        column_word=source.column_word,
        notes=list(source.notes),
    )
    found = source.read(wanted, missing)
    for name in wanted:
        cells = found[name]
        if isinstance(cells, Other):
            raise InputError.at(
                table.place(name), f"expected numbers, found {cells.found}.", source.other
            )
        count = len(cells.seconds if isinstance(cells, Dates) else cells)
        if not table.columns:
            table.rows = np.arange(1, count + 1) if source.rows is None else source.rows
        elif count != table.rows.size:
            raise InputError.at(
                table.place(name),
                f"expected {table.rows.size} samples as in {wanted[0]!r}, found {count}.",
                "save columns of equal length.",
            )
        form = clock.dates if clock is not None and clock.column == name else None
        table.columns[name] = _numbers(table, name, cells, source.comma, form, missing)
    commas = [note for note in table.notes if note.endswith(COMMAS)]
    if commas and len(commas) < len(wanted):
        pointed = [
            name
            for name, cells in found.items()
            if not isinstance(cells, np.ndarray | Dates | Other)
            and any(cell and "." in cell for cell in cells)
            and f"column {name!r}{COMMAS}" not in commas
            and not (clock is not None and name == clock.column and table.dates)
        ]
        for name in pointed:
            table.notes.append(
                f"column {name!r} has points where others have decimal commas: they were read as "
                "decimal points."
            )
    return table


def _numbers(
    table: Table,
    name: str,
    cells: np.ndarray | Dates | Sequence[str | None],
    comma: bool,
    form: str | None,
    missing: Collection[str],
) -> np.ndarray:
    """A column's numbers; ``form`` is None unless it is the time's, whose dates it describes."""
    if isinstance(cells, Dates):
        if form is None:
            raise InputError.at(
                table.place(name),
                "expected numbers, found dates.",
                "choose a column of numbers; dates are read as the time.",
            )
        table.say_dates()
        return cells.seconds.copy()
    if isinstance(cells, np.ndarray):
        return cells.astype(np.float64)  # a copy: missing values are marked in it
    try:
        if form:
            numbers, dates, commas = seconds_of(cells, missing, form), True, False
        else:
            numbers, dates, commas = text_numbers(cells, missing, comma, form is not None)
    except OtherDate as bad:
        raise other_date(table.place(name, bad.index), bad) from None
    except BadCell as bad:
        place = table.place(name, bad.index)
        if form:
            raise InputError.at(
                place,
                f"expected {bad.expected}, found {bad.found}.",
                f"correct the format, dates = {form!r}, or list {bad.found} under missing_values.",
            ) from None
        raise not_a_number(place, bad) from None
    if commas:
        table.notes.append(f"column {name!r}{COMMAS}")
    if dates:
        table.say_dates()
    return numbers


def text_numbers(
    cells: Sequence[str | None], missing: Collection[str], comma: bool, is_time: bool
) -> tuple[np.ndarray, bool, bool]:
    """Read a column of text.

    Args:
        cells: text of the cells.
        missing: texts that mean missing.
        comma: commas are decimal ones, as in `number_cells`.
        is_time: dates are possible.

    Returns:
        Numbers, ``(n,)``, whether they were dates, and whether they had decimal commas.

    Raises:
        OtherDate: dates that do not begin with the year.
        BadCell: a cell can be read in no way.
    """
    try:
        numbers, commas = number_cells(cells, missing, comma)
        return numbers, False, commas
    except BadCell as bad:
        if not is_time:
            raise
        if is_date((cells[bad.index] or "").strip()):
            return seconds_of(cells, missing), True, False
        written = [c for c in cells if c and c.strip() not in missing]
        if formats := formats_of(written):
            raise OtherDate(bad.index, bad.found, formats) from None
        raise
