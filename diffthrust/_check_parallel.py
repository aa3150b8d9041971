"""Many fits at a time, each worker a Python process of its own.

JAX and a fork do not agree, so that every worker is a fresh interpreter. It is started with the
environment that it needs, which the start methods of ``multiprocessing`` do not allow: the number
of threads is read when NumPy and XLA are imported. A line of JSON asks, another answers; nothing is
imported from the caller's script, and a worker that dies takes no other with it.
"""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from diffthrust._check_run import Run, not_run
from diffthrust._errors import InputError
from diffthrust._expected import Row
from diffthrust._spec_file import parse_spec, read_spec_text

_BEGIN = (
    "import json, sys; sys.path[:] = json.loads(sys.stdin.readline()); "
    "from diffthrust._check_worker import serve; serve()"
)
_ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NPROC"), "1"
)
"""NPROC is the number of threads of XLA on the CPU."""


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
    plan = _Plan(tasks)
    done: queue.Queue[tuple[int, Run] | BaseException] = queue.Queue()
    workers = [_Worker(plan, done) for _ in range(jobs)]
    try:
        for worker in workers:
            worker.start()
        for _ in tasks:
            found = done.get()
            if isinstance(found, BaseException):
                raise found
            yield found
    finally:
        plan.clear()
        for worker in workers:
            worker.stop()
        for worker in workers:
            worker.join()


class _Plan:
    """The fits that are left, in groups that share compiled code; a worker stays with its group."""

    def __init__(self, tasks: Sequence[Task]) -> None:
        self._tasks = tasks
        self._lock = threading.Lock()
        self._begun: set[str] = set()
        self._groups: dict[str, deque[int]] = {}
        for i, task in enumerate(tasks):
            self._groups.setdefault(_alike(task.file), deque()).append(i)

    def next(self, last: str | None) -> tuple[str, int, Task] | None:
        """The next fit of the group, or of the largest group that is left, untouched ones first."""
        with self._lock:
            left = {key: len(group) for key, group in self._groups.items() if group}
            if not left:
                return None
            key = last if last in left else max(left, key=lambda k: (k not in self._begun, left[k]))
            self._begun.add(key)
            i = self._groups[key].popleft()
            return key, i, self._tasks[i]

    def clear(self) -> None:
        """Let no further fit begin."""
        with self._lock:
            self._groups.clear()


def _alike(file: Path) -> str:
    """The same text for fits that share compiled code: model, channels, options, lengths of logs.

    A guess from the outside, which costs a compilation where it is wrong and nothing else.
    """
    try:
        spec = parse_spec(read_spec_text(file), file)
    except InputError:
        return ""
    channels = {name: bool(part.noise) for name, part in sorted(spec.channels.items())}
    fixed = {name: part.fixed for name, part in spec.parameters.items() if part.fixed is not None}
    lengths = [_lines(file.parent / name) for name in (*spec.logs.train, *spec.logs.holdout)]
    return repr((spec.model, spec.effects, spec.options, channels, fixed, spec.fit, lengths))


def _lines(file: Path) -> int:
    try:
        return file.read_bytes().count(b"\n")
    except OSError:
        return 0


class _Worker(threading.Thread):
    """A thread that hands fits to a process, one after the other, and starts another if it dies."""

    def __init__(self, plan: _Plan, done: queue.Queue[tuple[int, Run] | BaseException]) -> None:
        super().__init__(daemon=True)
        self._plan = plan
        self._done = done
        self._process: subprocess.Popen[str] | None = None
        self._stopped = False

    def run(self) -> None:
        """Work until nothing is left."""
        key = None
        try:
            while (given := self._plan.next(key)) is not None:
                key, i, task = given
                self._done.put((i, self._answer(task)))
        except BaseException as error:  # the thread that waits is to raise it
            self._done.put(error)
        finally:
            self._end()

    def stop(self) -> None:
        """Kill the process, in the midst of a fit if need be."""
        self._stopped = True
        if process := self._process:
            process.kill()

    def _answer(self, task: Task) -> Run:
        process = self._process or self._begin()
        if line := _asked(process, [task.fit, str(task.file), task.update]):
            return _run(task, json.loads(line))
        problem = f"the process that ran it died ({_cause(self._end())})."
        mend = f"Run diffthrust fit {task.file} alone; if memory was short, take fewer --jobs."
        return Run(task.fit, task.file, (not_run(task.fit, problem, mend),))

    def _begin(self) -> subprocess.Popen[str]:
        process = self._process = _process()
        if self._stopped:  # while it was being started
            process.kill()
        if not _asked(process, sys.path) and not self._stopped:
            raise InputError(
                f"A process for the fits cannot be started ({_cause(self._end())}).",
                "See what it printed above; --jobs 1 does without.",
            )
        return process

    def _end(self) -> int:
        """Let the process end, which it does when there is nothing more to read."""
        process, self._process = self._process, None
        if process is None:
            return 0
        process.communicate()
        return process.returncode


def _process() -> subprocess.Popen[str]:
    import jax

    flags = f"--xla_cpu_multi_thread_eigen=false {os.environ.get('XLA_FLAGS', '')}".strip()
    cache = {"DIFFTHRUST_CACHE": jax.config.values["jax_compilation_cache_dir"] or "off"}
    return subprocess.Popen(
        [sys.executable, "-P", "-c", _BEGIN],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, **_ONE_THREAD, **cache, "XLA_FLAGS": flags},
        start_new_session=True,  # Ctrl-C is for the check, which ends its workers
    )


def _asked(process: subprocess.Popen[str], question: Any) -> str:
    """The line that answers a question; empty where the process has died."""
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        print(json.dumps(question), file=process.stdin, flush=True)
    except OSError:
        return ""
    line = process.stdout.readline()
    return line if line.endswith("\n") else ""


def _run(task: Task, answer: dict[str, Any]) -> Run:
    rows = tuple(Row(**row) for row in answer["rows"])
    told = tuple(answer["warnings"])
    return Run(task.fit, task.file, rows, answer["updated"], answer["seconds"], told)


def _cause(code: int) -> str:
    if code >= 0:
        return f"exit status {code}"
    try:
        return f"signal {signal.Signals(-code).name}"
    except ValueError:
        return f"signal {-code}"
