"""The command ``diffthrust check``: the gate of a repository with fits."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from diffthrust._support.files import write_json
from diffthrust._support.visible import visible
from diffthrust.cli._session import (
    CHECK_FAILED,
    JsonPath,
    TrustOption,
    file_option,
    session,
    show,
    written,
)

if TYPE_CHECKING:
    from diffthrust.checks._result import Checked

_ANNOTATIONS = 10
"""GitHub shows at most this number of errors for a step."""


def check_command(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="The folder of the fits.")],
    update: Annotated[
        bool, typer.Option("--update", help="Write the current results as expected.")
    ] = False,
    everything: Annotated[
        bool, typer.Option("--all", help="Show every quantity, not only moved ones.")
    ] = False,
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs",
            metavar="N",
            min=1,
            help="Number of processes; by default from the number of processors.",
        ),
    ] = None,
    junit: Annotated[
        Path | None,
        file_option("--junit", "FILE.xml", "Write the results as JUnit XML, for CI services."),
    ] = None,
    trust: TrustOption = None,
    json: JsonPath = None,
) -> None:
    """Rerun every fit.toml below DIR; exit status 1 if a result has moved."""
    with session() as progress:
        from diffthrust.checks._check import check
        from diffthrust.checks._result import check_report

        checked = check(
            directory, update, progress=progress, jobs=jobs, junit=junit, trust=trust or ()
        )
        if json:
            write_json(json, checked.to_json())
    show(check_report(checked, everything))
    if os.environ.get("GITHUB_ACTIONS") == "true":
        for line in error_lines(checked):
            typer.echo(visible(line))
    written(json, junit)
    if not checked.ok:
        raise typer.Exit(CHECK_FAILED)


def error_lines(checked: Checked) -> list[str]:
    """Annotations for GitHub at the spec files of failed fits, as workflow commands."""
    from diffthrust.checks._tables import by_size, sentence

    lines = []
    for run in [run for run in checked.runs if not run.ok][:_ANNOTATIONS]:
        file, title = (_escaped(str(field), ":,") for field in (run.file, run.fit))
        moved = [*map(sentence, by_size(row for row in run.rows if not row.ok))]
        reported = "\n".join(filter(None, [*moved, run.since]))
        lines.append(f"::error file={file},title={title}::{_escaped(reported)}")
    return lines


def _escaped(text: str, more: str = "") -> str:
    # % first: later replacements insert more of them.
    for char in f"%\r\n{more}":
        text = text.replace(char, f"%{ord(char):02X}")
    return text
