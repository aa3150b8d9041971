"""The session, the options and the output that all commands share."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from diffthrust._support.errors import Defect, InputError
from diffthrust._support.files import ending, existing_folder, write_json, write_whole
from diffthrust._support.visible import visible
from diffthrust.cli._interrupt import STOPPED, interrupted, report_stopped

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from diffthrust._support.progress import Progress
    from diffthrust._support.report import Report
    from diffthrust._support.results import Result

DONE, CHECK_FAILED, BAD_INPUT, DEFECT = 0, 1, 2, 3
FIGURE_TYPES = (".png", ".svg", ".pdf")


@contextmanager
def session() -> Iterator[Progress]:
    """Run a command with compilation cache, progress bar, and errors as one message."""
    from diffthrust._support._running.cache import enable_compilation_cache
    from diffthrust._support.progress import bar

    try:
        enable_compilation_cache()
        with warnings.catch_warnings(), bar("reading") as progress:
            warnings.showwarning = _warned
            yield progress
    except (typer.Exit, typer.Abort):
        raise
    except (Exception, KeyboardInterrupt) as error:
        if os.environ.get("DIFFTHRUST_DEBUG") and not isinstance(
            error, InputError | KeyboardInterrupt
        ):
            raise
        raise typer.Exit(_report_error(error)) from None


def _report_error(error: Exception | KeyboardInterrupt) -> int:
    """Report the error that ended a command, and return its exit status."""
    if isinstance(error, KeyboardInterrupt) or interrupted():
        # An interrupted import raises ImportError, an interrupted read looks like a damaged file.
        report_stopped(visible(str(error)) if isinstance(error, KeyboardInterrupt) else "")
        return STOPPED
    if not isinstance(error, InputError):
        from diffthrust.specs._scripts import as_input_error  # takes a second

        error = as_input_error(error, " ".join(["diffthrust", *sys.argv[1:]]))
    typer.echo(f"Error: {error}", err=True)
    return DEFECT if isinstance(error, Defect) else BAD_INPUT


def _warned(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    from diffthrust.simulation._step_size import CoarseStepWarning

    # Other warnings (of NumPy, of JAX) name lines of the library, and the fit reports their
    # consequences.
    if issubclass(category, CoarseStepWarning):
        over = "\r\x1b[K" if sys.stderr.isatty() else ""  # the line of the bar
        typer.echo(f"{over}Warning: {visible(str(message))}", err=True)


def file_option(metavar: str, help: str, *more: str) -> Any:
    """An option for a file to write; its ending, that of metavar or more, is checked early.

    So is its folder: a diagnosis of half a minute ended in "No such file or directory".
    """

    def check(path: Path | None) -> Path | None:
        try:
            if path:
                ending(path, Path(metavar).suffix, *more)
                existing_folder(path)
        except InputError as error:
            raise typer.BadParameter(str(error)) from None
        return path

    return Option(metavar=metavar, help=help, callback=check)


def figure_option(help: str) -> Any:
    """The option for a figure to draw."""
    return file_option("FILE.png", help, *FIGURE_TYPES[1:])


SpecPath = Annotated[
    Path, Argument(metavar="SPEC", help="A spec file (TOML), or a folder with a fit.toml.")
]
FittedPath = Annotated[
    Path,
    Argument(
        metavar="SPEC",
        help="A spec file (TOML), a folder with a fit.toml, or a fit that fit --save has kept.",
    ),
]
TrustOption = Annotated[
    list[Path] | None,
    Option(
        "--trust",
        metavar="DIR",
        help="A folder whose scripts specs may run, besides those in and below their own.",
    ),
]
NoFitOption = Annotated[
    bool, Option("--no-fit", help="Take the parameters as the spec gives them.")
]
JsonPath = Annotated[Path | None, file_option("FILE.json", "Write the results as JSON.")]
ReportPath = Annotated[
    Path | None, file_option("FILE.html", "Write a page with tables and figures.", ".htm")
]
SavePath = Annotated[
    Path | None,
    file_option("FILE.json", "Save the complete result; in Python dft.load(FILE) loads it."),
]


def effect_names(text: str | None) -> list[str] | None:
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


def show(content: Result | Report | str) -> None:
    """Print a result's report, or text."""
    from diffthrust._support.report import Report, Section
    from diffthrust._support.results import Result, report_of
    from diffthrust._support.tables import plain_text, print_report

    if isinstance(content, str):
        content = Report(Section("", *content.split("\n")))
    report = report_of(content) if isinstance(content, Result) else content
    if sys.stdout.isatty():
        print_report(report)
        return
    # Files and pipes have no width; 140 columns keep most tables undivided.
    columns = os.environ.get("COLUMNS", "")
    width = int(columns) if columns.isdecimal() and int(columns) else 140
    typer.echo(plain_text(report, width), nl=False)


def write_json_of(path: Path | None, result: Any) -> None:
    """Write what a result has for other programs, where that is asked for."""
    if path:
        write_json(path, result.to_json())


def write_figure(path: Path | None, draw: Callable[[], Figure]) -> None:
    """Write a figure, where that is asked for, in the format that the file's name ends in."""
    if path is None:
        return
    from io import BytesIO

    from diffthrust._support.figures import unseen

    out = BytesIO()
    unseen(draw).savefig(out, format=ending(path, *FIGURE_TYPES).removeprefix("."), dpi=120)
    write_whole(path, out.getvalue())


def written(*paths: Path | None) -> None:
    """Name the files that were written."""
    for path in paths:
        if path:
            typer.echo(f"Written: {visible(str(path))}")
