"""One task of a campaign on a worker: the work, its row and its folder, complete or not at all."""

from __future__ import annotations

import json
import os
import re
import shutil
import threading
import time
import uuid
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from diffthrust._support._running.pool import own_worker
from diffthrust._support._running.process import ProcessDied, ProcessLate, Worker
from diffthrust._support.errors import InputError
from diffthrust._support.files import plain, write_json
from diffthrust._support.visible import visible
from diffthrust.estimation._result import Fit
from diffthrust.many._batch.result import estimates_of, fit_row
from diffthrust.many._campaign.job import Job, ResultRow, fingerprint
from diffthrust.specs._scripts import as_input_error
from diffthrust.specs._spec import Spec

_DEATHS = 3
"""A task is given up after its process died this many times."""
_STATUS, _PAGE = "status.json", "report.html"
_RESULT = {"fit": "fit.json", "diagnose": "diagnosis.json", "sample": "posterior.json"}

_Result = tuple[Mapping[str, Any], ResultRow, Callable[[Path], None]]
"""A result as plain data, as columns of the table, and what writes it as a page."""


def perform(job: Job) -> ResultRow:
    """Do one task of a campaign on the current worker, and return its row.

    A worker that is a process does it directly, so that its tasks share compiled programs. A worker
    that is a thread starts a process, since threads must not share one; so does any worker under a
    time limit, since only killing a process enforces it.
    """
    if job.time_limit is None and threading.current_thread() is threading.main_thread():
        return run_job(job)
    return helped(own_worker(run_job), job)


def helped(worker: Worker, job: Job) -> ResultRow:
    """Do a task in a worker; retry if it dies, kill it at the time limit."""
    started, why = time.perf_counter(), ""
    # The first death may be bad luck: another process took the memory, or an administrator killed
    # it.
    for _ in range(_DEATHS):
        try:
            return worker.ask(job, limit=job.time_limit)
        except ProcessLate:
            problem = f"Stopped at the time limit of {job.time_limit:g} s."
            mend = "Raise the time limit, shorten its logs (start, stop), or leave it out."
            return failed(job, "timed_out", problem, mend, started)
        except ProcessDied as how:
            why = str(how)
    problem = f"Its process died {_DEATHS} times: {why}."
    mend = "Give it more memory (fewer jobs at a time), or shorten its logs."
    return failed(job, "lost", problem, mend, started)


def run_job(job: Job) -> ResultRow:
    """Do the work on one spec and write its folder; any error goes into the row."""
    started, mark = time.perf_counter(), None
    try:
        mark = fingerprint(job.load(), job)
        # Loaded after the first fingerprint: a change in between shows in the second one below.
        spec = job.load()
        data, columns, page = _TASKS[job.task](spec, job)
        if fingerprint(job.load(), job) != mark:
            raise InputError(
                "The spec, one of its logs or a script that it names was changed while it was "
                "worked on: it is unknown which state the result belongs to.",
                "Run the campaign again.",
            )
        seconds = time.perf_counter() - started
        row = plain({**head(job, "ok"), **columns, "seconds": seconds})
        store(job, row, mark, data, page if job.report else None)
        return row
    except Exception as error:
        failure = as_input_error(error, f"diffthrust {job.task} {job.spec}")
    # Not before here: until an error is let go, all that the failed work had in memory stays.
    return failed(job, "failed", failure.problem, failure.mend, started, mark)


def head(job: Job, status: str) -> ResultRow:
    """The columns that every row has."""
    where = {"name": job.name, "spec": job.spec, "folder": Path(job.folder).name}
    return {**{key: visible(value) for key, value in where.items()}, "status": status}


def failed(
    job: Job, status: str, problem: str, mend: str, started: float, mark: str | None = None
) -> ResultRow:
    """The row of a spec without a result; also written to its folder if possible."""
    seconds = time.perf_counter() - started
    row = {**head(job, status), "error": visible(problem), "mend": mend, "seconds": seconds}
    with suppress(InputError):  # the table has the row in any case
        store(job, row, mark)
    return row


def _fit(spec: Spec, job: Job) -> _Result:
    train, unseen = spec.train_logs(), spec.holdout_logs()
    fit = spec.fit(train=train, holdout=unseen)

    def page(path: Path) -> None:
        from diffthrust.comparison._page import comparisons_of, write_comparison_page

        held = comparisons_of(fit, train, unseen)
        write_comparison_page(path, title=job.name, spec=spec.text, comparisons=held, fit=fit)

    return fit.to_json(), _columns(fit), page


def _diagnose(spec: Spec, job: Job) -> _Result:
    diag = spec.diagnose(candidates=job.options.get("candidates"))
    columns = {**_columns(diag.fit), "verdict": diag.verdict, "added": ", ".join(diag.added)}
    title = f"Diagnosis: {job.name}"
    return diag.to_json(), columns, lambda path: diag.save(path, title=title, spec=spec.text)


def _sample(spec: Spec, job: Job) -> _Result:
    from diffthrust.uncertainty._sampling.sample import sample
    from diffthrust.uncertainty._sampling.summary import sampled, write_posterior_page

    train, unseen = spec.train_logs(), spec.holdout_logs()
    fit = spec.fit(train=train, holdout=unseen)
    drawn = sample(fit, train, **job.options)
    posterior = sampled(drawn, fit, train, unseen, seed=job.options.get("seed", 0))

    def page(path: Path) -> None:
        write_posterior_page(posterior, path, title=f"Posterior: {job.name}", spec=spec.text)

    numbers = {name: (s.median, s.sd) for name, s in posterior.parameters.items()}
    columns = {"verdict": posterior.convergence.status.value, "numbers": numbers}
    return posterior.to_json(), {**_columns(fit), **columns}, page


def _columns(fit: Fit) -> ResultRow:
    return {**fit_row(fit), "numbers": estimates_of(fit)}


_TASKS: Mapping[str, Callable[[Spec, Job], _Result]] = {
    "fit": _fit,
    "diagnose": _diagnose,
    "sample": _sample,
}


def store(
    job: Job,
    row: ResultRow,
    mark: str | None = None,
    data: Mapping[str, Any] | None = None,
    page: Callable[[Path], None] | None = None,
) -> None:
    """Write the folder of a task under a temporary sibling name, then rename.

    A folder of an earlier run is replaced. A kill leaves at worst a hidden folder, which the next
    campaign removes. ``mark`` is the `fingerprint` of its inputs.
    """
    target = Path(job.folder)
    fresh = target.with_name(f".{target.name}.{uuid.uuid4().hex}.tmp")
    # No system replaces a folder that has files in one step: the old one is moved aside, and back
    # if the new one cannot take its place.
    old = fresh.with_suffix(".old")
    try:
        fresh.mkdir(parents=True)
        if data is not None:
            write_json(fresh / _RESULT[job.task], data)
        if page:
            page(fresh / _PAGE)
        status = {"schema": 1, "task": job.task, "fingerprint": mark, "row": row}
        write_json(fresh / _STATUS, status)
        if target.exists():
            os.rename(target, old)
        os.rename(fresh, target)
        shutil.rmtree(old, ignore_errors=True)
    except (OSError, ValueError) as error:  # ValueError: a name that is not valid text
        what = error.problem if isinstance(error, InputError) else f"{target}: {error}"
        raise InputError(
            f"The result cannot be written: {what}",
            "Make room, or let the folder be written to, and run the campaign again.",
        ) from None
    finally:
        shutil.rmtree(fresh, ignore_errors=True)
        with suppress(OSError):  # the folder may be locked meanwhile
            if old.exists() and not target.exists():
                os.rename(old, target)


def kept_row(job: Job) -> ResultRow | None:
    """The row of a task whose folder holds a complete result of its current inputs."""
    place = Path(job.folder)
    try:
        status = json.loads((place / _STATUS).read_text(encoding="utf-8"))
        task, row, mark = status["task"], status["row"], status.get("fingerprint")
        spec, how = row["spec"], row.get("status")
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return None
    if task != job.task:
        raise InputError(
            f"{job.folder}: it holds the task {task!r} of {spec}, and this campaign would put "
            f"{job.task!r} there.",
            "Name another output folder.",
        )
    # A spec that was moved leaves its result behind under the old path: only one that still exists
    # is another spec.
    if spec != job.spec and Path(spec).exists():
        raise InputError(
            f"{job.folder}: it holds the result of {spec}, and this campaign would put that of "
            f"{job.spec} there.",
            "Name another output folder.",
        )
    try:
        current = fingerprint(job.load(), job)
    except InputError:
        return None
    files = [_RESULT[job.task], *([_PAGE] if job.report else [])]
    whole = how == "ok" and mark == current and all((place / name).is_file() for name in files)
    return {**row, **head(job, "ok")} if whole else None


def sweep(output: Path, jobs: Iterable[Job]) -> None:
    """Remove half-written folders of killed workers."""
    folders = {Path(job.folder).name for job in jobs}
    for entry in output.iterdir() if output.is_dir() else ():
        match = re.fullmatch(r"\.(.+)\.[0-9a-f]{32}\.(tmp|old)", entry.name)
        if match and match[1] in folders:
            shutil.rmtree(entry, ignore_errors=True)
