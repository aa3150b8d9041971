"""The command ``diffthrust datasets``: list public logs, or download a set."""

from __future__ import annotations

from typing import Annotated

import typer

from diffthrust.cli._session import session, show


def datasets_command(
    name: Annotated[
        str | None,
        typer.Argument(metavar="NAME", help="A data set to download; without it all are listed."),
    ] = None,
) -> None:
    """List public logs with licence and known defects, or download a set."""
    with session():
        from diffthrust import datasets
        from diffthrust.cli._tables import datasets_report

        if name is None:
            text = datasets_report(datasets.list())
        else:
            folder = datasets.fetch(name)
            about = next(about for about in datasets.list() if about.name == name)
            text = f"{about}\n  folder    {folder}"
    show(text)
