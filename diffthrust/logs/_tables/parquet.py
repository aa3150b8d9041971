"""Columns of Parquet files."""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust.logs._tables.source import Cells, Dates, OpenTable, Other
from diffthrust.logs._tables.table import damaged


def read_parquet(path: Path) -> OpenTable:
    """Open a Parquet file.

    Raises:
        InputError: the file is damaged.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        source = pq.ParquetFile(pa.BufferReader(path.read_bytes()))
        names = list(source.schema_arrow.names)
        rows = source.metadata.num_rows
    except Exception as error:  # a damaged file raises whatever the reader came across
        raise damaged(path, "Parquet", error) from None

    def read(wanted: Sequence[str], missing: Collection[str]) -> dict[str, Cells]:
        try:
            data = source.read(columns=list(dict.fromkeys(wanted)))
            data.validate(full=True)
            columns = {name: data.column(name).combine_chunks() for name in wanted}
        except Exception as error:
            raise damaged(path, "Parquet", error) from None
        return {name: _cells(column) for name, column in columns.items()}

    return OpenTable(path.name, "Parquet table", names, read, np.arange(1, rows + 1))


def _cells(column: Any) -> Cells:
    import pyarrow as pa

    other = Other(f"values of type {column.type}")
    try:
        kind = column.type
        if pa.types.is_dictionary(kind):
            column = column.dictionary_decode()
            kind = column.type
        if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
            ticks = column.cast(pa.int64())
            per_second = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[kind.unit]
            valid = ticks.drop_null()
            if pa.types.is_timestamp(kind) and len(valid):
                # Subtracted as integers: a float64 keeps only 0.2 us of a date.
                first = valid[0].as_py()
                ticks = pa.array([None if t is None else t - first for t in ticks.to_pylist()])
            return Dates(ticks.cast(pa.float64()).to_numpy(zero_copy_only=False) / per_second)
        if pa.types.is_string(kind) or pa.types.is_large_string(kind):
            return column.to_pylist()
        if pa.types.is_boolean(kind):
            column = column.cast(pa.uint8())
        elif not (
            pa.types.is_integer(kind)
            or pa.types.is_floating(kind)
            or pa.types.is_decimal(kind)
            or pa.types.is_null(kind)
        ):
            return other
        numbers = column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
        return np.array(numbers, dtype=np.float64)
    except Exception:  # a type that Arrow cannot cast
        return other
