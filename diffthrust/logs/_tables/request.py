"""The columns requested of a table as numbers, and the fields of a log that are made of them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError, Place
from diffthrust._support.names import listing, nearest
from diffthrust._support.validation import finite
from diffthrust.logs._columns import Column, channel_columns, each_column, fields_of_columns
from diffthrust.logs._tables.table import Dates, OpenTable, Other
from diffthrust.logs._tables.text import BadCell, seconds_of, text_numbers, times_of_day
from diffthrust.logs._units import CHANNEL_UNITS, convert, same_unit
from diffthrust.logs._validate import PlaceOf, check_stamps, window

_COARSE = 0.1
"""Above this share of repeated time stamps the clock is coarser than the samples."""
_TIMELESS = (
    "; without one, the step of the samples, time = 0.05; a table of readings, whose rows follow "
    "no clock: [logs] time = 0.5, static = true, or read_log(..., time=0.5, static=True)"
)


@dataclass
class _Samples:
    """Numbers of the columns of a table, ``(columns, n)``, NaN where a cell is empty.

    ``rows`` are their positions in the file, ``(n,)``, counted from 1; with ``dates`` the time
    column held dates or durations, and is in seconds already.
    """

    source: OpenTable
    names: list[str]
    numbers: np.ndarray
    rows: np.ndarray
    notes: list[str]
    dates: bool

    def place(self, column: str | None, index: int | None = None) -> Place:
        """The place of a sample in the file, or of a column."""
        return self.source.place(column, None if index is None else int(self.rows[index]))

    def of(self, column: str) -> np.ndarray:
        """The numbers of a column, ``(n,)``."""
        return self.numbers[self.names.index(column)]

    def keep(self, rows: np.ndarray) -> None:
        """Keep only the marked rows: booleans, ``(n,)``."""
        self.numbers, self.rows = self.numbers[:, rows], self.rows[rows]

    def drop_blank_rows(self) -> None:
        """Drop rows that hold no number, and note how many; InputError if all are blank."""
        blank = np.logical_and.reduce(np.isnan(self.numbers))
        if blank.all():
            raise InputError(
                f"{self.source.file}: expected samples, found none in {blank.size} rows.",
                "check that the recording was saved, and that the columns are the right ones.",
            )
        if not blank.any():
            return
        trailing = int(np.argmin(blank[::-1]))
        inner = int(blank.sum()) - trailing
        self.keep(~blank)
        counts = ((trailing, "trailing blank", "trimmed"), (inner, "blank", "skipped"))
        for count, what, done in counts:
            if count:
                self.notes.append(f"{count} {what} row{'s were' if count > 1 else ' was'} {done}.")

    def cut(self, stamps: np.ndarray, start: float | None, stop: float | None) -> np.ndarray:
        """Keep the rows from start to stop [s after the first], and note how many were cut.

        Takes the time stamps [s], ``(n,)``, and returns those that are kept.
        """
        keep = window(stamps, start, stop, self.source.file)
        if not keep.all():
            self.keep(keep)
            last = "the end" if stop is None else f"{stop:g} s"
            self.notes.append(
                f"{int((~keep).sum())} of {keep.size} samples were cut, those outside "
                f"{start or 0.0:g} s to {last}."
            )
        return stamps[keep]

    def drop_repeats(self, stamps: np.ndarray, clock: str) -> np.ndarray:
        """Skip rows that were written twice; report a clock that is coarser than the samples.

        Takes the time stamps [s], ``(n,)``, and returns those that are kept.
        """
        repeated = np.append(False, np.diff(stamps) == 0)
        count = int(repeated.sum())
        if not count:
            return stamps
        if count > max(_COARSE * stamps.size, 1):
            changes = np.flatnonzero(~repeated[1:]) + 1  # between these, whole ticks of the clock
            first, last = changes[[0, -1]] if changes.size > 1 else (0, stamps.size - 1)
            step = float(stamps[last] - stamps[first]) / max(int(last - first), 1) or 0.1
            raise InputError.at(
                self.place(clock),
                f"expected time stamps that increase, found {count} of {stamps.size} that repeat "
                "the previous stamp: the clock is coarser than the samples.",
                f"where the samples are evenly spaced, give their step in seconds, such as "
                f"time = {step:.3g}; otherwise log finer stamps.",
            )
        # A row counts as written twice only if every value repeats with its stamp; different values
        # at one stamp are a defect that `checked_fields` reports.
        old, new = self.numbers[:, :-1], self.numbers[:, 1:]
        same = ((old == new) | (np.isnan(old) & np.isnan(new))).all(axis=0)
        double = repeated & np.append(False, same)
        if count := int(double.sum()):
            self.keep(~double)
            rows = "a row was" if count == 1 else f"{count} rows were"
            self.notes.append(f"{rows} skipped: written twice.")
        return stamps[~double]


class TableRequest:
    """The columns and options requested of a table, which are those of `read_log`; checked."""

    def __init__(
        self,
        file: str,
        time: str | Column | float | None,
        inputs: Mapping[str, str | Column] | None,
        measured: Mapping[str, str | Column] | None,
        missing_values: Sequence[str | float],
        interpolate_inputs: bool,
        start: float | None,
        stop: float | None,
        static: bool,
    ) -> None:
        self.inputs, self.measured = channel_columns(file, inputs, measured)
        self.columns = {**self.inputs, **self.measured}
        self.clock: Column | None = None
        self.step = 1.0
        if isinstance(time, int | float) and not isinstance(time, bool):
            expected = "a time column, or a step above zero"
            mend = "give the name of the column, or the step in seconds."
            self.step = finite(file, time, lambda step: step > 0, expected, mend)
        elif time is not None:
            named: dict[str, Any] = {"time": time}
            self.clock = each_column(named, file, "time")["time"]
        words = (missing_values,) if isinstance(missing_values, str | float) else missing_values
        self.missing = frozenset(str(word).strip() for word in words)
        self.start, self.stop = (
            None
            if value is None
            else finite(file, value, lambda _: True, f"{word} in seconds", "give a number.")
            for word, value in (("start", start), ("stop", stop))
        )
        self.options = {"interpolate_inputs": interpolate_inputs, "static": static or time is None}

    @property
    def wanted(self) -> list[str]:
        """The names of the columns, the time column first."""
        clock = () if self.clock is None else (self.clock,)
        return list(dict.fromkeys(c.column for c in (*clock, *self.columns.values())))

    def fields(self, source: OpenTable, name: str) -> dict[str, Any]:
        """The fields of the log of that name."""
        samples = self._samples(source)
        samples.notes += self._unit_notes(samples)
        # The order matters: a row of marks ("n/a" everywhere) is blank, and a blank row needs no
        # time stamp.
        for word in self.missing:
            with suppress(ValueError):  # a number that means missing, such as -999
                samples.numbers[samples.numbers == float(word)] = np.nan
        samples.drop_blank_rows()

        def at(channel: str, index: int | None) -> Place:
            column = self.clock if channel == "time" else self.columns[channel]
            return samples.place(column.column if column else None, index)

        stamps = self._stamps(samples, at)
        if self.start is not None or self.stop is not None:
            stamps = samples.cut(stamps, self.start, self.stop)
        if self.clock is not None:
            stamps = samples.drop_repeats(stamps, self.clock.column)
        return fields_of_columns(
            self.inputs,
            self.measured,
            time=stamps,
            values={key: samples.of(column.column) for key, column in self.columns.items()},
            name=name,
            notes=samples.notes,
            at=at,
            **self.options,
        )

    def _samples(self, source: OpenTable) -> _Samples:
        """The wanted columns as numbers; only that of the time may hold dates."""
        clock = "" if self.clock is None else self.clock.column
        for name in self.wanted:
            _check_column(source, name, name == clock)
        content = source.read(self.wanted, self.missing)
        columns: list[np.ndarray] = []
        notes, dates, commas = [*source.notes], False, []
        for name in self.wanted:
            cells = content[name]
            if isinstance(cells, Other):
                problem = f"expected numbers, found {cells.description}."
                raise InputError.at(source.place(name), problem, source.mend)
            form = self.clock.dates if self.clock and name == clock else None
            values, are_dates, have_commas = _numbers(source, name, cells, form, self.missing)
            columns.append(values)
            if values.size != columns[0].size:
                problem = f"expected {columns[0].size} samples as in {self.wanted[0]!r}, found "
                problem += f"{values.size}."
                raise InputError.at(source.place(name), problem, "save columns of equal length.")
            if have_commas:
                commas.append(name)
                notes.append(f"column {name!r}: decimal commas were read as decimal points.")
            if are_dates:
                dates = True
                notes.append("the time stamps were read as dates, in seconds after the first.")
        # 1,5 in one column and 1.500 in another: the second may be 1.5 or 1500, so the log notes
        # the choice.
        for name, cells in content.items() if commas else ():
            if isinstance(cells, np.ndarray | Dates | Other) or (dates and name == clock):
                continue
            if name not in commas and any(cell and "." in cell for cell in cells):
                notes.append(
                    f"column {name!r} has points where others have decimal commas: they were read "
                    "as decimal points."
                )
        rows = np.arange(1, columns[0].size + 1) if source.rows is None else source.rows
        return _Samples(source, self.wanted, np.stack(columns), rows, notes, dates)

    def _unit_notes(self, samples: _Samples) -> list[str]:
        """Notes on columns that are read in another unit than the file states."""
        notes = []
        clock = {} if self.clock is None or samples.dates else {"time": self.clock}
        for channel, column in {**clock, **self.columns}.items():
            stated = samples.source.units.get(column.column, "")
            default = "s" if channel == "time" else CHANNEL_UNITS.get(channel, "")
            unit = column.kept_unit
            if not stated or same_unit(stated, unit or default) or unit == "effort":
                continue
            if default and not unit:
                raise InputError.at(
                    samples.place(column.column),
                    f"the file says {stated!r}, no unit is given, and by default {channel!r} is "
                    f"read in {default!r}.",
                    f"give the unit of the numbers: Column({column.column!r}, unit={stated!r}), "
                    f'in a spec file unit = "{stated}".',
                )
            read = f"read in {unit!r}" if unit else "and no unit is given"
            notes.append(f"{channel!r}: the file says {stated!r} of {column.column!r}, {read}.")
        return notes

    def _stamps(self, samples: _Samples, at: PlaceOf) -> np.ndarray:
        """The time stamps in seconds, finite."""
        if self.clock is None:
            return np.arange(samples.rows.size) * self.step
        stamps, unit = samples.of(self.clock.column), "s"
        if not samples.dates:
            unit = self.clock.unit or "s"
            with np.errstate(all="ignore"):
                stamps = stamps * float(self.clock.scale) + float(self.clock.offset)
            if unit == "s" and (seconds := times_of_day(stamps)) is not None:
                stamps = seconds
                samples.notes.append("the time stamps were read as times of day, hhmmss.")
        stamps = convert(stamps, unit, "s", where=at("time", None))
        check_stamps(stamps, at)
        return stamps


def _check_column(source: OpenTable, name: str, is_clock: bool) -> None:
    """Raise InputError unless one column has this name; a table may have no time column at all."""
    word = source.column_word
    count = list(source.names).count(name)
    if not count:
        near = nearest(name, source.names, "; ")
        raise InputError.at(
            Place(source.file, name),
            f"expected a {word} {name!r}, found {listing(source.names)}.",
            f"write the name of the {word} exactly as in the file{near}"
            f"{_TIMELESS if is_clock and not near else ''}.",
        )
    if count > 1:
        problem = f"expected one {word} {name!r}, found several of that name."
        mend = f"rename or remove the other {word}."
        raise InputError.at(Place(source.file, name), problem, mend)


def _numbers(
    source: OpenTable,
    name: str,
    cells: np.ndarray | Dates | Sequence[str | None],
    form: str | None,
    missing: Collection[str],
) -> tuple[np.ndarray, bool, bool]:
    """The numbers of a column, whether they are dates, and whether they had decimal commas.

    ``form`` is the date format of the time column, else None.
    """
    if isinstance(cells, Dates):
        if form is None:
            problem = "expected numbers, found dates."
            mend = "choose a column of numbers; dates are read as the time."
            raise InputError.at(source.place(name), problem, mend)
        return cells.seconds, True, False
    if isinstance(cells, np.ndarray):
        return cells, False, False
    try:
        if form:
            return seconds_of(cells, missing, form), True, False
        return text_numbers(cells, missing, source.comma, form is not None)
    except BadCell as bad:
        row = bad.index + 1 if source.rows is None else int(source.rows[bad.index])
        raise bad.error(source.place(name, row), form or "") from None
