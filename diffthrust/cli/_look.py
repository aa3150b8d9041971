"""The commands that look at logs: ``look`` surveys them or draws a craft; ``explore``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from diffthrust._support.errors import InputError
from diffthrust._support.visible import visible
from diffthrust.cli import _session as ui


def look_command(
    files: Annotated[
        list[Path] | None,
        Argument(metavar="FILE...", help="A log, several of one kind, or a folder of them."),
    ] = None,
    figure: Annotated[
        Path | None,
        ui.figure_option("Draw the channels over time, or the craft (.png, .svg, .pdf)."),
    ] = None,
    spec: Annotated[
        Path | None, ui.file_option("FILE.toml", "Write the draft of a spec file.")
    ] = None,
    craft: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="Show the craft of a spec (.toml), or of the settings in an autopilot's log or in "
            "a file of its parameters.",
        ),
    ] = None,
    json: ui.JsonPath = None,
    all: Annotated[bool, Option("--all", help="Show every field of a robot's log.")] = False,
) -> None:
    """Survey a log, and draft a spec file for a first fit; or show a craft."""
    if craft is not None:
        beside = {"FILE": files, "--spec": spec, "--json": json, "--all": all}
        _show_craft(craft, figure, [word for word, value in beside.items() if value])
        return
    with ui.session():
        if not files:
            raise InputError(
                "expected a log to look at, found none.",
                "Name one: diffthrust look run.csv; or a craft: diffthrust look --craft FILE.toml.",
            )
        from diffthrust.survey._look import look, look_report

        survey = look(files)
        if spec:
            survey.save_spec(spec)
        ui.write_json_of(json, survey)
        ui.write_figure(figure, survey.plot)
        ui.show(look_report(survey, all=all))
    ui.written(spec, json, figure)
    if spec and survey.model:
        path = visible(str(spec))
        typer.echo(f"Next: read the doubts in {path}, then diffthrust fit {path}")
    elif not spec:
        names = visible(" ".join(map(str, files)))
        typer.echo(f"Next: diffthrust look {names} --spec fit.toml drafts a spec file")


def _show_craft(path: Path, figure: Path | None, beside: list[str]) -> None:
    """The thrusters of a craft, and a drawing of it; nothing else is done ``beside``."""
    with ui.session():
        if beside:
            raise InputError(
                f"expected --craft alone or with --figure, found {', '.join(beside)} as well.",
                "Look at the craft and at the logs in two commands.",
            )
        if path.suffix.lower() == ".toml":
            from diffthrust.specs._thrusters import described_craft

            craft, report = described_craft(path)
        else:
            from diffthrust._support.results import report_of
            from diffthrust.layouts import layout_in

            layout = layout_in(path)
            craft, report = layout.craft(), report_of(layout)
        ui.write_figure(figure, craft.plot)
        ui.show(report)
    ui.written(figure)
    if not figure:
        typer.echo(
            f"Next: diffthrust look --craft {visible(str(path))} --figure craft.png draws it"
        )


def explore_command(
    what: Annotated[
        Path,
        Argument(
            metavar="SPEC|LOG|FIT",
            help="A spec file or its folder, a log or a folder of logs, or a saved fit or "
            "diagnosis.",
        ),
    ],
    no_browser: Annotated[
        bool, Option("--no-browser", help="Print the address, and open no browser.")
    ] = False,
    port: Annotated[int, Option(min=0, max=65535, help="Listen there; 0 for any free one.")] = 0,
    trust: Annotated[
        list[Path] | None,
        Option(
            "--trust",
            metavar="DIR",
            help="A folder whose scripts the spec may run; not even those of its own are run "
            "otherwise.",
        ),
    ] = None,
) -> None:
    """Look at logs, drag, add what is missing, and watch the error fall: a page in the browser."""
    with ui.session() as progress:
        from diffthrust.workbench import explore

        progress("opening the logs", 0.0)
        bench = explore(what, trust=trust or (), browser=not no_browser, wait=False, port=port)
    typer.echo(f"The workbench: {bench.address}")
    typer.echo("It ends by Ctrl-C, or an hour after its page was closed.")
    bench.wait()
