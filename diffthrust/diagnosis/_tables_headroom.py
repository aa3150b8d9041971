"""The table of a headroom."""

from __future__ import annotations

from collections.abc import Iterable

from rich.table import Table

from diffthrust._support.tables import rendered


def headroom_table(rows: Iterable[tuple[str, ...]]) -> str:
    """What a correction explains of each channel, as text; a row is cells for the headings."""
    table = Table("Channel", "Physics (NRMSE)", "With a correction", "Share explained",
                  "90 % interval", "Form")  # fmt: skip
    for row in rows:
        table.add_row(*row)
    return rendered(table)
