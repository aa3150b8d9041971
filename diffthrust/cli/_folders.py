"""The commands over a folder of specs: ``check``, the gate of a repository, and ``campaign``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from typer import Argument, Option

from diffthrust._support.visible import visible
from diffthrust.cli import _session as ui

if TYPE_CHECKING:
    from diffthrust.checks._result import Checked

_ANNOTATIONS = 10
"""GitHub shows at most this number of errors for a step."""


def check_command(
    directory: Annotated[Path, Argument(metavar="DIR", help="The folder of the fits.")],
    update: Annotated[
        bool, Option("--update", help="Write the current results as expected.")
    ] = False,
    everything: Annotated[
        bool, Option("--all", help="Show every quantity, not only moved ones.")
    ] = False,
    jobs: Annotated[
        int | None,
        Option(
            metavar="N",
            min=1,
            help="Number of processes; by default from the number of processors.",
        ),
    ] = None,
    junit: Annotated[
        Path | None, ui.file_option("FILE.xml", "Write the results as JUnit XML, for CI services.")
    ] = None,
    trust: ui.TrustOption = None,
    json: ui.JsonPath = None,
) -> None:
    """Rerun every fit.toml below DIR; exit status 1 if a result has moved."""
    with ui.session() as progress:
        from diffthrust.checks._check import check
        from diffthrust.checks._result import check_report

        checked = check(
            directory, update, progress=progress, jobs=jobs, junit=junit, trust=trust or ()
        )
        ui.write_json_of(json, checked)
    ui.show(check_report(checked, everything))
    if os.environ.get("GITHUB_ACTIONS") == "true":
        for line in error_lines(checked):
            typer.echo(visible(line))
    ui.written(json, junit)
    if not checked.ok:
        raise typer.Exit(ui.CHECK_FAILED)


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


def campaign_command(
    directory: Annotated[Path, Argument(metavar="DIR", help="A folder, searched recursively.")],
    task: Annotated[
        Literal["fit", "diagnose", "sample"], Option(help="What to do with each spec.")
    ] = "fit",
    output: Annotated[Path, Option(metavar="OUT", help="Where the results go.")] = Path(
        "campaign_output"
    ),
    jobs: Annotated[
        int | None, Option(metavar="N", min=1, help="Processes; as many as processors by default.")
    ] = None,
    cluster: Annotated[
        str | None, Option(metavar="ADDRESS", help="The scheduler of a Dask cluster.")
    ] = None,
    time_limit: Annotated[
        float | None, Option(metavar="S", help="Kill a task after S seconds.")
    ] = None,
    candidates: Annotated[
        str | None, Option(metavar="A,B,...", help="Effects that a diagnosis tries.")
    ] = None,
    method: Annotated[str | None, Option(help="Sampler: emcee or nuts.")] = None,
    draws: Annotated[int | None, Option(metavar="N", help="Draws of a sampler.")] = None,
    warmup: Annotated[int | None, Option(metavar="N", help="Warmup steps.")] = None,
    seed: Annotated[int | None, Option(metavar="N", help="Seed of a sampler.")] = None,
    report: Annotated[
        bool, Option("--report", help="Write a page into the folder of each spec.")
    ] = False,
    trust: ui.TrustOption = None,
    json: ui.JsonPath = None,
) -> None:
    """Fit, diagnose or sample every spec below DIR in parallel; a rerun does the remaining work.

    Exit status 1 where a spec has no result: it failed, ran out of time, or lost its worker.
    """
    with ui.session() as progress:
        from diffthrust.many import campaign

        finished = campaign(
            directory,
            task=task,
            output=output,
            executor=cluster,
            jobs=jobs,
            time_limit=time_limit,
            report=report,
            trust=trust or (),
            progress=progress,
            candidates=ui.effect_names(candidates),
            method=method,
            draws=draws,
            warmup=warmup,
            seed=seed,
        )
        ui.write_json_of(json, finished)
    ui.show(finished)
    ui.written(finished.path, json)
    if not finished.ok:
        raise typer.Exit(ui.CHECK_FAILED)
