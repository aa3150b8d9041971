"""Columns of pandas data frames, with the index as the time."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
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
            name: _cells(frame.iloc[:, columns[name]] if name in columns else index)
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


def _cells(column: Any) -> Cells:
    import pandas as pd

    kind = column.dtype
    unreadable = Other(f"values of type {kind}")
    try:
        # Categories and periods hide the type of their values, by which the branches below decide.
        if isinstance(kind, pd.CategoricalDtype):
            column = pd.Series(np.asarray(column))
            kind = column.dtype
        if isinstance(kind, pd.PeriodDtype):
            column = pd.Series(column).dt.to_timestamp()
            kind = column.dtype
        if pd.api.types.is_datetime64_any_dtype(kind):
            moments = pd.Series(column).reset_index(drop=True)
            valid = moments.dropna()
            since = (
                moments - valid.iloc[0]
                if len(valid)
                else moments - pd.Timestamp(0, tz=moments.dt.tz)
            )
            return Dates(since.dt.total_seconds().to_numpy(dtype=np.float64))
        if pd.api.types.is_timedelta64_dtype(kind):
            return Dates(pd.Series(column).dt.total_seconds().to_numpy(dtype=np.float64))
        if pd.api.types.is_bool_dtype(kind) or pd.api.types.is_numeric_dtype(kind):
            if pd.api.types.is_complex_dtype(kind):
                return unreadable
            return pd.Series(column).to_numpy(dtype=np.float64, na_value=np.nan)
        cells: list[Any] = [
            None if cell is None or cell is pd.NA or cell is pd.NaT else cell for cell in column
        ]
        cells = [None if isinstance(cell, float) and np.isnan(cell) else cell for cell in cells]
        if all(cell is None or isinstance(cell, str) for cell in cells):
            return cells
        if all(cell is None or isinstance(cell, int | float | np.number) for cell in cells):
            return np.array([np.nan if cell is None else float(cell) for cell in cells])
        if any(isinstance(cell, list | dict | tuple | set | np.ndarray) for cell in cells):
            return unreadable
        return [None if cell is None else str(cell) for cell in cells]
    except (TypeError, ValueError, OverflowError):
        return unreadable
