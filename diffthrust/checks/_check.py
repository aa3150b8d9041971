"""Regression tests of fits: rerun every stored fit and compare with its expected results."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NoReturn

from diffthrust._support._running.pool import processors
from diffthrust._support.errors import InputError
from diffthrust._support.files import ending
from diffthrust._support.progress import Progress, ProgressOption, progressing, reporter
from diffthrust._support.visible import in_line
from diffthrust.checks._result import Checked, FitRun
from diffthrust.checks._run import Task, run_all
from diffthrust.specs._file import NAME

_FEWEST = 3
"""Fits per process for which starting another process pays off."""


@progressing
def check(
    directory: Path | str,
    update: bool = False,
    *,
    progress: ProgressOption = None,
    jobs: int | None = None,
    junit: Path | str | None = None,
    trust: Path | str | Iterable[Path | str] = (),
) -> Checked:
    """Run every ``fit.toml`` below a folder and compare with its [expected] block.

    A parameter has moved if it differs by more than a tenth of its stored standard error, a fit
    error if it differs by more than 0.01 %, unless the block gives a tolerance. Refits of the same
    data stay far within both, also on another processor.

    Args:
        directory: a folder of fits, at any depth, or the folder of one fit.
        update: write the [expected] blocks of fits that moved, or that have none.
        progress: True for a bar, or a function of the name of a fit and the share done.
        jobs: number of processes, each with one thread and some 300 MB; 1 runs all fits in this
            process. By default one per processor, and at most one per three fits.
        junit: a file to write, ending in ``.xml``, in the JUnit format that CI services read.
        trust: folders whose scripts specs may run, besides those in and below their own.

    Returns:
        A row for each quantity. A fit that cannot be run, or has no expected values, gives a failed
        row, so that the other fits are still checked.

    Raises:
        InputError: there are no fits, jobs is below one, or a file cannot be written.

    Example:
        >>> done = dft.checks.check(".", update=True)  # writes [expected] into each fit.toml
        >>> dft.checks.check(".").ok
        True
    """
    if jobs is not None and jobs < 1:
        raise InputError(f"jobs: expected 1 or more, found {jobs}.", "Give how many at a time.")
    if junit is not None:
        ending(Path(junit), ".xml")
    trusted = (trust,) if isinstance(trust, str | Path) else trust
    tasks = tasks_in(Path(directory), update, [os.path.abspath(place) for place in trusted])
    runs = _runs(tasks, min(len(tasks), jobs or default_jobs(len(tasks))), reporter(progress))
    _warn(runs)
    checked = Checked(tuple(runs))
    if junit is not None:
        from diffthrust.checks._junit import write_junit

        write_junit(Path(junit), checked, Path(directory))
    return checked


def tasks_in(directory: Path, update: bool = False, trust: Sequence[str] = ()) -> list[Task]:
    """The fits at and below a folder, in the order of their names.

    Folders whose names begin with a dot are left out; links are followed, each folder once.

    Raises:
        InputError: there are none, or a folder cannot be read.
    """
    tasks: list[Task] = []
    visited: set[str] = set()
    for folder, below, files in os.walk(directory, followlinks=True, onerror=_unreadable):
        real = os.path.realpath(folder)
        # A link to a folder above would never end; one to a sibling would check its fits twice.
        if real in visited:
            below.clear()
            continue
        visited.add(real)
        below[:] = sorted(name for name in below if not name.startswith("."))
        if NAME in files:
            path = Path(folder)
            is_root = path == directory
            name = path.resolve().name if is_root else path.relative_to(directory).as_posix()
            tasks.append(Task(in_line(name), path / NAME, update, trust))
    if not tasks:
        raise InputError(
            f"{directory}: expected fits as {directory / 'NAME' / NAME}, found none.",
            "Name the folder that holds the folders of the fits; diffthrust new NAME makes one.",
        )
    return sorted(tasks)


def _unreadable(error: OSError) -> NoReturn:
    absent = isinstance(error, FileNotFoundError)
    reason = "no such folder" if absent else error.strerror or error
    raise InputError(
        f"{error.filename}: expected fits in a folder, found {reason}.",
        "Name the folder that holds the folders of the fits.",
    )


def default_jobs(count: int) -> int:
    return max(1, min(processors(), -(-count // _FEWEST)))


def _runs(tasks: Sequence[Task], jobs: int, report: Progress) -> list[FitRun]:
    """Run all tasks; outcomes are in the order of the tasks."""
    outcomes: dict[int, FitRun] = {}
    report(tasks[0].fit, 0.0)
    for i, run in run_all(tasks, jobs):
        outcomes[i] = run
        report(run.fit, len(outcomes) / len(tasks))
    return [outcomes[i] for i in range(len(tasks))]


def _warn(runs: Sequence[FitRun]) -> None:
    """Repeat the warnings of the fits, with their names."""
    from diffthrust.simulation._step_size import CoarseStepWarning

    for run in runs:
        for text in run.warnings:
            # stacklevel 4: _warn, check and the decorator of `progress` lie between here and the
            # caller.
            warnings.warn(f"{run.fit}: {text}", CoarseStepWarning, stacklevel=4)
