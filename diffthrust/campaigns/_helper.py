"""A process that works for one worker: kept from task to task, and killed at the time limit."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import CancelledError
from contextlib import suppress

from diffthrust.campaigns._job import Job
from diffthrust.campaigns._store import Row
from diffthrust.campaigns._task import failed, run

DEATHS = 3
"""A task whose process died so many times is given up."""
_START_LIMIT = 300.0
"""Seconds that a process may take to import the library, on a machine with much to do."""
_ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NPROC"), "1"
)
"""So that processes do not fight for processors; NPROC is the number of threads of XLA."""
_own = threading.local()


def perform(job: Job) -> Row:
    """Do one task of a campaign on whatever worker this runs in, and give its row.

    A worker that is a process does it itself, so that its tasks share what JAX has compiled. Where
    the worker is one thread of several, which must not share a process, and where there is a time
    limit, which nothing but the end of a process enforces, it is done in a `Helper` of the worker.
    """
    if job.time_limit is None and threading.current_thread() is threading.main_thread():
        return run(job)
    return own_helper().run(job)


def own_helper() -> Helper:
    """The helper of this thread, made when it is first asked for."""
    if not hasattr(_own, "helper"):
        _own.helper = Helper()
    return _own.helper


class Helper:
    """A process that does one task after the other, with one thread for its arithmetic.

    It ends with the process that it belongs to, even if that is killed, and when it has had nothing
    to do for a while; the next task starts another.
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None
        self._said = None
        self._stopped = False

    def run(self, job: Job) -> Row:
        """Do a task; its process may die, or be killed at the time limit, and this goes on.

        Raises:
            CancelledError: `stop` was called meanwhile.
        """
        begun, deaths = time.perf_counter(), 0
        while not self._stopped:
            process = self._started()
            line, late = "", False
            if process is not None:
                line, late = _asked(process, json.dumps(vars(job)), job.time_limit)
            if line:
                return json.loads(line)
            if self._stopped:
                break
            seconds = time.perf_counter() - begun
            if late:
                self._end()
                problem = f"Stopped at the time limit of {job.time_limit:g} s."
                mend = "Raise the time limit, shorten its logs (start, stop), or leave it out."
                return failed(job, "timed_out", problem, mend, seconds)
            deaths += 1
            why = self._end()
            if deaths == DEATHS:
                problem = f"Its process died {deaths} times: {why}."
                mend = "Give it more memory (fewer jobs at a time), or shorten its logs."
                return failed(job, "lost", problem, mend, seconds)
        raise CancelledError

    def stop(self) -> None:
        """Kill the process from another thread, and start no other; `close` cleans up."""
        self._stopped = True
        process = self._process
        if process is not None:
            process.kill()

    def close(self) -> None:
        """End the process, from the thread that uses it or when that has ended."""
        self._end()

    __del__ = close

    def _started(self) -> subprocess.Popen[str] | None:
        """A process that has said that it is ready, or ``None`` where it died on the way."""
        if self._process is not None and self._process.poll() is None:
            return self._process
        self._end()
        self._said = tempfile.TemporaryFile()  # noqa: SIM115  (closed with the process)
        flags = f"--xla_cpu_multi_thread_eigen=false {os.environ.get('XLA_FLAGS', '')}".strip()
        path = os.pathsep.join(folder or os.getcwd() for folder in sys.path)
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "diffthrust.campaigns._serve"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._said,
            text=True,
            encoding="utf-8",
            env={**_ONE_THREAD, **os.environ, "XLA_FLAGS": flags, "PYTHONPATH": path},
            start_new_session=True,  # Ctrl-C is for the campaign, which ends its helpers
        )
        if self._stopped:  # while it was being started
            self._process.kill()
        ready, _ = _answer(self._process, _START_LIMIT)
        return self._process if ready else None

    def _end(self) -> str:
        """Kill the process if it lives, and say how it ended."""
        process, said = self._process, self._said
        self._process = self._said = None
        if process is None or said is None:
            return ""
        process.kill()
        code = process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe:
                with suppress(OSError):  # of what was not yet sent
                    pipe.close()
        with said:
            said.seek(0)
            last = said.read().decode(errors="replace").strip().splitlines()[-1:]
        how = f"exit status {code}" if code >= 0 else f"killed by {_signal(-code)}"
        return ", ".join([how, *last])


def _asked(process: subprocess.Popen[str], line: str, limit: float | None) -> tuple[str, bool]:
    assert process.stdin is not None
    try:
        process.stdin.write(f"{line}\n")
        process.stdin.flush()
    except OSError:
        return "", False
    return _answer(process, limit)


def _answer(process: subprocess.Popen[str], limit: float | None) -> tuple[str, bool]:
    """The next line that a process writes, and whether it was killed at a limit instead."""
    assert process.stdout is not None
    late = threading.Event()

    def expire() -> None:
        late.set()
        process.kill()

    timer = threading.Timer(limit, expire) if limit is not None else None
    if timer:
        timer.start()
    try:
        line = process.stdout.readline()
    finally:
        if timer:
            timer.cancel()
    return (line, False) if line.endswith("\n") else ("", late.is_set())


def _signal(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
