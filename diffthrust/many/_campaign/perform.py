"""One task on whatever worker it comes to: here, or in a process that may be killed."""

from __future__ import annotations

import threading
import time

from diffthrust._support._running.process import LineProcess, ProcessDied, ProcessLate
from diffthrust.many._campaign.job import Job
from diffthrust.many._campaign.store import Row
from diffthrust.many._campaign.task import failed, run

DEATHS = 3
"""A task whose process died so many times is given up."""
_own = threading.local()


def perform(job: Job) -> Row:
    """Do one task of a campaign on whatever worker this runs in, and give its row.

    A worker that is a process does it itself, so that its tasks share what JAX has compiled. Where
    the worker is one thread of several, which must not share a process, and where there is a time
    limit, which nothing but the end of a process enforces, it is done in a process of the worker.
    """
    if job.time_limit is None and threading.current_thread() is threading.main_thread():
        return run(job)
    return helped(own_process(), job)


def own_process() -> LineProcess:
    """The process of this thread, made when it is first asked for."""
    if not hasattr(_own, "process"):
        _own.process = new_process()
    return _own.process


def new_process() -> LineProcess:
    """A process that does tasks of campaigns."""
    return LineProcess(f"{run.__module__}:run_plain", quiet=True)


def helped(process: LineProcess, job: Job) -> Row:
    """Do a task in a process, which may die, or be killed at the time limit.

    Raises:
        CancelledError: the process was stopped meanwhile.
    """
    begun, why = time.perf_counter(), ""
    for _ in range(DEATHS):
        try:
            return process.ask(vars(job), job.time_limit)
        except ProcessLate:
            seconds = time.perf_counter() - begun
            problem = f"Stopped at the time limit of {job.time_limit:g} s."
            mend = "Raise the time limit, shorten its logs (start, stop), or leave it out."
            return failed(job, "timed_out", problem, mend, seconds)
        except ProcessDied as how:
            why = str(how)
    problem = f"Its process died {DEATHS} times: {why}."
    mend = "Give it more memory (fewer jobs at a time), or shorten its logs."
    return failed(job, "lost", problem, mend, time.perf_counter() - begun)
