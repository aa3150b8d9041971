"""The command ``diffthrust look``: survey a log, and draft a spec file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from diffthrust._support.files import write_json
from diffthrust._support.visible import visible
from diffthrust.cli._session import (
    FIGURE_TYPES,
    JsonPath,
    file_type,
    session,
    show,
    write_figure,
    written,
)


def look_command(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE...", help="A log, several of one kind, or a folder of them."),
    ],
    figure: Annotated[
        Path | None,
        typer.Option(
            "--figure",
            metavar="FILE.png",
            help="Draw the channels over time (.png, .svg, .pdf).",
            callback=file_type(*FIGURE_TYPES),
        ),
    ] = None,
    spec: Annotated[
        Path | None,
        typer.Option(
            "--spec",
            metavar="FILE.toml",
            help="Write the draft of a spec file.",
            callback=file_type(".toml"),
        ),
    ] = None,
    json: JsonPath = None,
    all: Annotated[bool, typer.Option("--all", help="Show every field of a robot's log.")] = False,
) -> None:
    """Survey a log, and draft a spec file for a first fit."""
    with session():
        from diffthrust.survey._look import look, look_report

        survey = look(files)
        if spec:
            survey.save_spec(spec)
        if json:
            write_json(json, survey.to_json())
        if figure:
            write_figure(figure, survey.plot)
        show(look_report(survey, all=all))
    written(spec, json, figure)
    if spec and survey.model:
        path = visible(str(spec))
        typer.echo(f"Next: read the doubts in {path}, then diffthrust fit {path}")
    elif not spec:
        names = visible(" ".join(map(str, files)))
        typer.echo(f"Next: diffthrust look {names} --spec fit.toml drafts a spec file")
