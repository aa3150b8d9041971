"""Ctrl-C that ends a command soon, whatever it is at."""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_PATIENCE = 1.5
"""Seconds in which a command may end by itself; what it saves then is saved."""
_STOPPED = 130


@contextmanager
def ended_soon() -> Iterator[None]:
    """Within it, an interrupt ends the process after a moment, also in the midst of compiled code.

    Python hears of a signal only when compiled code returns, which a compilation of XLA or a long
    run does after many seconds. A thread hears of it at once, waits, and ends the process. Files
    are whole all the same, for each is written beside its place and then renamed.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    heard, tells = socket.socketpair()
    tells.setblocking(False)
    before = signal.set_wakeup_fd(tells.fileno(), warn_on_full_buffer=False)
    threading.Thread(target=_wait, args=(heard,), daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        tells.close()  # which ends the thread


def _wait(heard: socket.socket) -> None:
    with heard:
        while told := heard.recv(1):
            if told[0] == signal.SIGINT:
                heard.settimeout(_PATIENCE)
                with suppress(TimeoutError):
                    while heard.recv(1):
                        pass
                    return  # the command has ended by itself
                with suppress(OSError):
                    sys.stderr.write("\nStopped.\n")
                    sys.stderr.flush()
                os._exit(_STOPPED)
