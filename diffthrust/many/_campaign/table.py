"""The table of a campaign: one row for each spec, one column for each quantity."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from diffthrust._support.files import write_whole
from diffthrust.many._campaign.store import Row

if TYPE_CHECKING:
    import pyarrow as pa

TABLE = "campaign.parquet"
_TEXTS = ("name", "spec", "folder", "status", "error", "mend")
_RESULTS = ("model", "effects", "fit_status", "verdict", "added", "notes")
_NUMBERS = ("seconds", "train_nrmse", "holdout_nrmse")
COLUMNS = (*_TEXTS, "seconds", *_RESULTS, "train_nrmse", "holdout_nrmse")
"""The columns that every table has, before those of the parameters."""


def arrow_table(rows: Sequence[Row]) -> pa.Table:
    """The rows as a table, in the order of their names.

    A parameter has its value in the column of its name, and its standard error in another with
    ``_std_error`` behind it. Where a name is taken by another column, ``parameter.`` stands before.
    """
    import pyarrow as pa

    rows = sorted(rows, key=lambda row: row["name"])
    fixed: dict[str, pa.Array] = {}
    for name in COLUMNS:
        kind = pa.float64() if name in _NUMBERS else pa.string()
        fixed[name] = pa.array([row.get(name) for row in rows], kind)
    numbers: dict[str, pa.Array] = {}
    for name in _parameters(rows):
        pairs: list[Any] = [row.get("numbers", {}).get(name) or (None, None) for row in rows]
        column = f"parameter.{name}" if {name, f"{name}_std_error"} & set(fixed) else name
        numbers[column] = pa.array([pair[0] for pair in pairs], pa.float64())
        numbers[f"{column}_std_error"] = pa.array([pair[1] for pair in pairs], pa.float64())
    return pa.table({**fixed, **numbers})


def write_table(path: Path, rows: Sequence[Row]) -> None:
    """Write the table as Parquet, whole or not at all.

    Raises:
        InputError: the file cannot be written.
    """
    import pyarrow.parquet as pq

    out = BytesIO()
    pq.write_table(arrow_table(rows), out)
    write_whole(path, out.getvalue())


def _parameters(rows: Iterable[Row]) -> list[str]:
    return list(dict.fromkeys(name for row in rows for name in row.get("numbers", {})))
