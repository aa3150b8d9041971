"""A process that answers calls: what it is given, how it ends, and that it outlives nobody."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from concurrent.futures import CancelledError

import pytest
from processes import (
    NotSent,
    ProcessDied,
    ProcessLate,
    ProcessNotStarted,
    Worker,
    WorkerPool,
    as_done,
    own_worker,
)

pytestmark = pytest.mark.skipif(os.name == "nt", reason="there is no SIGKILL")
OWNER = """
import os, sys, time
from diffthrust._support._running.process import Worker
process = Worker(os.getenv)
process.ask("HOME")
print(process.pid, flush=True)
time.sleep(60)
"""


def answer(what, value):
    """What the process of these tests does; it finds this file on the path of its owner."""
    print("a model may print")
    if what == "input":
        return input()
    if what == "say":
        sys.exit(value)
    if what == "sleep":
        time.sleep(value)
    return [os.environ.get(value, "") if what == "env" else value, os.getpid()]


@pytest.fixture
def cache(tmp_path):
    """The compilation cache of this process."""
    import jax

    before = jax.config.values["jax_compilation_cache_dir"]
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    yield str(tmp_path)
    jax.config.update("jax_compilation_cache_dir", before)


def test_a_process_answers_and_its_end_is_told(cache):
    process = Worker(answer, quiet=True)
    text, pid = process.ask("echo", "Schub in \N{GREEK SMALL LETTER MU}N\n")
    assert text == "Schub in \N{GREEK SMALL LETTER MU}N\n"
    given = {"OMP_NUM_THREADS": "1", "NPROC": "1", "DIFFTHRUST_CACHE": cache}
    for name, value in given.items():
        assert process.ask("env", name) == [value, pid]
    assert "--xla_cpu_multi_thread_eigen=false" in process.ask("env", "XLA_FLAGS")[0]
    assert pid == process.pid != os.getpid()
    with pytest.raises(ProcessDied, match=r"^exit status 1, it is full$"):
        process.ask("say", "it is full")
    assert process.ask("echo", 1)[1] != pid  # another was started
    with pytest.raises(ProcessDied, match="EOFError"):  # what is sent to it is no input
        process.ask("input", None)
    threading.Timer(0.3, process.stop).start()
    with pytest.raises(CancelledError):
        process.ask("sleep", 60.0)
    with pytest.raises(CancelledError):  # it is not started again
        process.ask("echo", 1)


def test_a_process_is_killed_at_the_limit():
    process = Worker(time.sleep)
    begun = time.monotonic()
    with pytest.raises(ProcessLate, match=r"^signal SIGKILL$"):
        process.ask(60.0, limit=0.2)
    assert time.monotonic() - begun < 50.0
    assert process.pid is None


class Here:
    """What another process may not be able to load."""


def test_what_cannot_be_sent_is_told_and_the_process_goes_on(monkeypatch):
    process = Worker(answer)
    with pytest.raises(NotSent, match="lambda"):
        process.ask("echo", lambda: 0)
    _, pid = process.ask("echo", 1)
    monkeypatch.setattr(Here, "__module__", "__main__")
    monkeypatch.setattr(sys.modules["__main__"], "Here", Here, raising=False)
    with pytest.raises(NotSent, match="Here"):
        process.ask("echo", Here())
    assert process.ask("echo", 1)[1] == pid


def test_a_process_that_cannot_start_says_how_it_ended(monkeypatch):
    monkeypatch.setattr(answer, "__module__", "nowhere")
    process = Worker(answer, quiet=True)
    with pytest.raises(ProcessNotStarted, match=r"exit status 1, ModuleNotFoundError.*'nowhere'"):
        process.ask(0)


def test_a_pool_whose_processes_the_system_refuses_tells_each_task(monkeypatch):
    monkeypatch.setattr("sys.executable", "/nowhere/python")
    with WorkerPool([Worker(answer), Worker(answer)]) as pool:
        futures = [pool.submit(lambda: own_worker().ask("echo", 1)) for _ in range(3)]
        for future in futures:
            with pytest.raises(OSError, match="/nowhere/python"):
                future.result(60.0)


def test_workers_of_a_pool_begin_far_apart():
    begun, both = [], threading.Barrier(2, timeout=60.0)

    def work(task):
        begun.append(task)
        both.wait()
        return 10 * task

    with WorkerPool([Worker(answer), Worker(answer)]) as pool:
        done = dict(as_done(pool, work, range(8)))
    assert {i: future.result() for i, future in done.items()} == {i: 10 * i for i in range(8)}
    pairs = [set(begun[i : i + 2]) for i in range(0, 8, 2)]
    assert pairs == [{0, 4}, {1, 5}, {2, 6}, {3, 7}]


def test_a_process_ends_with_its_owner():
    words, pipe = [sys.executable, "-c", OWNER], subprocess.PIPE
    with subprocess.Popen(words, stdout=pipe, stderr=pipe, text=True) as owner:
        assert owner.stdout is not None
        assert int(owner.stdout.readline()) != owner.pid
        owner.kill()
        owner.communicate(timeout=60.0)  # until nobody holds standard error any more
