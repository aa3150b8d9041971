"""Regression tests of fits: rerun every stored fit and compare with its expected results."""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, NoReturn

from diffthrust._support._running.pool import WorkerPool, as_done, own_worker, processors
from diffthrust._support._running.process import ProcessDied, ProcessNotStarted, Worker
from diffthrust._support.errors import InputError, os_errors_as
from diffthrust._support.extras import extra
from diffthrust._support.files import ending, write_whole
from diffthrust._support.progress import ProgressOption, progressing, reporter
from diffthrust._support.validation import whole_number
from diffthrust._support.visible import in_line
from diffthrust.checks._expected import compared, marks_of, updated
from diffthrust.checks._result import Checked, FitRun, not_run
from diffthrust.simulation._step_size import CoarseStepWarning
from diffthrust.specs._file import NAME
from diffthrust.specs._scripts import as_input_error, trusted_folders
from diffthrust.specs._spec import load_spec

_FEWEST = 3
"""Fits per process for which starting another process pays off."""


class Task(NamedTuple):
    """A fit to run: its name, its spec file, whether to write its [expected] block, and trust."""

    fit: str
    file: Path
    update: bool
    trust: Sequence[str] = ()


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
        junit: a file to write, ending in ``.xml``, in the JUnit format that CI services read
            (``pip install 'diffthrust[junit]'``).
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
    if jobs is not None:
        whole_number("jobs", jobs)
    if junit is not None:
        ending(Path(junit), ".xml")
        with extra("junit", "junit: a file of results"):
            import junitparser  # noqa: F401
    tasks = tasks_in(Path(directory), update, trusted_folders(trust))
    jobs = jobs or min(processors(), -(-len(tasks) // _FEWEST))
    report, outcomes = reporter(progress), dict[int, FitRun]()
    report(tasks[0].fit, 0.0)
    for i, run in _run_all(tasks, min(len(tasks), jobs)):
        outcomes[i] = run
        report(run.fit, len(outcomes) / len(tasks))
    checked = Checked(tuple(outcomes[i] for i in range(len(tasks))))
    _warn(checked.runs)
    if junit is not None:
        from diffthrust.checks._junit import write_junit

        write_junit(Path(junit), checked, Path(directory))
    return checked


def tasks_in(directory: Path, update: bool = False, trust: Sequence[str] = ()) -> list[Task]:
    """The fits at and below a folder, in the order of their names.

    Folders whose names begin with a dot are left out; links are followed, each folder once.
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


def _run_all(tasks: Sequence[Task], jobs: int) -> Iterator[tuple[int, FitRun]]:
    """Run fits; yields the index and outcome of each, as they finish."""
    if jobs == 1:
        yield from ((i, run_again(*task)) for i, task in enumerate(tasks))
        return
    workers = [Worker(run_again) for _ in range(jobs)]
    with WorkerPool(workers) as pool:
        yield from ((i, run.result()) for i, run in as_done(pool, _in_process, tasks))


def _in_process(task: Task) -> FitRun:
    try:
        return own_worker().ask(*task)
    except ProcessNotStarted as how:
        raise InputError(
            f"A process for the fits cannot be started ({how}).",
            "See what it printed above; --jobs 1 does without.",
        ) from None
    except ProcessDied as how:
        problem = f"the process that ran it died ({how})."
        mend = f"Run diffthrust fit {task.file} alone; if memory was short, take fewer --jobs."
        return not_run(task.fit, task.file, problem, mend)


def run_again(fit: str, file: Path, update: bool, trust: Sequence[str] = ()) -> FitRun:
    """Rerun a stored fit, and compare it with its [expected] block or update the block."""
    begin = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        # "always": Python otherwise issues a warning once per line of code, so that the second fit
        # of a process would have none.
        warnings.simplefilter("always", CoarseStepWarning)
        try:
            run = _compared(fit, file, update, trust)
        except Exception as error:  # a defect, too, must not hide the outcome of other fits
            if os.environ.get("DIFFTHRUST_DEBUG") and not isinstance(error, InputError):
                raise
            failure = as_input_error(error, f"diffthrust fit {file}")
            run = not_run(fit, file, failure.problem, failure.mend)
    coarse = tuple(str(w.message) for w in caught if issubclass(w.category, CoarseStepWarning))
    return replace(run, seconds=time.perf_counter() - begin, warnings=coarse)


def _compared(name: str, path: Path, update: bool, trust: Sequence[str]) -> FitRun:
    spec = load_spec(path, trust=trust)
    expected = spec.file.expected
    if expected is None and not update:
        mend = "Look at it with diffthrust fit, then write the block: diffthrust check --update."
        return not_run(name, path, None, mend, "no [expected] block")
    fit = spec.fit()
    marks = marks_of(spec, fit)
    text = updated(spec.text, path, expected, fit, marks) if update else spec.text
    if text != spec.text:
        _write_over(path, spec.text, text)
        expected = load_spec(path, trust=trust).file.expected
    assert expected is not None
    rows = tuple(compared(name, expected, fit))
    if text != spec.text:
        return FitRun(name, path, rows, updated=True)
    if not rows:
        mend = "Remove the empty [expected] block and run diffthrust check --update."
        run = not_run(name, path, None, mend, "empty [expected] block")
        return replace(run, since=marks.since(expected, False))
    return FitRun(name, path, rows, since=marks.since(expected, all(row.ok for row in rows)))


def _write_over(path: Path, original: str, replacement: str) -> None:
    """Replace the text of a spec, unless it was edited meanwhile."""
    mend = "Put it back, and run diffthrust check --update again."
    with os_errors_as(f"{path}: the file can no longer be read", mend):
        now = path.read_bytes()
    # A fit takes minutes, and people edit meanwhile: their text wins.
    if now != original.encode("utf-8"):
        beside = path.with_name(f"{path.name}.updated")
        write_whole(beside, replacement.encode("utf-8"))
        raise InputError(
            f"{path}: the file was edited while its fit ran. It was not changed; the new text "
            f"is in {beside.name}.",
            f"Remove {beside.name}, and run diffthrust check --update again.",
        )
    write_whole(path, replacement.encode("utf-8"))


def _warn(runs: Sequence[FitRun]) -> None:
    """Repeat the warnings of the fits, with their names."""
    for run in runs:
        for text in run.warnings:
            # stacklevel 4: _warn, check and the decorator of `progress` lie between here and the
            # caller.
            warnings.warn(f"{run.fit}: {text}", CoarseStepWarning, stacklevel=4)
