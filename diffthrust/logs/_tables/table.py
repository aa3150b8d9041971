"""A table of numbers with their places in the file, and the errors of its readers."""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from diffthrust._support.errors import InputError, Place
from diffthrust._support.names import listing, nearest
from diffthrust.logs._tables.cells import BadCell
from diffthrust.logs._validate import window

_MARKED = re.compile(r"'[+-]?[\d.,]*\d,\d[\d.,]*'")


@dataclass
class Table:
    """The wanted columns of a file as numbers, ``(n,)`` each, NaN where a cell is empty.

    ``rows`` are the positions of the samples in the file, counted from 1; with ``dates`` the time
    column held dates or durations, and is in seconds already.
    """

    file: str
    columns: dict[str, np.ndarray]
    rows: np.ndarray
    row_word: str = "line"
    column_word: str = "column"
    notes: list[str] = field(default_factory=list)
    dates: bool = False

    def place(self, column: str | None, index: int | None = None) -> Place:
        """Name a place as ``run3.csv, line 212, column 'rpm'``."""
        row = "" if index is None else f", {self.row_word} {self.rows[index]}"
        name = "" if column is None else f", {self.column_word} {column!r}"
        return Place(f"{self.file}{row}{name}", column)

    def say_dates(self) -> None:
        """Note that the time column held dates."""
        self.dates = True
        self.notes.append("the time stamps were read as dates, in seconds after the first.")

    def mark_missing(self, words: Collection[str]) -> None:
        """Turn numbers that mean missing, such as -999, into NaN."""
        for word in words:
            try:
                number = float(word)
            except ValueError:
                continue
            for values in self.columns.values():
                values[values == number] = np.nan

    def keep(self, rows: np.ndarray) -> None:
        """Keep only the marked rows: booleans, ``(n,)``."""
        self.columns = {name: values[rows] for name, values in self.columns.items()}
        self.rows = self.rows[rows]

    def drop_blank_rows(self) -> None:
        """Drop rows that hold no number, and note how many; InputError if all are blank."""
        blank = np.logical_and.reduce([np.isnan(values) for values in self.columns.values()])
        if blank.all():
            raise InputError(
                f"{self.file}: expected samples, found none in {blank.size} rows.",
                "check that the recording was saved, and that the columns are the right ones.",
            )
        trailing = int(np.argmin(blank[::-1]))
        inner = int(blank.sum()) - trailing
        self.keep(~blank)
        for count, kind, verb in (
            (trailing, "trailing blank", "trimmed"),
            (inner, "blank", "skipped"),
        ):
            if count:
                self.notes.append(f"{count} {kind} row{'s were' if count > 1 else ' was'} {verb}.")

    def cut(self, stamps: np.ndarray, start: float | None, stop: float | None) -> np.ndarray:
        """Keep the rows from start to stop [s after the first], and note how many were cut.

        Takes the time stamps [s], ``(n,)``, and returns those that are kept.
        """
        keep = window(stamps, start, stop, self.file)
        if not keep.all():
            self.keep(keep)
            last = "the end" if stop is None else f"{stop:g} s"
            self.notes.append(
                f"{int((~keep).sum())} of {keep.size} samples were cut, those outside "
                f"{start or 0.0:g} s to {last}."
            )
        return stamps[keep]


_TIMELESS = (
    "; without one, the step of the samples, time = 0.05; a table of readings, whose rows follow "
    "no clock: [logs] time = 0.5, static = true, or read_log(..., time=0.5, static=True)"
)


def absent_column(
    file: str, wanted: str, names: Sequence[str], word: str, *, is_clock: bool = False
) -> InputError:
    """The error for a column that is not in the file; a table may have no time column at all."""
    near = nearest(wanted, names)
    mend = f"write the name of the {word} exactly as in the file{'; ' + near if near else ''}"
    return InputError.at(
        Place(file, wanted),
        f"expected a {word} {wanted!r}, found {listing(names)}.",
        f"{mend}{_TIMELESS if is_clock and not near else ''}.",
    )


def not_a_number(place: Place, bad: BadCell) -> InputError:
    """The error for a cell that is not a number."""
    if _MARKED.fullmatch(bad.text):
        return InputError.at(
            place,
            f"expected {bad.expected}, found {bad.text}, whose comma may be a thousands separator.",
            "write numbers without thousands separators, and with a decimal point.",
        )
    return InputError.at(
        place,
        f"expected {bad.expected}, found {bad.text}.",
        f"list {bad.text} under [logs] missing_values, or remove the line.",
    )


def damaged(path: Path, kind: str, error: Exception) -> InputError:
    """The error for a file that its reader cannot read."""
    reason = " ".join(str(error).split())[:160] or type(error).__name__
    return InputError(
        f"{path.name}: expected a {kind} file, found something that cannot be read ({reason}).",
        "check that the file is complete, and that its name ends as its content requires.",
    )
