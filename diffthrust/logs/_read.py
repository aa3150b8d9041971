"""Read logs from files with tables: each format has its reader, and columns become channels."""

from collections.abc import Collection, Mapping, Sequence
from os import PathLike
from pathlib import Path

from diffthrust._support.errors import InputError, os_errors_as
from diffthrust._support.visible import in_line
from diffthrust.logs._columns import Column
from diffthrust.logs._identity import log_file
from diffthrust.logs._kinds import EXCEL, HDF5, MAT, PARQUET, Kind, kind_of
from diffthrust.logs._log import Log
from diffthrust.logs._tables.csv import read_csv
from diffthrust.logs._tables.excel import read_excel
from diffthrust.logs._tables.frame import read_parquet
from diffthrust.logs._tables.mat import read_hdf5, read_mat
from diffthrust.logs._tables.request import TableRequest
from diffthrust.logs._tables.table import OpenTable

_READERS = {PARQUET: read_parquet, HDF5: read_hdf5, MAT: read_mat}


def open_table(
    path: Path, kind: Kind, wanted: Collection[str], sheet: str | None = None, strict: bool = True
) -> OpenTable:
    """Open a file with a table, whose header has the wanted names.

    If not ``strict``, rows that do not fit the header are cut or padded instead of refused.
    """
    if sheet is not None and kind is not EXCEL:
        raise InputError(
            f"{path.name}: a sheet is named, expected an Excel file, found {kind.article}.",
            "leave the sheet out.",
        )
    with os_errors_as(f"{path}: the file cannot be opened", "check its name and permissions."):
        if kind is EXCEL:
            return read_excel(path, wanted, sheet)
        return _READERS[kind](path) if kind in _READERS else read_csv(path, wanted, strict)


def read_log(
    path: str | PathLike[str],
    *,
    time: str | Column | float | None = "time",
    inputs: Mapping[str, str | Column] | None = None,
    measured: Mapping[str, str | Column] | None = None,
    sheet: str | None = None,
    missing_values: Sequence[str | float] = (),
    interpolate_inputs: bool = False,
    start: float | None = None,
    stop: float | None = None,
    rate: float | None = None,
    name: str | None = None,
    static: bool = False,
) -> Log:
    """Read a log from a file with a table: CSV, Excel, Parquet, MATLAB or HDF5.

    The format is recognized by content, not by suffix. Nothing is dropped silently: ``log.notes``
    counts rows skipped above and below the header, blank rows, missing samples, interpolated
    inputs and samples cut by ``start`` and ``stop``, and names the largest gaps.

    Args:
        path: a text file (.csv, .tsv, .txt), an Excel file (.xlsx, with ``pip install
            'diffthrust[excel]'``), .parquet (``'diffthrust[parquet]'``), .mat, or .h5.
        time: the time column, in seconds where no unit is given; dates become seconds after the
            first. A number is the step [s] of samples without time stamps. None for a static table,
            whose rows are then counted 0, 1, 2, ...
        inputs: the column of each input, by channel name. In MATLAB's files ``"run.speed"`` is a
            field of a struct and ``"data(:,2)"`` a column of a matrix.
        measured: the column of each measured channel, by channel name; its empty cells become NaN.
        sheet: the sheet of an Excel file; if None, the sheet that has the columns.
        missing_values: texts or numbers in the file that mean missing, such as ``"n/a"``.
        interpolate_inputs: fill missing samples of inputs instead of refusing them.
        start: first moment to keep, in seconds after the first time stamp.
        stop: last moment to keep, in seconds after the first time stamp.
        rate: samples a second to bring the log to, as by `Log.resampled`: for rows that were merged
            from messages of several rates, or come much faster than the motion.
        name: name of the log; by default the file's name.
        static: the rows are points of a static table, each held for the step that ``time`` gives.

    Returns:
        The log, in the library's units.

    Raises:
        InputError: the file or a column cannot be used. The message names file, line and
            column, what was expected and found, and the mend.

    Example:
        >>> record = dft.read_log(
        ...     "run1.csv",
        ...     inputs={"command": dft.Column("command", unit="V")},
        ...     measured={"speed": dft.Column("speed", unit="rad/s")},
        ... )
        >>> record.time.shape, record.units["speed"]
        ((240,), 'rad/s')
    """
    file = Path(path)
    request = TableRequest(
        file.name, time, inputs, measured, missing_values, interpolate_inputs, start, stop, static
    )
    kind = kind_of(file)
    if kind.messages:
        raise InputError(
            f"{file.name}: expected a table, found {kind.article}, whose messages have separate "
            "time stamps.",
            "read it with read_robot_log, and choose a time base: base = 'messages'.",
        )
    source = open_table(file, kind, request.wanted, sheet)
    fields = request.fields(source, in_line(file.name if name is None else str(name)))
    log = Log.of_checked({**fields, "file": log_file(file)})
    if rate is None:
        return log
    if log.static:
        raise InputError(
            f"{file.name}: a static table has no rate, found rate = {rate!r}.",
            "leave rate out, or name the time column.",
        )
    return log.resampled(rate)
