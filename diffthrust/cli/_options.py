"""What the commands of the command line share: options, and how results are shown."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from diffthrust._support.errors import InputError

SpecPath = Annotated[
    Path, typer.Argument(metavar="SPEC", help="A spec file (TOML), or a folder with a fit.toml.")
]


def ends(*kinds: str) -> Callable[[Path | None], Path | None]:
    """A check before the work: the name of a file says what will be in it."""

    def check(path: Path | None) -> Path | None:
        from diffthrust._support.files import ending

        try:
            if path:
                ending(path, *kinds)
        except InputError as error:
            raise typer.BadParameter(str(error)) from None
        return path

    return check


JsonPath = Annotated[
    Path | None,
    typer.Option(
        "--json",
        metavar="FILE.json",
        help="Write the results as JSON.",
        callback=ends(".json"),
    ),
]
ReportPath = Annotated[
    Path | None,
    typer.Option(
        "--report",
        metavar="FILE.html",
        help="Write a page with tables and figures.",
        callback=ends(".html", ".htm"),
    ),
]


def names_in(text: str | None) -> list[str] | None:
    """The names in ``a,b,c``."""
    if text is None:
        return None
    names = [name.strip() for name in text.split(",") if name.strip()]
    if not names:
        raise InputError(
            "--candidates: expected names of effects, found none.",
            "Name them with commas between, or leave --candidates out to try all.",
        )
    return names


def show(thing: Any) -> None:
    """Print text or a table."""
    from rich.console import Console

    # files and pipes have no width: let no table be folded there
    console = Console(width=None if sys.stdout.isatty() else 140, highlight=False)
    console.print(thing)


def written(*paths: Path | None) -> None:
    """Name the files that were written."""
    for path in paths:
        if path:
            typer.echo(f"Written: {path}")
