"""The table of what a check of a plan found."""

from __future__ import annotations

from collections.abc import Iterable

from rich.table import Table

from diffthrust._support.tables import rendered


def findings_table(rows: Iterable[tuple[str, ...]]) -> str:
    """What was planned and what was found, as text; a row is cells for the headings."""
    table = Table("Run", "Planned", "Found", "")
    for row in rows:
        table.add_row(*row)
    return rendered(table)
