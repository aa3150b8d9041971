"""A process for one job of one tool at one size: no other memory or caches count."""

from __future__ import annotations

import importlib
import os
import signal
import sys
import time
from collections.abc import Callable
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import Any

ENOUGH = 0.05
"""Short work is repeated for so long in each turn [s]."""
PATIENCE = 10.0
"""A process that is not at work may take so long to end [s]."""
MIB = 2**20
XLA_FLAGS = os.environ.get("XLA_FLAGS", "")
"""As whoever ran the command set them: this package adds to them, which peers must not inherit."""


class Failed(Exception):
    """The tool raised an error, or its process died."""


class Late(Exception):
    """The tool did not answer in time."""


def memory(key: str) -> float:
    """Memory of this process and of those it started [MiB]: ``VmHWM`` its peak, ``VmRSS`` now.

    Where Linux does not tell, the peak of this process alone by `getrusage`, whose figure counts
    in the process that started it.
    """
    files = [
        Path(f"/proc/{pid}/status") for pid in (os.getpid(), *(c.pid for c in active_children()))
    ]
    if files[0].exists():
        return sum(int(f.read_text().split(f"{key}:")[1].split()[0]) for f in files) * 1024 / MIB
    import resource

    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / MIB


def timed(run: Callable[[int], Any], turn: int) -> tuple[float, Any]:
    """Mean seconds of as many runs as are worth timing, and the answer of the last."""
    count, begun = 0, time.perf_counter()
    while True:
        answer = run(turn)
        count += 1
        spent = time.perf_counter() - begun
        if turn == 0 or spent > ENOUGH:  # turn 0 is the first call, which compiles
            return spent / count, answer


def serve(pipe: Any, module: str, job: str, size: int, platform: str, flags: str) -> None:
    """Import the tool, prepare the job, then run it once for each turn that is asked for."""
    if hasattr(os, "setsid"):
        os.setsid()  # what the tool starts ends with it
    os.environ["JAX_PLATFORMS" if platform == "cpu" else "JAX_DEFAULT_DEVICE"] = platform
    os.environ["XLA_PYTHON_CLIENT_PREALLOCATE"] = "false"
    os.environ["XLA_FLAGS"] = flags
    try:
        begun = time.perf_counter()
        tool = importlib.import_module(module)
        imported = time.perf_counter() - begun, memory("VmRSS")
        run = getattr(tool, job)(size)
        pipe.send(("done", imported))
        while True:
            turn = pipe.recv()
            seconds, answer = timed(run, turn)
            pipe.send(("done", (seconds, answer, memory("VmHWM"))))
    except EOFError:  # whoever asked is gone
        return
    except Exception as error:
        pipe.send(("failed", f"{type(error).__name__}: {error}"))


class Worker:
    """The process, seen from outside.

    Args:
        module: of the tool.
        job: by name.
        size: of the job.
        platform: "cpu" or "gpu".
    """

    def __init__(self, module: str, job: str, size: int, platform: str = "cpu") -> None:
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        given = (theirs, module, job, size, platform, XLA_FLAGS)
        self._process = context.Process(target=serve, args=given)
        self._process.start()
        self._busy = True
        theirs.close()

    def ready(self, limit: float) -> tuple[float, float]:
        """Seconds and memory [MiB] of the imports."""
        return self._answer(limit)

    def run(self, turn: int, limit: float) -> tuple[float, Any, float]:
        """Seconds of one run, its answer, and the peak of the memory so far [MiB]."""
        self._pipe.send(turn)
        self._busy = True
        return self._answer(limit)

    def _answer(self, limit: float) -> Any:
        if not self._pipe.poll(limit):
            raise Late
        try:
            word, told = self._pipe.recv()
        except EOFError:
            raise Failed("The process died.") from None
        self._busy = False
        if word == "failed":
            raise Failed(told)
        return told

    def close(self) -> None:
        """End the process and all that it started, by force if it is at work."""
        self._pipe.close()
        self._process.join(0.0 if self._busy else PATIENCE)
        if self._process.pid is not None and self._process.is_alive():
            try:
                os.killpg(self._process.pid, signal.SIGKILL)
            except (AttributeError, ProcessLookupError):  # no groups here, or not one yet
                self._process.kill()
        self._process.join()


def find_gpu(pipe: Any) -> None:
    """Send the kind of the first GPU that JAX has, or ``None``."""
    os.environ["XLA_PYTHON_CLIENT_PREALLOCATE"] = "false"
    import jax

    try:
        pipe.send(jax.devices("gpu")[0].device_kind)
    except RuntimeError:
        pipe.send(None)


def gpu() -> str | None:
    """The kind of the first GPU that JAX has; asked in a process of its own, which frees it."""
    context = get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=find_gpu, args=(theirs,))
    process.start()
    theirs.close()
    try:
        return ours.recv()
    except EOFError:
        return None
    finally:
        process.join()
