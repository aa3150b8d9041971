"""The program of a `Worker`: arguments come in and answers go out, pickled."""

from __future__ import annotations

import importlib
import os
import pickle
import queue
import sys
import threading
from contextlib import suppress
from typing import Any

_IDLE = 120.0
"""Seconds without a call after which the process gives its memory back."""


def serve(name: str) -> None:
    """Answer by ``module:function`` until the pipe is closed, as when the owner is killed.

    An answer before all others says that it is ready. What a function or a user's script prints
    goes to standard error, so that answers stay answers.
    """
    # File descriptors, not sys.stdout: C++ code of XLA prints to descriptor 1 directly.
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    # not held back: the last words of a process that dies were what it had printed before them
    sys.stdout = sys.stderr
    # A script that asks for input finds none, rather than the bytes of the next call.
    calls = os.fdopen(os.dup(0), "rb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    waiting: queue.Queue[bytes] = queue.Queue()

    def listen() -> None:
        with suppress(EOFError, pickle.UnpicklingError):
            while True:
                waiting.put(pickle.load(calls))
        os._exit(0)  # the owner is gone: a fit that runs in the main thread is not waited for

    def reply(answer: Any = None, refused: str = "") -> None:
        pickle.dump(pickle.dumps((answer, refused)), answers)
        answers.flush()

    threading.Thread(target=listen, daemon=True).start()

    from diffthrust._support._running.cache import enable_compilation_cache

    enable_compilation_cache()
    module, _, function = name.partition(":")
    call = getattr(importlib.import_module(module), function)
    reply()
    while True:
        try:
            sent = waiting.get(timeout=_IDLE)
        except queue.Empty:
            os._exit(0)
        try:
            arguments = pickle.loads(sent)
        except Exception as error:  # such as a class of the owner's script
            reply(refused=str(error))
            continue
        reply(call(*arguments))


if __name__ == "__main__":
    serve(sys.argv[1])
