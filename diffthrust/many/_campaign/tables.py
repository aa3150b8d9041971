"""The table of a campaign, one row for each spec: as a file, and as rows of a report."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from diffthrust._support.files import write_whole
from diffthrust._support.report import Line, Report, Rows, Section, Styled
from diffthrust._support.words import number
from diffthrust.many._campaign.job import ResultRow

if TYPE_CHECKING:
    import pyarrow as pa

_SHOWN = 40
"""Rows of results to print; the file has all."""
TABLE = "campaign.parquet"
_TEXTS = ("name", "spec", "folder", "status", "error", "mend")
_RESULTS = ("model", "effects", "fit_status", "verdict", "added", "notes")
_NUMBERS = ("seconds", "train_nrmse", "holdout_nrmse")
_COLUMNS = (*_TEXTS, "seconds", *_RESULTS, "train_nrmse", "holdout_nrmse")
"""The columns that every table has, before those of the parameters."""


def arrow_table(rows: Sequence[ResultRow]) -> pa.Table:
    """The rows as a table, in the order of their names.

    A parameter's value is in the column of its name, its standard error in a second column with
    the suffix ``_std_error``. Where another column has that name, it gets the prefix ``parameter.``
    """
    import pyarrow as pa

    rows = sorted(rows, key=lambda row: row["name"])
    fixed: dict[str, pa.Array] = {}
    for name in _COLUMNS:
        kind = pa.float64() if name in _NUMBERS else pa.string()
        fixed[name] = pa.array([row.get(name) for row in rows], kind)
    numbers: dict[str, pa.Array] = {}
    for name in dict.fromkeys(name for row in rows for name in row.get("numbers", {})):
        pairs: list[Any] = [row.get("numbers", {}).get(name) or (None, None) for row in rows]
        column = f"parameter.{name}" if {name, f"{name}_std_error"} & set(fixed) else name
        numbers[column] = pa.array([pair[0] for pair in pairs], pa.float64())
        numbers[f"{column}_std_error"] = pa.array([pair[1] for pair in pairs], pa.float64())
    return pa.table({**fixed, **numbers})


def write_table(path: Path, rows: Sequence[ResultRow]) -> None:
    """Write the table as Parquet, whole or not at all."""
    import pyarrow.parquet as pq

    out = BytesIO()
    pq.write_table(arrow_table(rows), out)
    write_whole(path, out.getvalue())


def campaign_report(rows: Sequence[ResultRow], task: str, summary: str) -> Report:
    """The results, then each error with its mend, and a summary."""
    good = [row for row in rows if row["status"] == "ok"]
    more = f"... and {len(good) - _SHOWN} more in the table."
    failures = []
    for row in rows:
        if row["status"] != "ok":
            ending = Styled(f"{row['name']}: {row['status'].replace('_', ' ')}", "bad")
            failures += [Line((ending, f". {row['error']}")), f"  Mend: {row['mend']}"]
    return Report(
        Section("", _result_rows(good, task), more if len(good) > _SHOWN else "", *failures),
        Section("", Styled(summary, "strong")),
    )


def _result_rows(rows: Sequence[ResultRow], task: str) -> Rows:
    last = {"diagnose": ("Verdict", "Added"), "sample": ("Chains",)}.get(task, ())
    cells = []
    for row in rows[:_SHOWN]:
        errors = (number(row["train_nrmse"]), number(row["holdout_nrmse"]))
        words = [row.get(column) or "" for column in ("verdict", "added")[: len(last)]]
        cells.append((row["name"], row["fit_status"], *errors, f"{row['seconds']:.1f}", *words))
    headings = ("Spec", "Fit", "Training NRMSE", "Unseen NRMSE", "Seconds", *last)
    return Rows.of(headings, cells, numbers=(2, 3, 4))
