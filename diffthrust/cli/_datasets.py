"""The command ``diffthrust datasets``: which public logs there are, and where they lie."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from diffthrust.cli._options import show
from diffthrust.cli._session import session


def datasets(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="A data set to fetch; all are listed else.")
    ] = None,
) -> None:
    """List public logs with licence and known defects, or fetch one set and say where it is."""
    with session():
        from diffthrust.datasets import fetch
        from diffthrust.datasets import list as known

        if name is None:
            told: Any = _table(known())
        else:
            folder = fetch(name)
            about = next(about for about in known() if about.name == name)
            told = f"{about}\n  folder    {folder}"
    show(told)


def _table(sets: Any) -> Any:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    table.add_column("name", style="bold cyan", no_wrap=True)
    table.add_column("what it is")
    table.add_column("licence")
    table.add_column("from")
    for about in sets:
        table.add_row(
            about.name,
            about.title,
            about.licence,
            "its public repository" if about.address else "a local folder only (DIFFTHRUST_DATA)",
        )
    return table
