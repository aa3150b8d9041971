"""A process that answers lines: what it is given, how it ends, and that it outlives nobody."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from concurrent.futures import CancelledError

import pytest
from processes import LineProcess, ProcessDied, ProcessLate, ProcessNotStarted

pytestmark = pytest.mark.skipif(os.name == "nt", reason="there is no SIGKILL")
OWNER = """
import sys, time
from diffthrust._support._running.process import LineProcess
process = LineProcess("os:getenv")
process.ask("HOME")
print(process.pid, flush=True)
time.sleep(60)
"""


def answer(question: list):
    """What the process of these tests does; it finds this file on the path of its owner."""
    what, value = question
    print("a model may print")
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
    process = LineProcess(f"{__name__}:answer", quiet=True)
    text, pid = process.ask(["echo", "Schub in \N{GREEK SMALL LETTER MU}N\n"])
    assert text == "Schub in \N{GREEK SMALL LETTER MU}N\n"
    given = {"OMP_NUM_THREADS": "1", "NPROC": "1", "DIFFTHRUST_CACHE": cache}
    for name, value in given.items():
        assert process.ask(["env", name]) == [value, pid]
    assert "--xla_cpu_multi_thread_eigen=false" in process.ask(["env", "XLA_FLAGS"])[0]
    assert pid == process.pid != os.getpid()
    with pytest.raises(ProcessDied, match=r"^exit status 1, it is full$"):
        process.ask(["say", "it is full"])
    assert process.ask(["echo", 1])[1] != pid  # another was started
    threading.Timer(0.3, process.stop).start()
    with pytest.raises(CancelledError):
        process.ask(["sleep", 60.0])
    with pytest.raises(CancelledError):  # it is not started again
        process.ask(["echo", 1])


def test_a_process_is_killed_at_the_limit():
    process = LineProcess("time:sleep")
    begun = time.monotonic()
    with pytest.raises(ProcessLate, match=r"^signal SIGKILL$"):
        process.ask(60.0, limit=0.2)
    assert time.monotonic() - begun < 50.0
    assert process.pid is None


def test_a_process_that_cannot_start_says_how_it_ended():
    process = LineProcess("nowhere:nothing", quiet=True)
    with pytest.raises(ProcessNotStarted, match=r"exit status 1, ModuleNotFoundError.*'nowhere'"):
        process.ask(0)


def test_a_process_ends_with_its_owner():
    words, pipe = [sys.executable, "-c", OWNER], subprocess.PIPE
    with subprocess.Popen(words, stdout=pipe, stderr=pipe, text=True) as owner:
        assert owner.stdout is not None
        assert int(owner.stdout.readline()) != owner.pid
        owner.kill()
        owner.communicate(timeout=60.0)  # until nobody holds standard error any more
