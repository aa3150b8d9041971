"""Columns of pandas' data frames, with the index as the time, and of Parquet files."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.extras import extra
from diffthrust.logs._tables.table import Cells, Dates, OpenTable, Other
from diffthrust.logs._untrusted import MemoryBudget, reading


def read_frame(frame: Any, name: str) -> OpenTable:
    """A pandas DataFrame as a table; its last column is the index, by its name if it has one."""
    import pandas as pd

    if not isinstance(frame, pd.DataFrame):
        raise InputError(
            f"{name}: expected a pandas DataFrame, found {type(frame).__name__}.",
            "give a DataFrame; other tables have a method such as to_pandas().",
        )
    names = [".".join(map(str, c)) if isinstance(c, tuple) else str(c) for c in frame.columns]
    index = frame.index
    unnamed = index.name is None or str(index.name) in names
    index_name = "the index" if unnamed else str(index.name)

    def read(wanted: Sequence[str], missing: Collection[str]) -> Mapping[str, Cells]:
        return {
            name: _cells(frame.iloc[:, names.index(name)] if name in names else index)
            for name in wanted
        }

    rows = np.arange(1, len(frame) + 1)
    return OpenTable(name, "DataFrame", [*names, index_name], read, rows)


def time_of(frame: Any, source: OpenTable) -> str:
    """The name by which the index of a data frame is read as the time."""
    import pandas as pd

    index = frame.index
    if isinstance(index, pd.MultiIndex):
        raise InputError(
            f"{source.file}: expected an index of one level as the time, found {index.nlevels} "
            "levels.",
            "name the time column, as time = 't', or reset the index.",
        )
    if index.name is None and (
        isinstance(index, pd.RangeIndex) or pd.api.types.is_integer_dtype(index.dtype)
    ):
        raise InputError(
            f"{source.file}: expected a time, found an index that counts rows.",
            "name the time column, as time = 't', give the step in seconds, as time = 0.05, or "
            "name the index where it is a time: frame.index.name = 'time'.",
        )
    return source.names[-1]


def read_parquet(path: Path) -> OpenTable:
    """Open a Parquet file."""
    with extra("parquet", f"{path.name}: reading Parquet"):
        import pyarrow as pa
        import pyarrow.parquet as pq

    budget = MemoryBudget(path)
    budget.take(path.stat().st_size)
    with reading(path, "Parquet"):
        data = path.read_bytes()
        plain = pq.ParquetFile(pa.BufferReader(data))
        # Reversed: of equal names the first one counts.
        kinds = {field.name: field.type for field in reversed(plain.schema_arrow)}
        # Keep equal texts once, as the file does: unpacked, they may take many times its size.
        is_text = (pa.types.is_string, pa.types.is_large_string)
        texts = [name for name, kind in kinds.items() if any(of(kind) for of in is_text)]
        source = pq.ParquetFile(pa.BufferReader(data), read_dictionary=texts) if texts else plain
        rows = source.metadata.num_rows
    budget.take(8 * rows)

    def read(wanted: Sequence[str], missing: Collection[str]) -> dict[str, Cells]:
        chosen = [n for n in dict.fromkeys(wanted) if not pa.types.is_nested(kinds[n])]
        MemoryBudget(path).take(_unpacked_size(source.metadata, chosen))
        with reading(path, "Parquet"):
            table = source.read(columns=chosen)
            # Arrow trusts the offsets inside a file; with damaged ones a later access reads foreign
            # memory.
            table.validate(full=True)
            columns = {name: table.column(name) for name in chosen}
        cells: dict[str, Cells] = {}
        for name in wanted:
            column: Cells | None = None
            with suppress(Exception):  # values that pandas cannot hold
                column = _cells(columns[name].to_pandas()) if name in columns else None
            if column is None or isinstance(column, Other):  # in the words of the file's types
                column = Other(f"values of type {kinds[name]}")
            cells[name] = column
        return cells

    names = list(plain.schema_arrow.names)
    return OpenTable(path.name, "Parquet table", names, read, np.arange(1, rows + 1))


def _unpacked_size(metadata: Any, columns: Collection[str]) -> int:
    """Bytes of unpacked columns: 8 per number, or the size in the file before packing if larger.

    The size in the file alone is not enough: a repeated number is stored once.
    """
    size = 0
    for group in map(metadata.row_group, range(metadata.num_row_groups)):
        for column in map(group.column, range(group.num_columns)):
            if column.path_in_schema in columns:
                values = max(column.num_values, group.num_rows)
                size += max(8 * values, column.total_uncompressed_size)
    return size


def _cells(column: Any) -> Cells:
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
