"""Logs out of files: columns are mapped to channels, and every defect is told with its place."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.logs._log import Log
from diffthrust.logs._tables.csv import read_csv
from diffthrust.logs._tables.mat import read_mat
from diffthrust.logs._tables.parquet import read_parquet
from diffthrust.logs._tables.table import Table
from diffthrust.logs._units import convert
from diffthrust.logs._validate import HOLDS, checked_fields, others, window

_TEXT = (".csv", ".txt", ".tsv")
_SUFFIXES = (*_TEXT, ".parquet", ".mat")


@dataclass(frozen=True)
class Column:
    """How a column of a file becomes a channel of a log.

    Args:
        column: name of the column, exactly as in the file; in a MATLAB struct as ``a.b``, in a
            robot's log as ``MESSAGE.FIELD``.
        unit: unit in which the column is written; empty where it is the model's unit.
        unsigned: the sensor reports the absolute value.
        noise: known standard deviation, in the unit of the column.
        hold: for an input, ``"zero"`` (keeps its last value) or ``"linear"``.
        scale: multiplies the numbers, such as -1 for a sensor that is mounted backward.

    Example:
        >>> Column("rpm", unit="rpm", unsigned=True).scale
        1.0
    """

    column: str
    unit: str = ""
    unsigned: bool = False
    noise: float | None = None
    hold: str = "zero"
    scale: float = 1.0


def read_log(
    path: str | PathLike[str],
    *,
    time: str | Column | None = "time",
    inputs: Mapping[str, str | Column] | None = None,
    measured: Mapping[str, str | Column] | None = None,
    missing_values: Sequence[str] = (),
    interpolate_inputs: bool = False,
    start: float | None = None,
    stop: float | None = None,
    name: str | None = None,
) -> Log:
    """Read a log from a CSV, Parquet or MATLAB file.

    Nothing is dropped silently: ``log.notes`` counts blank rows, missing samples, interpolated
    inputs and what ``start`` and ``stop`` cut away.

    Args:
        path: a file ending in .csv, .txt, .tsv, .parquet or .mat (MATLAB up to version 7).
        time: the time column, in seconds where no unit is given; dates become seconds after the
            first. None for a static table, whose samples are then counted 0, 1, 2, ...
        inputs: the column of each input, by channel name.
        measured: the column of each measured channel, by channel name; its empty cells become NaN.
        missing_values: texts or numbers in the file that mean missing, such as ``"n/a"``.
        interpolate_inputs: fill missing samples of inputs instead of refusing them.
        start: first moment to keep, in seconds after the first time stamp.
        stop: last moment to keep, in seconds after the first time stamp.
        name: name of the log; the file's name where not given.

    Returns:
        The log, in the library's units.

    Raises:
        InputError: the file or a part of it cannot be used. The message names file, line and
            column, what was expected and found, and the mend.

    Example:
        >>> log = read_log(
        ...     "run1.csv",
        ...     time=Column("t", unit="ms"),
        ...     inputs={"command": Column("u", unit="V")},
        ...     measured={"speed": Column("rpm", unit="rpm", unsigned=True)},
        ... )  # doctest: +SKIP
    """
    file = Path(path)
    columns = described(file, inputs, measured)
    clock = None if time is None else _described({"time": time}, file, "time")["time"]
    if isinstance(missing_values, str):
        missing_values = (missing_values,)
    missing = frozenset(str(word).strip() for word in missing_values)
    for word, value in (("start", start), ("stop", stop)):
        if value is not None and not is_finite(value):
            raise InputError(
                f"{file.name}: expected {word} in seconds, found {value!r}.", "give a number."
            )

    wanted = list(dict.fromkeys(c.column for c in (clock, *columns.values()) if c is not None))
    table = _load(file, wanted, None if clock is None else clock.column, missing)
    _mark_missing(table, missing)
    notes = [*table.notes, *_drop_blank_rows(table)]
    stamps = _stamps(table, clock)

    def at(channel: str, index: int | None) -> str:
        if channel == "time":
            return table.place(clock.column if clock else None, index)
        return table.place(columns[channel].column, index)

    if start is not None or stop is not None:
        stamps, sentence = _cut(table, stamps, start, stop)
        notes += [sentence] if sentence else []

    def numbers(channels: Mapping[str, Any] | None) -> dict[str, np.ndarray]:
        with np.errstate(all="ignore"):
            return {
                key: table.columns[columns[key].column] * float(columns[key].scale)
                for key in channels or {}
            }

    return Log._of(
        checked_fields(
            time=stamps,
            inputs=numbers(inputs),
            measured=numbers(measured),
            units={key: column.unit for key, column in columns.items()},
            unsigned=[key for key in measured or {} if columns[key].unsigned],
            noise={
                key: sigma for key in measured or {} if (sigma := columns[key].noise) is not None
            },
            hold={key: columns[key].hold for key in inputs or {}},
            name=file.name if name is None else str(name),
            interpolate_inputs=interpolate_inputs,
            notes=tuple(notes),
            at=at,
        )
    )


def is_finite(value: Any) -> bool:
    """Whether a value is a finite number."""
    return isinstance(value, (int, float, np.number)) and math.isfinite(value)


def described(
    file: Path,
    inputs: Mapping[str, str | Column] | None,
    measured: Mapping[str, str | Column] | None,
) -> dict[str, Column]:
    """Give the column of each channel.

    Raises:
        InputError: a channel is named twice or ``"time"``, none is named, or one is ill described.
    """
    columns = {
        **_described(inputs, file, "inputs"),
        **_described(measured, file, "measured"),
    }
    both = set(inputs or {}) & set(measured or {})
    if both or "time" in columns:
        raise InputError(
            f"{file.name}: the channel {sorted(both)[0] if both else 'time'!r} is named twice, "
            "expected once among time, inputs and measured.",
            "give it under one of them.",
        )
    if not columns:
        raise InputError(
            f"{file.name}: expected the columns to read, found none named.",
            "name at least one input or measured channel.",
        )
    return columns


def _described(
    channels: Mapping[str, str | Column] | None, file: Path, what: str
) -> dict[str, Column]:
    described = {}
    for key, column in (channels or {}).items():
        column = Column(column) if isinstance(column, str) else column
        place = f"{file.name}, channel {key!r}"
        if not isinstance(column, Column) or not isinstance(column.column, str):
            raise InputError(
                f"{place}: expected the name of a column or a Column, found {column!r}.",
                f"write {what} = {{{key!r}: 'name of the column'}}.",
            )
        if not is_finite(column.scale) or column.scale == 0:
            raise InputError(
                f"{place}: expected a scale other than zero, found {column.scale!r}.",
                "give the factor by which the numbers are to be multiplied.",
            )
        if column.hold not in HOLDS:
            raise InputError(
                f"{place}: expected a hold of 'zero' or 'linear', found {column.hold!r}.",
                "write 'zero' for a held command, 'linear' for a measured input.",
            )
        described[key] = column
    return described


def _load(file: Path, wanted: list[str], time: str | None, missing: frozenset[str]) -> Table:
    suffix = file.suffix.lower()
    if suffix not in _SUFFIXES:
        raise InputError(
            f"{file.name}: expected a file ending in {', '.join(_SUFFIXES)}, found {suffix!r}.",
            "export the log in one of these forms; bags and ArduPilot logs are read by "
            "read_robot_log.",
        )
    try:
        if file.stat().st_size == 0:
            raise InputError(
                f"{file.name}: expected a header and samples, found an empty file.",
                "check that the recording was saved.",
            )
        if suffix in _TEXT:
            return read_csv(file, wanted, time, missing)
        if suffix == ".parquet":
            return read_parquet(file, wanted, time, missing)
        return read_mat(file, wanted)
    except FileNotFoundError:
        raise InputError(
            f"{file}: expected a file, found none.", "check the folder and the name of the file."
        ) from None
    except IsADirectoryError:
        raise InputError(f"{file}: expected a file, found a folder.", "name the file.") from None
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            f"{file}: the file cannot be opened ({error}).", "check its name and permissions."
        ) from None


def _mark_missing(table: Table, missing: frozenset[str]) -> None:
    """Turn numbers that mean missing, such as -999, into NaN."""
    for word in missing:
        try:
            number = float(word)
        except ValueError:
            continue
        for values in table.columns.values():
            values[values == number] = np.nan


def _drop_blank_rows(table: Table) -> list[str]:
    """Drop rows that hold nothing wanted, and say how many."""
    blank = np.logical_and.reduce([np.isnan(values) for values in table.columns.values()])
    count = blank.size
    if blank.all():
        raise InputError(
            f"{table.file}: expected samples, found none in {count} rows.",
            "check that the recording was saved, and that the columns are the right ones.",
        )
    if not blank.any():
        return []
    trailing = int(np.argmin(blank[::-1]))
    inner = int(blank.sum()) - trailing
    table.columns = {name: values[~blank] for name, values in table.columns.items()}
    table.rows = table.rows[~blank]
    notes = []
    if trailing:
        notes.append(
            f"{trailing} trailing blank row{'s were' if trailing > 1 else ' was'} trimmed."
        )
    if inner:
        notes.append(f"{inner} blank row{'s were' if inner > 1 else ' was'} skipped.")
    return notes


def _stamps(table: Table, clock: Column | None) -> np.ndarray:
    """Give the time stamps in seconds, finite."""
    if clock is None:
        return np.arange(table.rows.size, dtype=np.float64)
    place = table.place(clock.column)
    with np.errstate(all="ignore"):
        stamps = table.columns[clock.column] * float(clock.scale)
    unit = "s" if table.dates else clock.unit or "s"
    stamps = convert(stamps, unit, "s", where=place)
    bad = np.flatnonzero(~np.isfinite(stamps))
    if bad.size:
        found = "none" if np.isnan(stamps[bad[0]]) else str(stamps[bad[0]])
        raise InputError(
            f"{table.place(clock.column, int(bad[0]))}: expected a time stamp, found {found}"
            f"{others(bad.size)}.",
            "complete the time stamp, or remove the row.",
        )
    return stamps


def _cut(
    table: Table, stamps: np.ndarray, start: float | None, stop: float | None
) -> tuple[np.ndarray, str]:
    keep = window(stamps, start, stop)
    first = 0.0 if start is None else start
    last = "the end" if stop is None else f"{stop:g} s"
    if not keep.any():
        raise InputError(
            f"{table.file}: expected samples from {first:g} s to {last} after the first, "
            f"found none; the log lasts {stamps[-1] - stamps[0]:.6g} s.",
            "choose start and stop inside the log.",
        )
    if keep.all():
        return stamps, ""
    table.columns = {name: values[keep] for name, values in table.columns.items()}
    table.rows = table.rows[keep]
    return stamps[keep], (
        f"{int((~keep).sum())} of {keep.size} samples were cut, those outside {first:g} s "
        f"to {last}."
    )
