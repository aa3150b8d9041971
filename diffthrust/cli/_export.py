"""The command ``diffthrust export``: export a fit to another program."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from diffthrust._support.errors import InputError
from diffthrust.cli._session import TrustOption, session, written


def export_command(
    fit: Annotated[
        Path,
        typer.Argument(
            metavar="FIT", help="A saved fit (.json), or a spec file or its folder, fitted first."
        ),
    ],
    to: Annotated[
        Literal["python", "c", "lut", "gz", "uuv", "stonefish"],
        typer.Option(
            "--to",
            help="A module of plain Python, a C99 header, a steady-state table of force and "
            "command, or a thruster for gz-sim, uuv_simulator or Stonefish.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", metavar="PATH", help="The file to write; without it, standard output."
        ),
    ] = None,
    limits: Annotated[
        tuple[float, float] | None,
        typer.Option(
            "--limits",
            metavar="LOW HIGH",
            help="Lowest and highest command, in the unit of the logs; as in the logs by default.",
        ),
    ] = None,
    trust: TrustOption = None,
) -> None:
    """Export a fit to firmware, a thrust allocation, or a vehicle simulator."""
    with session() as progress:
        if fit.suffix.lower() == ".json":
            from diffthrust.saved._load import load

            files = load(fit, trust=trust or ())
            if not hasattr(files, "export"):
                raise InputError(
                    f"{fit}: expected a saved fit, found a {type(files).__name__}.",
                    "Name the file that fit.save has written.",
                )
        else:
            from diffthrust.specs._spec import load_spec

            files = load_spec(fit, trust=trust or ()).fit(progress=progress)
        exported = files.export(to, output, limits=limits)
    if output is None:
        typer.echo(exported.text)
    for note in exported.notes:
        typer.echo(f"Note: {note}", err=True)
    written(output)
