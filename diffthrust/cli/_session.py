"""What every command of the command line runs in."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import typer

from diffthrust._support.errors import InputError

DONE, CHECK_FAILED, BAD_INPUT, DEFECT, STOPPED = 0, 1, 2, 3, 130


@contextmanager
def session() -> Iterator[Callable[[str, float], None] | None]:
    """What every command needs: the cache, progress on a terminal, and errors as one message."""
    from diffthrust._support._running.cache import enable_compilation_cache

    try:
        enable_compilation_cache()
        with warnings.catch_warnings(), _progress() as progress:
            warnings.showwarning = _warned
            yield progress
    except InputError as error:
        typer.echo(f"Error: {error}", err=True)
        raise typer.Exit(BAD_INPUT) from None
    except KeyboardInterrupt as stopped:
        typer.echo(f"Stopped. {stopped}".strip(), err=True)
        raise typer.Exit(STOPPED) from None
    except (typer.Exit, typer.Abort):
        raise
    except Exception as error:
        if os.environ.get("DIFFTHRUST_DEBUG"):
            raise
        typer.echo(
            f"A defect of diffthrust, not of your input: {type(error).__name__}: {error}\n"
            "Mend: please report it, with what DIFFTHRUST_DEBUG=1 prints when set before the "
            "command.",
            err=True,
        )
        raise typer.Exit(DEFECT) from None


def _warned(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    from diffthrust.simulation._step_size import CoarseStepWarning

    if issubclass(category, CoarseStepWarning):
        typer.echo(f"Warning: {message}", err=True)


@contextmanager
def _progress() -> Iterator[Callable[[str, float], None] | None]:
    """A bar on standard error where that is a terminal; nothing elsewhere."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("reading", total=1.0)
        yield lambda message, done: bar.update(task, description=message, completed=done)
