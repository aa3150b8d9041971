"""Columns of pandas data frames, with the index as the time; cells that are objects."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from datetime import date, datetime, time, timedelta
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.logs._tables.source import Cells, Dates, OpenTable, Other

INDEX = "the index"
"""The name of an index without a name, in messages and requests."""


def read_frame(frame: Any, name: str) -> OpenTable:
    """A pandas DataFrame as a table; its index is read by its name, or as `INDEX`."""
    import pandas as pd

    if not isinstance(frame, pd.DataFrame):
        raise InputError(
            f"{name}: expected a pandas DataFrame, found {type(frame).__name__}.",
            "give a DataFrame; other tables have a method such as to_pandas().",
        )
    columns = {
        ".".join(map(str, c)) if isinstance(c, tuple) else str(c): position
        # Reversed: of several columns with one name the first one counts.
        for position, c in reversed(list(enumerate(frame.columns)))
    }
    names = [".".join(map(str, c)) if isinstance(c, tuple) else str(c) for c in frame.columns]
    index = frame.index
    index_name = None if index.name is None or str(index.name) in columns else str(index.name)

    def read(wanted: Sequence[str], missing: Collection[str]) -> Mapping[str, Cells]:
        return {
            name: series_cells(frame.iloc[:, columns[name]] if name in columns else index)
            for name in wanted
        }

    return OpenTable(
        name, "DataFrame", [*names, index_name or INDEX], read, np.arange(1, len(frame) + 1)
    )


def time_of(frame: Any, name: str) -> str:
    """The name by which the index of a data frame is read as the time."""
    import pandas as pd

    index = frame.index
    if isinstance(index, pd.MultiIndex):
        raise InputError(
            f"{name}: expected an index of one level as the time, found {index.nlevels} levels.",
            "name the time column, as time = 't', or reset the index.",
        )
    if index.name is None and (
        isinstance(index, pd.RangeIndex) or pd.api.types.is_integer_dtype(index.dtype)
    ):
        raise InputError(
            f"{name}: expected a time, found an index that counts rows.",
            "name the time column, as time = 't', give the step in seconds, as time = 0.05, or "
            "name the index where it is a time: frame.index.name = 'time'.",
        )
    named = index.name is not None and str(index.name) not in map(str, frame.columns)
    return str(index.name) if named else INDEX


def series_cells(column: Any) -> Cells:
    """The cells of a column of pandas, or of an index."""
    import pandas as pd

    column = pd.Series(column).reset_index(drop=True)
    unreadable = Other(f"values of type {column.dtype}")
    try:
        # Categories and periods hide the type of their values, by which the branches below decide.
        if isinstance(column.dtype, pd.CategoricalDtype):
            # Of equal texts one object: unpacked, they may take many times the size of a file.
            words = np.array([*column.cat.categories, None], dtype=object)
            column = pd.Series(words[column.cat.codes.to_numpy()], dtype=object)
        if isinstance(column.dtype, pd.PeriodDtype):
            column = column.dt.to_timestamp()
        if column.isna().all():
            return np.full(len(column), np.nan)
        if pd.api.types.is_datetime64_any_dtype(column.dtype):
            column = column - column.dropna().iloc[0]
        if pd.api.types.is_timedelta64_dtype(column.dtype):
            return Dates(column.dt.total_seconds().to_numpy(dtype=np.float64))
        if pd.api.types.is_complex_dtype(column.dtype):
            return unreadable
        if pd.api.types.is_numeric_dtype(column.dtype):  # booleans, too
            return column.to_numpy(dtype=np.float64, na_value=np.nan)
        missing = column.isna()
        cells = [None if no else cell for cell, no in zip(column, missing, strict=True)]
        if any(isinstance(cell, list | dict | tuple | set | bytes | np.ndarray) for cell in cells):
            return unreadable
        return object_cells(cells)
    except (TypeError, ValueError, OverflowError):
        return unreadable


def object_cells(cells: Sequence[Any]) -> Cells:
    """Cells as objects of Python: numbers or dates, where all are, or else text."""
    full = [cell for cell in cells if cell is not None]
    if all(isinstance(cell, int | float | np.number) for cell in full):
        return np.array([np.nan if cell is None else float(cell) for cell in cells])
    if {type(_moment(cell)) for cell in full} in ({datetime}, {timedelta}):
        first = _moment(full[0])
        since = [None if cell is None else _moment(cell) - first for cell in cells]
        return Dates(np.array([np.nan if s is None else s.total_seconds() for s in since]))
    return [None if cell is None else text_of(cell) for cell in cells]


def _moment(cell: Any) -> Any:
    """A date or time as an object that can be subtracted; other cells unchanged."""
    # Excel stores durations as times of day; these cannot be subtracted from each other in Python.
    if isinstance(cell, time):
        return datetime.combine(date.min, cell) - datetime.min
    if isinstance(cell, date) and not isinstance(cell, datetime):
        return datetime(cell.year, cell.month, cell.day)
    return cell


def text_of(cell: Any) -> str:
    """A cell as text; of dates in the notation that is read again."""
    return cell.isoformat() if isinstance(cell, date) else str(cell)
