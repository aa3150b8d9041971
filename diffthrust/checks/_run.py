"""Rerun stored fits, in this or in several processes."""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from diffthrust._support._running.pool import WorkerPool, as_done, own_worker
from diffthrust._support._running.process import ProcessDied, ProcessNotStarted, Worker
from diffthrust._support.errors import InputError, refused
from diffthrust._support.files import write_whole
from diffthrust.checks._expected import CheckRow, compared, updated
from diffthrust.checks._marks import marks_of
from diffthrust.checks._result import FitRun, not_run
from diffthrust.specs._compile_key import compile_key
from diffthrust.specs._scripts import error_in_script
from diffthrust.specs._spec import load_spec


def run_again(fit: str, file: Path, update: bool, trust: Sequence[str] = ()) -> FitRun:
    """Rerun a stored fit, and compare it with its [expected] block or update the block.

    Args:
        fit: its name.
        file: its spec file.
        update: write the block if the fit moved or has none.
        trust: folders whose scripts the spec may run, besides its own.

    Returns:
        The outcome; a fit that cannot be run, or has no expected values, gives a failed row.
    """
    from diffthrust.simulation._step_size import CoarseStepWarning

    begin, new, since = time.perf_counter(), False, ""
    with warnings.catch_warnings(record=True) as caught:
        # "always": Python otherwise issues a warning once per line of code, so that the second fit
        # of a process would have none.
        warnings.simplefilter("always", CoarseStepWarning)
        try:
            rows, new, since = _rows(fit, file, update, trust)
        except InputError as error:
            rows = [not_run(fit, error.problem, error.mend)]
        except OSError as error:
            rows = [not_run(fit, *refused(error))]
        except Exception as error:  # a defect must not hide the outcome of other fits
            if script_error := error_in_script(error):
                rows = [not_run(fit, script_error.problem, script_error.mend)]
            elif os.environ.get("DIFFTHRUST_DEBUG"):
                raise
            else:
                problem = (
                    f"a defect of diffthrust, not of your input: {type(error).__name__}: {error}"
                )
                mend = (
                    f"Please report it, with what DIFFTHRUST_DEBUG=1 diffthrust fit {file} prints."
                )
                rows = [not_run(fit, problem, mend)]
    coarse = tuple(str(w.message) for w in caught if issubclass(w.category, CoarseStepWarning))
    return FitRun(fit, file, tuple(rows), new, time.perf_counter() - begin, coarse, since)


def _rows(
    name: str, path: Path, update: bool, trust: Sequence[str]
) -> tuple[list[CheckRow], bool, str]:
    spec = load_spec(path, trust=trust)
    expected = spec.file.expected
    if expected is None and not update:
        mend = "Look at it with diffthrust fit, then write the block: diffthrust check --update."
        return [CheckRow(name, "no [expected] block", None, None, None, False, mend)], False, ""
    fit = spec.fit()
    marks = marks_of(spec, fit)
    if update:
        text = updated(spec.text, path, expected, fit, marks)
        if text != spec.text:
            _write_over(path, spec.text, text)
            expected = load_spec(path, trust=trust).file.expected
            assert expected is not None
            return list(compared(name, expected, fit)), True, ""
    assert expected is not None
    rows = list(compared(name, expected, fit))
    if not rows:
        mend = "Remove the empty [expected] block and run diffthrust check --update."
        rows = [CheckRow(name, "empty [expected] block", None, None, None, False, mend)]
    agrees = all(row.ok for row in rows)
    return rows, False, marks.data_since(expected) if agrees else marks.since(expected)


def _write_over(path: Path, original: str, replacement: str) -> None:
    """Replace the text of a spec, unless it was edited meanwhile.

    Raises:
        InputError: the file has changed since it was read.
    """
    try:
        now = path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{path}: the file can no longer be read ({error.strerror or error}).",
            "Put it back, and run diffthrust check --update again.",
        ) from None
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


class Task(NamedTuple):
    """A fit to run: its name, its spec file, whether to write its [expected] block, and trust."""

    fit: str
    file: Path
    update: bool
    trust: Sequence[str] = ()


def run_all(tasks: Sequence[Task], jobs: int) -> Iterator[tuple[int, FitRun]]:
    """Run fits, in several processes where there is more than one job.

    Yields:
        The index and outcome of each task, as they finish. A fit whose process dies counts as not
        run.
    """
    if jobs == 1:
        yield from ((i, run_again(*task)) for i, task in enumerate(tasks))
        return
    workers = [Worker(run_again) for _ in range(jobs)]
    with WorkerPool(workers, key=lambda task: compile_key(task.file)) as pool:
        for outcome in as_done(pool, _in_process, tasks):
            if outcome is not None:
                yield outcome[0], outcome[1].result()


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
        return FitRun(task.fit, task.file, (not_run(task.fit, problem, mend),))
