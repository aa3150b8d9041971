"""Read columns of Parquet files."""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.logs._largest import MemoryBudget
from diffthrust.logs._tables.frame import series_cells
from diffthrust.logs._tables.source import Cells, OpenTable, Other
from diffthrust.logs._tables.table import damaged


def read_parquet(path: Path) -> OpenTable:
    """Open a Parquet file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    budget = MemoryBudget(path)
    budget.take(path.stat().st_size)
    try:
        data = path.read_bytes()
        plain = pq.ParquetFile(pa.BufferReader(data))
        # Reversed: of equal names the first one counts.
        kinds = {field.name: field.type for field in reversed(plain.schema_arrow)}
        # Keep equal texts once, as the file does: unpacked, they may take many times its size.
        texts = [name for name, kind in kinds.items() if _is_text(kind)]
        source = pq.ParquetFile(pa.BufferReader(data), read_dictionary=texts) if texts else plain
        names = list(plain.schema_arrow.names)
        rows = source.metadata.num_rows
        budget.take(8 * rows)
    except InputError:
        raise
    except Exception as error:  # a damaged file raises exceptions of any kind
        raise damaged(path, "Parquet", error) from None

    def read(wanted: Sequence[str], missing: Collection[str]) -> dict[str, Cells]:
        chosen = [n for n in dict.fromkeys(wanted) if not pa.types.is_nested(kinds[n])]
        MemoryBudget(path).take(_unpacked_size(source.metadata, chosen))
        try:
            data = source.read(columns=chosen)
            # Arrow trusts the offsets inside a file; with damaged ones a later access reads foreign
            # memory.
            data.validate(full=True)
            columns = {name: data.column(name) for name in chosen}
        except Exception as error:
            raise damaged(path, "Parquet", error) from None
        unreadable = {name: Other(f"values of type {kinds[name]}") for name in wanted}
        return unreadable | {name: _cells(columns[name]) for name in chosen}

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


def _is_text(kind: Any) -> bool:
    import pyarrow as pa

    return pa.types.is_string(kind) or pa.types.is_large_string(kind)


def _cells(column: Any) -> Cells:
    unreadable = Other(f"values of type {column.type}")
    try:
        cells = series_cells(column.to_pandas())
    except Exception:  # values that pandas cannot hold
        return unreadable
    return unreadable if isinstance(cells, Other) else cells
