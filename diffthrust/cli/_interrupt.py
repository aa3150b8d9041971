"""Ctrl-C that ends a command soon, whatever it is at, and without a traceback."""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

STOPPED = 130
"""The exit status of a command that was interrupted, as shells have it."""
_PATIENCE = 0.8
"""Seconds in which a command may end by itself; what it saves then is saved."""
_heard = _said = False


@contextmanager
def ended_soon() -> Iterator[None]:
    """Within it an interrupt ends the process after a moment, also in the midst of compiled code.

    Python hears of a signal only when compiled code returns, which a compilation of XLA or a long
    run does after many seconds. A thread hears of it at once, waits, and ends the process. Files
    are whole all the same, for each is written beside its place and then renamed. Thereafter an
    interrupt ends the process at once: what had to be done is done.
    """
    if signal.getsignal(signal.SIGINT) is not _hear:
        _listen()
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        if _heard:  # without the interpreter's own end, which XLA at work can make long, or crash
            say_stopped()
            os._exit(STOPPED)


def interrupted() -> bool:
    """Whether an interrupt came; what fails thereafter may have failed for it."""
    return _heard


def say_stopped(how_far: str = "") -> None:
    """Say once that the command was stopped."""
    global _said
    if not _said:
        _said = True
        with suppress(OSError, ValueError):  # of a standard error that is closed
            sys.stderr.write(f"\nStopped. {how_far}".rstrip() + "\n")
            sys.stderr.flush()


def _listen() -> None:
    heard, tells = socket.socketpair()
    tells.setblocking(False)
    signal.signal(signal.SIGINT, _hear)
    signal.set_wakeup_fd(tells.detach(), warn_on_full_buffer=False)
    threading.Thread(target=_wait, args=(heard,), daemon=True).start()
    sys.unraisablehook = _unraisable


def _hear(*_: Any) -> None:
    global _heard
    _heard = True
    raise KeyboardInterrupt


def _wait(heard: socket.socket) -> None:
    while told := heard.recv(1):
        if told[0] == signal.SIGINT:
            time.sleep(_PATIENCE)
            say_stopped()
            os._exit(STOPPED)


def _unraisable(unraisable: Any) -> None:
    """Nothing of an interrupt that met a callback, which cannot hand it on; the thread has it."""
    if not (_heard and issubclass(unraisable.exc_type, KeyboardInterrupt)):
        sys.__unraisablehook__(unraisable)
