"""Run tasks in processes of this machine, on a Dask cluster, or on any executor."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import contextmanager
from pathlib import Path

from diffthrust._support._running.pool import WorkerPool, as_done
from diffthrust._support._running.process import Worker
from diffthrust._support.errors import InputError
from diffthrust.many._campaign.job import Job
from diffthrust.many._campaign.store import ResultRow
from diffthrust.many._campaign.task import head, perform, run_job
from diffthrust.specs._compile_key import compile_key

_CONNECT = 5.0
"""Time within which the scheduler of a cluster must answer [s]."""


def outcomes(
    executor: Executor | str | None, workers: int, jobs: Sequence[Job]
) -> Generator[ResultRow | None]:
    """Yield the rows of tasks as they finish, and ``None`` while there is no news.

    A task whose worker died also gives a row: no exception of an executor ends a campaign. Tasks
    that have not started are cancelled when the generator is closed.

    Args:
        executor: an executor, the address of a Dask scheduler, or ``None`` for processes of this
            machine.
        workers: number of processes.
        jobs: the tasks.

    Raises:
        InputError: the cluster does not answer, or Dask is not installed.
    """
    if isinstance(executor, Executor):
        for done in as_done(executor, perform, jobs):
            yield done and _row(done[1], jobs[done[0]])
    else:
        with _local(workers) if executor is None else _cluster(executor) as made:
            yield from outcomes(made, workers, jobs)


def _local(workers: int) -> Executor:
    """Processes of this machine; each gets specs that share compiled code."""
    several = [Worker(run_job, quiet=True) for _ in range(workers)]
    return WorkerPool(several, lambda job: compile_key(Path(job.spec)) if workers > 1 else "")


def _row(future: Future[ResultRow], job: Job) -> ResultRow:
    try:
        return future.result()
    except (Exception, CancelledError) as error:
        return _lost(job, error)


def _lost(job: Job, error: BaseException) -> ResultRow:
    """The row of a lost task. Its folder is not touched: its worker may have finished it."""
    broken = isinstance(error, BrokenExecutor | CancelledError)
    what = "The executor lost its workers" if broken else "No worker could do it"
    detail = f": {error}" if str(error) else ""
    return {
        **head(job, "lost"),
        "error": f"{what} ({type(error).__name__}{detail}).",
        "mend": "Run the campaign again: it does the remaining specs.",
    }


@contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            f"executor: {address!r} is the address of a Dask cluster, and Dask is not installed.",
            "Install it with pip install 'diffthrust[dask]', here and on the workers.",
        ) from None
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
