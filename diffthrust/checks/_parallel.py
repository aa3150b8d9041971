"""Stored fits run in several processes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

from diffthrust._support._running.pool import pooled
from diffthrust._support._running.process import LineProcess, ProcessDied, ProcessNotStarted
from diffthrust._support.errors import InputError
from diffthrust.checks._expected import Row
from diffthrust.checks._run import Run, not_run, run_again
from diffthrust.specs._compile_key import alike


class Task(NamedTuple):
    """A fit to run: its name, its spec file, and whether to write its [expected] block."""

    fit: str
    file: Path
    update: bool


def run_all(tasks: Sequence[Task], jobs: int) -> Iterator[tuple[int, Run]]:
    """Run fits in several processes.

    Args:
        tasks: the fits.
        jobs: how many processes.

    Yields:
        The place of a task and what became of it, as they finish. A fit whose process dies is one
        that could not be run.
    """
    processes = [LineProcess(f"{__name__}:answer") for _ in range(jobs)]
    keys = [alike(task.file) for task in tasks]
    with closing(pooled(tasks, keys, processes, _asked)) as each:
        yield from (found for found in each if found is not None)


def answer(question: list[Any]) -> dict[str, Any]:
    """Run a fit where this is called; `Task` and `Run` as plain data."""
    fit, file, update = question
    run = run_again(fit, Path(file), update)
    return {
        "rows": [vars(row) for row in run.rows],
        "updated": run.updated,
        "seconds": run.seconds,
        "warnings": run.warnings,
    }


def _asked(process: LineProcess, task: Task) -> Run:
    try:
        told = process.ask([task.fit, str(task.file), task.update])
    except ProcessNotStarted as how:
        raise InputError(
            f"A process for the fits cannot be started ({how}).",
            "See what it printed above; --jobs 1 does without.",
        ) from None
    except ProcessDied as how:
        problem = f"the process that ran it died ({how})."
        mend = f"Run diffthrust fit {task.file} alone; if memory was short, take fewer --jobs."
        return Run(task.fit, task.file, (not_run(task.fit, problem, mend),))
    rows = tuple(Row(**row) for row in told["rows"])
    return Run(task.fit, task.file, rows, told["updated"], told["seconds"], tuple(told["warnings"]))
