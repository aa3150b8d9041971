"""Columns of numbers out of Parquet files."""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.logs._tables.table import (
    BadCell,
    Table,
    absent_column,
    cells_to_column,
    damaged,
    not_a_number,
    twice,
)


def read_parquet(
    path: Path, wanted: Sequence[str], time: str | None, missing: Collection[str]
) -> Table:
    """Read the wanted columns of a Parquet file.

    Args:
        path: the file.
        wanted: names of the columns.
        time: name of the time column, which may hold dates or durations.
        missing: texts that mean missing in a column of text.

    Returns:
        The table.

    Raises:
        InputError: the file is damaged, or a column is absent or holds no numbers.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        source = pq.ParquetFile(pa.BufferReader(path.read_bytes()))
        names = list(source.schema_arrow.names)
    except Exception as error:  # a damaged file raises whatever the reader came across
        raise damaged(path, "Parquet", error) from None
    for name in wanted:
        if names.count(name) != 1:
            if name in names:
                raise twice(path.name, name, "column")
            raise absent_column(path.name, name, names, "column")
    try:
        data = source.read(columns=list(dict.fromkeys(wanted)))
        data.validate(full=True)
        columns = {name: data.column(name).combine_chunks() for name in wanted}
    except Exception as error:
        raise damaged(path, "Parquet", error) from None
    table = Table(path.name, {}, np.arange(1, data.num_rows + 1), row_word="row")
    for name, column in columns.items():
        try:
            table.columns[name] = _arrow_numbers(column, name == time, missing, table)
        except BadCell as bad:
            raise not_a_number(table.place(name, bad.index), bad) from None
        except Exception:
            raise InputError.at(
                table.place(name),
                f"expected numbers, found values of type {column.type}.",
                "choose a column of numbers.",
            ) from None
    return table


def _arrow_numbers(column: Any, is_time: bool, missing: Collection[str], table: Table) -> Any:
    import pyarrow as pa

    kind = column.type
    if pa.types.is_dictionary(kind):
        column = column.dictionary_decode()
        kind = column.type
    if is_time and (pa.types.is_timestamp(kind) or pa.types.is_duration(kind)):
        ticks = column.cast(pa.int64())
        per_second = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[kind.unit]
        valid = ticks.drop_null()
        if pa.types.is_timestamp(kind) and len(valid):
            # Subtracted as integers: a float64 keeps only 0.2 us of a date.
            first = valid[0].as_py()
            ticks = pa.array([None if t is None else t - first for t in ticks.to_pylist()])
        table.say_dates()
        return ticks.cast(pa.float64()).to_numpy(zero_copy_only=False) / per_second
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        numbers, how = cells_to_column(column.to_pylist(), missing, comma=False, is_time=is_time)
        if how == "date":
            table.say_dates()
        return numbers
    if pa.types.is_boolean(kind):
        column = column.cast(pa.uint8())
    elif not (
        pa.types.is_integer(kind)
        or pa.types.is_floating(kind)
        or pa.types.is_decimal(kind)
        or pa.types.is_null(kind)
    ):
        raise TypeError(kind)
    numbers = column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
    return np.array(numbers, dtype=np.float64)
