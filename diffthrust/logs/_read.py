"""Logs out of files: columns are mapped to channels, and every defect is told with its place."""

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path

import numpy as np

from diffthrust._support.errors import InputError, Place
from diffthrust.logs._columns import (
    Column,
    channel_columns,
    each_column,
    is_finite,
    log_of_columns,
)
from diffthrust.logs._identity import log_file
from diffthrust.logs._log import Log
from diffthrust.logs._tables.csv import read_csv
from diffthrust.logs._tables.mat import read_mat
from diffthrust.logs._tables.parquet import read_parquet
from diffthrust.logs._tables.table import Table
from diffthrust.logs._units import convert
from diffthrust.logs._validate import others

_TEXT = (".csv", ".txt", ".tsv")
_SUFFIXES = (*_TEXT, ".parquet", ".mat")


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
    columns = channel_columns(file, inputs, measured)
    clock = None if time is None else each_column({"time": time}, file, "time")["time"]
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
    table.mark_missing(missing)
    table.drop_blank_rows()
    stamps = _stamps(table, clock)
    if start is not None or stop is not None:
        stamps = table.cut(stamps, start, stop)

    def at(channel: str, index: int | None) -> Place:
        if channel == "time":
            return table.place(clock.column if clock else None, index)
        return table.place(columns[channel].column, index)

    log = log_of_columns(
        columns,
        inputs or {},
        measured or {},
        time=stamps,
        values={key: table.columns[column.column] for key, column in columns.items()},
        name=file.name if name is None else str(name),
        interpolate_inputs=interpolate_inputs,
        notes=table.notes,
        at=at,
    )
    return log.replaced(file=log_file(file))


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
        raise InputError.at(
            table.place(clock.column, int(bad[0])),
            f"expected a time stamp, found {found}{others(bad.size)}.",
            "complete the time stamp, or remove the row.",
        )
    return stamps
