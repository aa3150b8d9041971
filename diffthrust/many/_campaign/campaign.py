"""Run a task over many specs; can be interrupted and resumed."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from diffthrust._support._running.pool import WorkerPool, as_done, processors
from diffthrust._support._running.process import Worker
from diffthrust._support.errors import InputError
from diffthrust._support.extras import extra
from diffthrust._support.files import PathLike, plain
from diffthrust._support.progress import Progress, ProgressOption, progressing, reporter
from diffthrust._support.report import Report
from diffthrust._support.results import Result
from diffthrust._support.validation import finite, whole_number
from diffthrust.many._campaign.job import Job, ResultRow, check_task, found_specs
from diffthrust.many._campaign.tables import TABLE, arrow_table, campaign_report, write_table
from diffthrust.many._campaign.task import head, kept_row, perform, run_job, sweep
from diffthrust.specs._scripts import trusted_folders

if TYPE_CHECKING:
    import pandas as pd


_SAVING = 0.02
"""Largest share of the time spent on writing the table while the campaign runs."""


@dataclass(frozen=True, repr=False)
class Campaign(Result):
    """The outcome of a campaign.

    Args:
        output: the folder of results: one folder per spec, and the table.
        task: the task done with each spec.
        rows: one for each spec, ordered by name, as plain data.
        kept: number of results kept from an earlier campaign.
        seconds: duration of this campaign.

    Example:
        >>> done.ok, done.counts, done.table.shape[0], done.path.name
        (True, {'ok': 1}, 1, 'campaign.parquet')
        >>> done.summary.startswith("1 spec")
        True
        >>> sorted(done.to_json())[:3]
        ['counts', 'kept', 'rows']
    """

    output: Path
    task: str
    rows: tuple[ResultRow, ...] = field(repr=False)
    kept: int
    seconds: float

    @property
    def path(self) -> Path:
        """The file of the table."""
        return self.output / TABLE

    @property
    def table(self) -> pd.DataFrame:
        """One row for each spec; the same as in the file."""
        return arrow_table(self.rows).to_pandas()

    @property
    def counts(self) -> dict[str, int]:
        """Number of specs by status: "ok", "failed", "timed_out", "lost"."""
        return dict(Counter(row["status"] for row in self.rows))

    @property
    def ok(self) -> bool:
        """Whether every spec has a result."""
        return set(self.counts) <= {"ok"}

    @property
    def summary(self) -> str:
        """The outcome in a sentence or two."""
        what = "1 spec" if len(self.rows) == 1 else f"{len(self.rows)} specs"
        parts = [f"{what} in {self.seconds:.0f} s: {self.counts.get('ok', 0)} done"]
        if self.kept:
            parts[0] += f" ({self.kept} of them earlier)"
        parts += [f"{n} {how.replace('_', ' ')}" for how, n in self.counts.items() if how != "ok"]
        sentence = f"{', '.join(parts)}."
        retry = " The same campaign again tries those without a result."
        return sentence if self.ok else sentence + retry

    def _line(self) -> str:
        return f"{self.task}: {self.summary}"

    def _report(self) -> Report:
        return campaign_report(self.rows, self.task, self.summary)

    def to_json(self) -> dict[str, Any]:
        """The outcome as plain data, as written by ``diffthrust campaign --json``."""
        numbers = {"counts": self.counts, "kept": self.kept, "seconds": self.seconds}
        rows = [dict(row) for row in self.rows]
        return {"schema": 1, "task": self.task, "table": str(self.path), **numbers, "rows": rows}


@progressing
def campaign(
    specs: PathLike | Iterable[PathLike],
    *,
    task: Literal["fit", "diagnose", "sample"] = "fit",
    output: PathLike = "campaign_output",
    executor: Executor | str | None = None,
    jobs: int | None = None,
    time_limit: float | None = None,
    report: bool = False,
    trust: PathLike | Iterable[PathLike] = (),
    progress: ProgressOption = None,
    **options: Any,
) -> Campaign:
    """Fit, diagnose or sample every spec found, in parallel, and collect the results in a table.

    The table takes ``pip install 'diffthrust[parquet]'``.

    Each spec gets a folder under ``output`` with its result (``fit.json``, ``diagnosis.json`` or
    ``posterior.json``) and a ``status.json``; ``campaign.parquet`` has a row for each spec, also
    for failures, with the error and its mend. Folders and table are written atomically. Run again,
    a campaign does only the remaining work: a spec whose text, logs, scripts, task and options are
    unchanged is skipped if it has a result, and retried if it failed.

    A task without a time limit runs in the worker if that is a process; a worker that is a thread,
    and any worker under a time limit, starts a separate process. If a process dies, its task is
    retried, three times in all. On a cluster, every worker must see specs, logs and output under
    the same paths.

    Args:
        specs: a folder, searched recursively for spec files; or spec files.
        task: "fit", "diagnose" or "sample".
        output: the folder of results, created if necessary.
        executor: ``None`` for processes of this machine; any `concurrent.futures.Executor`; or
            the address of a Dask scheduler, such as ``"tcp://10.0.0.5:8786"`` (``pip install
            'diffthrust[dask]'``).
        jobs: number of processes on this machine; ``None`` for one per processor.
        time_limit: seconds after which a task is killed.
        report: write ``report.html`` into each folder.
        trust: folders whose scripts specs may run, besides those in and below their own.
        progress: True for a bar, or a function of a message, with the remaining time, and the
            share done.
        **options: for a diagnosis ``candidates``; for sampling ``method``, ``draws``, ``warmup``,
            ``walkers``, ``chains``, ``seed``.

    Returns:
        A `Campaign`; ``.table`` is a data frame.

    Raises:
        InputError: there is no spec, two specs would write to one folder, the folder holds other
            results, the cluster does not answer, or the table cannot be written.
        KeyboardInterrupt: interrupted; finished results are kept, as the message says.

    Example:
        >>> done.counts  # of dft.many.campaign("fit.toml", output="results", jobs=1)
        {'ok': 1}
        >>> try:
        ...     dft.many.campaign("no_such_folder")
        ... except dft.InputError as error:
        ...     print(type(error).__name__)
        InputError
    """
    started = time.monotonic()
    options = {name: plain(value) for name, value in options.items() if value is not None}
    check_task(task, options)
    _check(executor, jobs, time_limit)
    with extra("parquet", "The table of a campaign"):
        import pyarrow  # noqa: F401
    out = Path(os.path.abspath(output))
    places = trusted_folders(trust)
    work = [
        Job(name, str(path), str(out / folder), task, options, report, time_limit, places)
        for path, name, folder in found_specs(specs, out)
    ]
    rows = {job.name: row for job in work if (row := kept_row(job))}
    todo = [job for job in work if job.name not in rows]
    kept = len(rows)
    _save(out, rows)
    if todo:
        try:
            _run(executor, jobs, todo, rows, out, reporter(progress))
        except KeyboardInterrupt:
            raise KeyboardInterrupt(
                f"{len(rows)} of {len(work)} specs are done and kept in {out}; running the same "
                "campaign again continues from there."
            ) from None
        finally:  # also if the table cannot be written: that stops workers in the midst of writing
            sweep(out, work)
            _save(out, rows)
    ordered = tuple(rows[name] for name in sorted(rows))
    return Campaign(out, task, ordered, kept, time.monotonic() - started)


def _run(
    executor: Executor | str | None,
    jobs: int | None,
    todo: list[Job],
    rows: dict[str, ResultRow],
    out: Path,
    report_progress: Progress,
) -> None:
    """Do the remaining work, and write the table from time to time."""
    kept, total = len(rows), len(rows) + len(todo)
    report_progress(_progress_text(rows, kept, total, 0.0), kept / total)
    jobs = min(jobs or processors(), len(todo))
    with executor_for(executor, jobs) as chosen, closing(as_done(chosen, perform, todo)) as each:
        started = saved = time.monotonic()
        cost = 0.0
        for i, future in each:
            rows[todo[i].name] = row_of(future, todo[i])
            now = time.monotonic()
            report_progress(_progress_text(rows, kept, total, now - started), len(rows) / total)
            # The whole table is written each time: with thousands of rows that takes seconds, so
            # that the pause grows with its cost.
            if now - saved > max(5.0, cost / _SAVING):
                _save(out, rows)
                saved = time.monotonic()
                cost = saved - now


def _save(out: Path, rows: Mapping[str, ResultRow]) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
        write_table(out / TABLE, list(rows.values()))
    except (OSError, InputError) as error:
        what = error.problem if isinstance(error, InputError) else f"{out}: {error.strerror}"
        raise InputError(
            f"The table of the campaign cannot be written: {what}",
            "Make room, or name an output folder that can be written to, and run the campaign "
            "again: what is done is kept in its folders.",
        ) from None


def _progress_text(rows: Mapping[str, ResultRow], kept: int, total: int, seconds: float) -> str:
    """Progress, and the remaining time at the current pace."""
    bad = sum(row["status"] != "ok" for row in rows.values())
    parts = [f"{len(rows)} of {total} done"]
    if bad:
        parts.append(f"{bad} failed")
    new, remaining = len(rows) - kept, total - len(rows)
    if new and remaining:
        wait = seconds / new * remaining
        unit, size = ("s", 1) if wait < 90 else ("min", 60) if wait < 5400 else ("h", 3600)
        parts.append(f"about {wait / size:.0f} {unit} left")
    return ", ".join(parts)


def _check(executor: Any, jobs: Any, time_limit: Any) -> None:
    if executor is not None and not isinstance(executor, str | Executor):
        raise InputError(
            f"executor: expected a concurrent.futures.Executor or the address of a Dask scheduler, "
            f"found {type(executor).__name__}.",
            "A Dask client gives one with client.get_executor().",
        )
    if jobs is not None:
        if executor is not None:
            raise InputError(
                "jobs: the executor determines its number of workers.",
                "Leave out jobs or the executor.",
            )
        whole_number("jobs", jobs)
    if time_limit is not None:
        finite("time_limit", time_limit, lambda seconds: seconds > 0, "seconds above zero")


_CONNECT = 5.0
"""Time within which the scheduler of a cluster must answer [s]."""


def executor_for(asked: Executor | str | None, workers: int) -> AbstractContextManager[Executor]:
    """An executor as it is, that of a Dask cluster by its address, or processes of this machine."""
    if isinstance(asked, Executor):
        return nullcontext(asked)
    if asked is not None:
        return _dask(asked)
    return WorkerPool([Worker(run_job, quiet=True) for _ in range(workers)])


def row_of(future: Future[ResultRow], job: Job) -> ResultRow:
    """The row of a task that is done; no exception of an executor ends a campaign.

    The folder of a lost task is not touched: its worker may have finished it.
    """
    try:
        return future.result()
    except (Exception, CancelledError) as error:
        broken = isinstance(error, BrokenExecutor | CancelledError)
        what = "The executor lost its workers" if broken else "No worker could do it"
        detail = f": {error}" if str(error) else ""
        return {
            **head(job, "lost"),
            "error": f"{what} ({type(error).__name__}{detail}).",
            "mend": "Run the campaign again: it does the remaining specs.",
        }


@contextmanager
def _dask(address: str) -> Iterator[Executor]:
    with extra("dask", f"executor: the Dask cluster at {address!r}, here and on its workers,"):
        from distributed import Client
    try:
        client = Client(address, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:  # TimeoutError is an OSError
        raise InputError(
            f"executor: no Dask scheduler answers at {address!r} ({error}).",
            "Start one (dask scheduler) and its workers (dask worker ADDRESS), or correct the "
            "address, such as tcp://10.0.0.5:8786.",
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=_CONNECT)
        except TimeoutError:
            raise InputError(
                f"executor: the Dask scheduler at {address!r} has no workers.",
                f"Start some (dask worker {address}); of a cluster that grows when it has work, "
                "give client.get_executor() as the executor.",
            ) from None
        # Dask takes calls with equal arguments for one and returns the earlier result (pure): a
        # campaign that retries a failed spec must run it again.
        yield client.get_executor(pure=False)
