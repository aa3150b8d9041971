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
_interrupted = _reported = False


@contextmanager
def ended_soon() -> Iterator[None]:
    """Context in which an interrupt soon ends the process, even inside compiled code.

    Python handles a signal only when compiled code returns; a compilation by XLA or a long
    simulation takes many seconds. A thread is notified at once, waits, and ends the process. Files
    stay complete, for each is written under a temporary name and then renamed. After the context an
    interrupt ends the process at once, since all work is done.
    """
    # `entry` and `main` both open the context; a second wake-up descriptor would replace the first.
    if signal.getsignal(signal.SIGINT) is not _on_signal:
        _listen()
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        if _interrupted:
            # Skip the interpreter's shutdown, which can hang or crash while XLA is compiling.
            report_stopped()
            os._exit(STOPPED)


def interrupted() -> bool:
    """Whether an interrupt came; later failures may be due to it."""
    return _interrupted


def report_stopped(how_far: str = "") -> None:
    """Report once that the command was stopped."""
    global _reported
    if not _reported:
        _reported = True
        with suppress(OSError, ValueError):  # standard error may be closed
            sys.stderr.write(f"\nStopped. {how_far}".rstrip() + "\n")
            sys.stderr.flush()


def _listen() -> None:
    receiver, sender = socket.socketpair()
    # set_wakeup_fd demands a descriptor that never blocks: a signal handler writes to it.
    sender.setblocking(False)
    signal.signal(signal.SIGINT, _on_signal)
    signal.set_wakeup_fd(sender.detach(), warn_on_full_buffer=False)
    threading.Thread(target=_wait, args=(receiver,), daemon=True).start()
    sys.unraisablehook = _unraisable


def _on_signal(*_: Any) -> None:
    global _interrupted
    _interrupted = True
    raise KeyboardInterrupt


def _wait(receiver: socket.socket) -> None:
    while number := receiver.recv(1):
        if number[0] == signal.SIGINT:
            time.sleep(_PATIENCE)
            report_stopped()
            os._exit(STOPPED)


def _unraisable(unraisable: Any) -> None:
    """Ignore KeyboardInterrupt in a callback, which cannot propagate; the thread acts on it."""
    if not (_interrupted and issubclass(unraisable.exc_type, KeyboardInterrupt)):
        sys.__unraisablehook__(unraisable)
