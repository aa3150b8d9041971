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

from diffthrust._support.errors import InputError, refused
from diffthrust._support.files import ending, write_whole
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


def _report_error(error: BaseException) -> int:
    """Report the error that ended a command, and return its exit status."""
    if isinstance(error, KeyboardInterrupt) or interrupted():
        # An interrupted import raises ImportError, an interrupted read looks like a damaged file.
        report_stopped(visible(str(error)) if isinstance(error, KeyboardInterrupt) else "")
        return STOPPED
    if not isinstance(error, InputError):
        # An exception whose traceback ends in a user's script is a mistake of the script, with a
        # line to correct, not a defect of the library.
        from diffthrust.specs._scripts import error_in_script

        error = error_in_script(error) or error
    if isinstance(error, OSError):
        error = InputError(*refused(error))
    if isinstance(error, InputError):
        typer.echo(f"Error: {error}", err=True)
        return BAD_INPUT
    typer.echo(
        "A defect of diffthrust, not of your input: "
        f"{type(error).__name__}: {visible(str(error))}\n"
        "Mend: please report it, with what DIFFTHRUST_DEBUG=1 prints when set before the command.",
        err=True,
    )
    return DEFECT


def _warned(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    from diffthrust.simulation._step_size import CoarseStepWarning

    # Other warnings (of NumPy, of JAX) name lines of the library, and the fit reports their
    # consequences.
    if issubclass(category, CoarseStepWarning):
        over = "\r\x1b[K" if sys.stderr.isatty() else ""  # the line of the bar
        typer.echo(f"{over}Warning: {visible(str(message))}", err=True)


SpecPath = Annotated[
    Path, typer.Argument(metavar="SPEC", help="A spec file (TOML), or a folder with a fit.toml.")
]


FittedPath = Annotated[
    Path,
    typer.Argument(
        metavar="SPEC",
        help="A spec file (TOML), a folder with a fit.toml, or a fit that fit --save has kept.",
    ),
]


TrustOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--trust",
        metavar="DIR",
        help="A folder whose scripts specs may run, besides those in and below their own.",
    ),
]


def file_type(*kinds: str) -> Callable[[Path | None], Path | None]:
    """An early check of a file's suffix."""

    def check(path: Path | None) -> Path | None:
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
        callback=file_type(".json"),
    ),
]
ReportPath = Annotated[
    Path | None,
    typer.Option(
        "--report",
        metavar="FILE.html",
        help="Write a page with tables and figures.",
        callback=file_type(".html", ".htm"),
    ),
]


SavePath = Annotated[
    Path | None,
    typer.Option(
        "--save",
        metavar="FILE.json",
        help="Save the complete result; in Python dft.load(FILE) loads it.",
        callback=file_type(".json"),
    ),
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


def write_figure(path: Path, draw: Callable[[], Figure]) -> None:
    """Write a figure in the format that the name of the file ends in."""
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
