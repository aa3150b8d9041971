"""End a command soon on Ctrl-C, whatever it is doing, without a traceback."""

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
"""The shell's exit status of an interrupted command."""
_PATIENCE = 0.8
"""Seconds in which a command may end by itself, to finish saving."""
_heard = _said = False


@contextmanager
def ended_soon() -> Iterator[None]:
    """Context in which an interrupt soon ends the process, even inside compiled code.

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
        if (
            _heard
        ):  # skip the interpreter's shutdown, which can hang or crash while XLA is compiling
            say_stopped()
            os._exit(STOPPED)


def interrupted() -> bool:
    """Whether an interrupt came; later failures may be due to it."""
    return _heard


def say_stopped(how_far: str = "") -> None:
    """Report once that the command was stopped."""
    global _said
    if not _said:
        _said = True
        with suppress(OSError, ValueError):  # standard error may be closed
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
    while reported := heard.recv(1):
        if reported[0] == signal.SIGINT:
            time.sleep(_PATIENCE)
            say_stopped()
            os._exit(STOPPED)


def _unraisable(unraisable: Any) -> None:
    """Ignore KeyboardInterrupt in a callback, which cannot propagate; the thread acts on it."""
    if not (_heard and issubclass(unraisable.exc_type, KeyboardInterrupt)):
        sys.__unraisablehook__(unraisable)
