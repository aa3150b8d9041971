"""Build the fields of a log from an open table: time, channels, and notes on skipped rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError, Place
from diffthrust.logs._channels import CHANNELS
from diffthrust.logs._columns import Column, channel_columns, each_column, fields_of_columns
from diffthrust.logs._tables.source import OpenTable, table_of
from diffthrust.logs._tables.table import Table
from diffthrust.logs._units import convert, same_unit
from diffthrust.logs._validate import PlaceOf, check_stamps, is_finite

# Above this share of repeated time stamps the clock is coarser than the samples.
_COARSE = 0.1


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
        self.columns = channel_columns(Path(file), inputs, measured)
        self.inputs, self.measured = inputs or {}, measured or {}
        self.clock: Column | None = None
        self.step: float | None = None
        if isinstance(time, int | float) and not isinstance(time, bool):
            if not is_finite(time) or time <= 0:
                raise InputError(
                    f"{file}: expected a time column, or a step above zero, found {time!r}.",
                    "give the name of the column, or the step in seconds.",
                )
            self.step = float(time)
        elif time is not None:
            named: dict[str, Any] = {"time": time}
            self.clock = each_column(named, Path(file), "time")["time"]
        words = (missing_values,) if isinstance(missing_values, str | float) else missing_values
        self.missing = frozenset(str(word).strip() for word in words)
        self.interpolate_inputs = interpolate_inputs
        for word, value in (("start", start), ("stop", stop)):
            if value is not None and not is_finite(value):
                raise InputError(
                    f"{file}: expected {word} in seconds, found {value!r}.", "give a number."
                )
        self.start, self.stop = start, stop
        self.static = static or time is None

    @property
    def wanted(self) -> list[str]:
        """The names of the columns, the time column first."""
        clock = () if self.clock is None else (self.clock,)
        return list(dict.fromkeys(c.column for c in (*clock, *self.columns.values())))

    def fields(self, source: OpenTable, name: str) -> dict[str, Any]:
        """The fields of the log of that name."""
        table = table_of(source, self.wanted, self.clock, self.missing)
        table.notes += self._unit_notes(table, source)
        # The order matters: a row of marks ("n/a" everywhere) is blank, and a blank row needs no
        # time stamp.
        table.mark_missing(self.missing)
        table.drop_blank_rows()

        def at(channel: str, index: int | None) -> Place:
            if channel == "time":
                return table.place(self.clock.column if self.clock else None, index)
            return table.place(self.columns[channel].column, index)

        stamps = self._stamps(table, at)
        if self.start is not None or self.stop is not None:
            stamps = table.cut(stamps, self.start, self.stop)
        stamps = _without_repeats(table, stamps, self.clock)

        return fields_of_columns(
            self.columns,
            self.inputs,
            self.measured,
            time=stamps,
            values={key: table.columns[column.column] for key, column in self.columns.items()},
            name=name,
            interpolate_inputs=self.interpolate_inputs,
            notes=table.notes,
            static=self.static,
            at=at,
        )

    def _unit_notes(self, table: Table, source: OpenTable) -> list[str]:
        """Notes on columns that are read in another unit than the file states."""
        notes = []
        clock = {} if self.clock is None or table.dates else {"time": self.clock}
        for channel, column in {**clock, **self.columns}.items():
            file_unit = source.units.get(column.column, "")
            default = (
                "s" if channel == "time" else CHANNELS[channel].unit if channel in CHANNELS else ""
            )
            unit = column.kept_unit
            if not file_unit or same_unit(file_unit, unit or default) or unit == "effort":
                continue
            if default and not unit:
                raise InputError.at(
                    table.place(column.column),
                    f"the file says {file_unit!r}, no unit is given, and by default {channel!r} is "
                    f"read in {default!r}.",
                    f"give the unit of the numbers: Column({column.column!r}, unit={file_unit!r}), "
                    f'in a spec file unit = "{file_unit}".',
                )
            read = f"read in {unit!r}" if unit else "and no unit is given"
            notes.append(f"{channel!r}: the file says {file_unit!r} of {column.column!r}, {read}.")
        return notes

    def _stamps(self, table: Table, at: PlaceOf) -> np.ndarray:
        """The time stamps in seconds, finite."""
        if self.clock is None:
            return np.arange(table.rows.size) * (self.step or 1.0)
        stamps = table.columns[self.clock.column]
        if not table.dates:
            with np.errstate(all="ignore"):
                stamps = stamps * float(self.clock.scale) + float(self.clock.offset)
        unit = "s" if table.dates else self.clock.unit or "s"
        stamps = convert(stamps, unit, "s", where=at("time", None))
        check_stamps(stamps, at)
        return stamps


def _without_repeats(table: Table, stamps: np.ndarray, clock: Column | None) -> np.ndarray:
    """Skip rows that were written twice; report a clock that is coarser than the samples."""
    repeated = np.append(False, np.diff(stamps) == 0)
    count = int(repeated.sum())
    if clock is None or not count:
        return stamps
    if count > _COARSE * stamps.size and count > 1:
        changes = np.flatnonzero(~repeated[1:]) + 1  # between these, whole ticks of the clock
        few = changes.size < 2
        ends = (0, stamps.size - 1) if few else (changes[0], changes[-1])
        step = float(stamps[ends[1]] - stamps[ends[0]]) / max(int(ends[1] - ends[0]), 1) or 0.1
        raise InputError.at(
            table.place(clock.column),
            f"expected time stamps that increase, found {count} of {stamps.size} that repeat the "
            "previous stamp: the clock is coarser than the samples.",
            f"where the samples are evenly spaced, give their step in seconds, such as "
            f"time = {step:.3g}; otherwise log finer stamps.",
        )
    # A row counts as written twice only if every value repeats with its stamp; different values at
    # one stamp are a defect that `checked_fields` reports.
    previous = [np.append(np.nan, values[:-1]) for values in table.columns.values()]
    same = [
        (old == new) | (np.isnan(old) & np.isnan(new))
        for old, new in zip(previous, table.columns.values(), strict=True)
    ]
    double = repeated & np.logical_and.reduce(same)
    if not double.any():
        return stamps
    table.keep(~double)
    count = int(double.sum())
    rows = "a row was" if count == 1 else f"{count} rows were"
    table.notes.append(f"{rows} skipped: written twice.")
    return stamps[~double]
