"""Where the tasks of a campaign are done: processes of this machine, Dask, or any executor."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from diffthrust._support._running.pool import WorkerPool
from diffthrust._support._running.process import Worker
from diffthrust._support.errors import InputError
from diffthrust.many._campaign.job import Job
from diffthrust.many._campaign.store import ResultRow
from diffthrust.many._campaign.task import head, run_job
from diffthrust.specs._compile_key import compile_key

_CONNECT = 5.0
"""Time within which the scheduler of a cluster must answer [s]."""


@contextmanager
def executor_for(asked: Executor | str | None, workers: int) -> Iterator[Executor]:
    """An executor as it is, that of a Dask cluster by its address, or processes of this machine."""
    if isinstance(asked, Executor):
        yield asked
    elif asked is None:
        several = [Worker(run_job, quiet=True) for _ in range(workers)]
        key = (lambda job: compile_key(Path(job.spec))) if workers > 1 else lambda job: ""
        with WorkerPool(several, key) as pool:
            yield pool
    else:
        with _client(asked) as client:
            # Dask takes calls with equal arguments for one and returns the earlier result (pure): a
            # campaign that retries a failed spec must run it again.
            yield client.get_executor(pure=False)


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
def _client(address: str) -> Iterator[Any]:
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
        yield client
