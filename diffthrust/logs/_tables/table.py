"""An open table: names of columns, and cells not yet converted to numbers; and columns read."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from diffthrust._support.errors import Place


@dataclass(frozen=True)
class Dates:
    """Cells stored as dates: seconds after the first, ``(n,)``, NaN if missing."""

    seconds: np.ndarray


@dataclass(frozen=True)
class Other:
    """Cells that are not a column of numbers, described, such as ``an array of shape (2, 4)``."""

    description: str


Cells = np.ndarray | Dates | Other | Sequence[str | None]
"""Numbers ``(n,)``, dates, text, or a description of anything else."""


@dataclass(frozen=True)
class Field:
    """One column of a table, or one field of a message or topic.

    Args:
        name: what ``Column(...)`` takes, such as ``"rpm"``, ``"RCOU.C1"`` or
            ``"/odom.twist.twist.linear.x"``.
        values: numbers, ``(n,)``, NaN where missing or no number.
        time: time stamps of the field [s], from the log's first message, ``(n,)``; None in a table.
        unit: the unit stated in the file; empty if none is.
        text: an example of a cell that is not a number; empty if there is none.
        dates: a column of dates; its values are seconds after the first.
        date_formats: for dates that do not begin with the year, the values for ``Column(dates=)``;
            two if day and month cannot be told apart.
    """

    name: str
    values: np.ndarray
    time: np.ndarray | None = None
    unit: str = ""
    text: str = ""
    dates: bool = False
    date_formats: tuple[str, ...] = ()


@dataclass(frozen=True)
class OpenTable:
    """An open table.

    Args:
        file: name for messages.
        kind: in words, such as ``"CSV table"``.
        names: of its columns, in order.
        read: returns the cells of some columns by name; the second argument are texts that mean
            missing.
        rows: position of each sample in the file, ``(n,)``, counted from 1; None for 1, 2, ...
        row_word: ``"line"``, ``"row"`` or ``"element"``.
        column_word: ``"column"`` or ``"variable"``.
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

    def place(self, column: str | None, row: int | None = None) -> Place:
        """Name a place as ``run3.csv, line 212, column 'rpm'``."""
        at = "" if row is None else f", {self.row_word} {row}"
        name = "" if column is None else f", {self.column_word} {column!r}"
        return Place(f"{self.file}{at}{name}", column)
