"""An open table: names of columns, and cells not yet converted to numbers."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from diffthrust._support.errors import InputError, Place
from diffthrust.logs._columns import Column
from diffthrust.logs._tables.cells import BadCell, number_cells
from diffthrust.logs._tables.dates import OtherDate, formats_of, is_date, other_date, seconds_of
from diffthrust.logs._tables.table import Table, absent_column, not_a_number


@dataclass(frozen=True)
class Dates:
    """Cells stored as dates: seconds after the first, ``(n,)``, NaN if missing."""

    seconds: np.ndarray


@dataclass(frozen=True)
class Other:
    """Cells that are not a column of numbers, described, such as ``an array of shape (2, 4)``."""

    description: str


COMMAS = ": decimal commas were read as decimal points."

Cells = np.ndarray | Dates | Other | Sequence[str | None]
"""Numbers ``(n,)``, dates, text, or a description of anything else."""


@dataclass(frozen=True)
class OpenTable:
    """An open table.

    Args:
        file: name for messages.
        kind: readable kind, such as ``"CSV table"``.
        names: of its columns, in order.
        read: returns the cells of some columns by name; the second argument are texts that mean
            missing.
        rows: position of each sample in the file, ``(n,)``, counted from 1; None for 1, 2, ...
        row_word: word for a row: ``"line"``, ``"row"`` or ``"element"``.
        column_word: word for a column: ``"column"`` or ``"variable"``.
        comma: commas in its numbers are decimal commas; otherwise only where unambiguous.
        units: units of columns stated in the file.
        notes: sentences on how it was read.
        sheet: the sheet, of an Excel file with several sheets.
        mend: what to do about a column that holds no numbers.
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
    mend: str = "choose a column of numbers."


def table_of(
    source: OpenTable, wanted: Sequence[str], clock: Column | None, missing: Collection[str]
) -> Table:
    """The wanted columns as numbers; ``clock`` is the only one that may hold dates."""
    for name in wanted:
        if name not in source.names:
            is_clock = clock is not None and name == clock.column
            raise absent_column(
                source.file, name, source.names, source.column_word, is_clock=is_clock
            )
        if list(source.names).count(name) > 1:
            word = source.column_word
            raise InputError.at(
                Place(source.file, name),
                f"expected one {word} {name!r}, found several of that name.",
                f"rename or remove the other {word}.",
            )
    table = Table(
        source.file,
        {},
        np.zeros(0, dtype=np.int64),
        row_word=source.row_word,
        column_word=source.column_word,
        notes=list(source.notes),
    )
    content = source.read(wanted, missing)
    for name in wanted:
        cells = content[name]
        if isinstance(cells, Other):
            raise InputError.at(
                table.place(name), f"expected numbers, found {cells.description}.", source.mend
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
    # 1,5 in one column and 1.500 in another: the second may be 1.5 or 1500, so the log notes the
    # choice.
    if commas and len(commas) < len(wanted):
        pointed = [
            name
            for name, cells in content.items()
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
    """The numbers of a column; ``form`` is the date format of the time column, else None."""
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
                f"expected {bad.expected}, found {bad.text}.",
                f"correct the format, dates = {form!r}, or list {bad.text} under missing_values.",
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
    """Read a column of text: numbers, ``(n,)``, whether they were dates, or had decimal commas.

    Raises `BadCell` for other cells, and `OtherDate` for dates that do not begin with the year.
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
            raise OtherDate(bad.index, bad.text, formats) from None
        raise
