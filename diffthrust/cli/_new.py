"""The command ``diffthrust new``: create a folder for a new fit, and a workflow."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from diffthrust._support.errors import InputError
from diffthrust.cli._session import session, show, written


def new_command(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="Name of the fit and of its folder.")
    ] = None,
    model: Annotated[
        str, typer.Option("--model", metavar="MODEL", help="A model of the catalogue.")
    ] = "thruster",
    directory: Annotated[
        Path, typer.Option("--directory", metavar="DIR", help="The folder of the fits.")
    ] = Path("fits"),
    workflow: Annotated[
        bool,
        typer.Option("--workflow", help="Also write .github/workflows/fits.yml, the CI gate."),
    ] = False,
) -> None:
    """Make DIR/NAME with a commented spec and example logs, ready to take logs of your own."""
    with session():
        from diffthrust.specs._new import new_fit, new_workflow, workflow_place

        if name is None and not workflow:
            raise InputError(
                "expected the NAME of a fit, found none.", "Write diffthrust new bollard_pull."
            )
        if workflow:
            workflow_place(directory)  # refuse it before anything is written
        folder = new_fit(name, model, directory) if name is not None else None
        gate = new_workflow(directory) if workflow else None
    written(folder, gate)
    if folder:
        show(
            f"Next: put your logs into {folder}, name them in its fit.toml, and run diffthrust fit "
            f"{folder}.\nOnce you trust it: diffthrust check {directory} --update"
        )
