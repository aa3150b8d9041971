"""A separate Python process that answers calls, one at a time.

JAX does not survive a fork, so the process is a fresh interpreter. It starts with the environment
that it needs, which the start methods of ``multiprocessing`` do not allow: the number of threads is
read when NumPy and XLA are imported. Nothing is imported from the caller's script. Existing pools
do less: docs/explanation/dependencies.md.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from concurrent.futures import CancelledError
from contextlib import suppress
from typing import Any

from diffthrust._support._running.blas import THREADS

_START_LIMIT = 300.0
"""Seconds that a process may take to import the library, on a busy machine."""
_DEATH_LIMIT = 60.0
"""Seconds that a process may take to end after it has closed its pipe, before it is killed: its
exit status names the cause (such as signal 9, out of memory), a kill of ours would hide it. On a
busy machine the interpreter takes more than five to end."""
_ONE_THREAD = dict.fromkeys((*THREADS, "NPROC"), "1")
"""So that processes do not fight for processors; NPROC is the number of threads of XLA."""


class ProcessDied(Exception):
    """A process ended instead of answering; the message says how."""


class ProcessLate(ProcessDied):
    """It was killed at the time limit."""


class ProcessNotStarted(ProcessDied):
    """It ended before it could be asked."""


class NotSent(Exception):
    """What a call was given cannot be sent, such as a class of the caller's script."""


class Worker:
    """A process with one thread for its arithmetic, kept from call to call.

    It ends with the process that it belongs to, even if that is killed, and when it has had nothing
    to do for a while; the next call starts another. One that dies takes one call with it.

    Args:
        answer: the function that answers; of a module, since the process imports it.
        quiet: keep its standard error off the terminal; the last line of it is part of the message
            when the process dies.
    """

    def __init__(self, answer: Callable[..., Any], quiet: bool = False) -> None:
        self._answer = f"{answer.__module__}:{answer.__name__}"
        self._quiet = quiet
        self._process: subprocess.Popen[bytes] | None = None
        self._said = None
        self._stopped = False

    @property
    def pid(self) -> int | None:
        """The number of the process, where there is one."""
        return self._process.pid if self._process else None

    def ask(self, *arguments: Any, limit: float | None = None) -> Any:
        """The answer to arguments; after ``limit`` seconds the process is killed.

        Raises:
            ProcessDied: it ended instead, such as for want of memory.
            ProcessLate: it was killed at the limit.
            ProcessNotStarted: it could not be started.
            NotSent: the arguments cannot be pickled here, or not be loaded there.
            CancelledError: `stop` was called meanwhile.
        """
        try:
            sent = pickle.dumps(arguments)
        except Exception as error:  # pickle raises errors of several kinds
            raise NotSent(str(error)) from None
        process = self.start()
        assert process.stdin is not None
        # Writing to a process that has died fails; `_reply` then finds its pipe closed as well, and
        # reports how it ended.
        with suppress(OSError):
            pickle.dump(sent, process.stdin)
            process.stdin.flush()
        answer, refused = self._reply(process, limit)
        if refused:
            raise NotSent(refused)
        return answer

    def stop(self) -> None:
        """Kill the process from another thread, and start no other; `close` cleans up."""
        self._stopped = True
        if process := self._process:
            process.kill()

    def start(self) -> subprocess.Popen[bytes]:
        """The process, that has said that it is ready."""
        if self._stopped:
            raise CancelledError
        if self._process is not None and self._process.poll() is None:
            return self._process
        self.close()
        if self._quiet:
            self._said = tempfile.TemporaryFile()  # noqa: SIM115  (closed with the process)
        process = self._process = subprocess.Popen(
            # -P: the working directory is not put before the library: a user's `queue.py` or
            # `json.py` there would be imported in place of the standard module.
            [sys.executable, "-P", "-m", "diffthrust._support._running.server", self._answer],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._said,
            env=_environment(),
            start_new_session=True,  # Ctrl-C reaches the owner only, which ends its processes
        )
        if self._stopped:  # `stop` ran in another thread before `_process` was set
            process.kill()
        try:
            self._reply(process, _START_LIMIT)
        except ProcessDied as error:
            raise ProcessNotStarted(*error.args) from None
        return process

    def _reply(self, process: subprocess.Popen[bytes], limit: float | None) -> Any:
        """The next reply of the process."""
        assert process.stdout is not None
        late = threading.Event()

        def expire() -> None:
            late.set()
            process.kill()

        # A read of a pipe has no timeout on Windows; killing the process ends the wait on every
        # system.
        timer = threading.Timer(limit, expire) if limit is not None else None
        if timer:
            timer.start()
        reply = None
        try:
            with suppress(EOFError, pickle.UnpicklingError):  # closed, in the midst of a reply too
                reply = pickle.load(process.stdout)
        finally:
            if timer:
                timer.cancel()
        if reply is not None:
            return pickle.loads(reply)
        how = self.close(_DEATH_LIMIT)
        if self._stopped:
            raise CancelledError
        raise ProcessLate(how) if late.is_set() else ProcessDied(how)

    def close(self, patience: float = 0.0) -> str:
        """End the process, from the thread that uses it or when that has ended; say how it ended.

        It is killed if it still runs after ``patience`` seconds.
        """
        process, errors = self._process, self._said
        self._process = self._said = None
        if process is None:
            return ""
        with suppress(subprocess.TimeoutExpired):
            process.wait(patience)
        process.kill()
        code = process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe:
                with suppress(OSError):  # closing flushes, and nobody reads any more
                    pipe.close()
        names = {each.value: each.name for each in signal.Signals}
        how = [f"exit status {code}" if code >= 0 else f"signal {names.get(-code, -code)}"]
        if errors is not None:
            with errors:
                errors.seek(0)
                how += errors.read().decode(errors="replace").strip().splitlines()[-1:]
        return ", ".join(how)

    __del__ = close


def _environment() -> dict[str, str]:
    """That of this process, with its modules and its compilation cache, and with one thread."""
    import jax

    cache = jax.config.values["jax_compilation_cache_dir"]
    flags = f"--xla_cpu_multi_thread_eigen=false {os.environ.get('XLA_FLAGS', '')}"
    return {
        **os.environ,
        **_ONE_THREAD,
        **({"DIFFTHRUST_CACHE": cache} if cache else {}),
        "XLA_FLAGS": flags.strip(),
        "PYTHONPATH": os.pathsep.join(folder or os.getcwd() for folder in sys.path),
    }
