"""The program of a `LineProcess`: questions come in and answers go out as lines of JSON."""

from __future__ import annotations

import importlib
import json
import os
import queue
import sys
import threading

_IDLE = 120.0
"""Seconds without a question after which the process gives its memory back."""


def serve(name: str) -> None:
    """Answer until the pipe is closed, which it is as well when the owner is killed.

    A line before all answers says that it is ready. What a function or a user's script prints goes
    to standard error, so that answers stay answers.

    Args:
        name: of the function that answers, as ``module:function``.
    """
    # File descriptors, not sys.stdout: C++ code of XLA prints to descriptor 1 directly.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    questions: queue.Queue[str] = queue.Queue()

    def listen() -> None:
        for line in sys.stdin:
            questions.put(line)
        os._exit(0)  # the owner is gone: a fit that runs in the main thread is not waited for

    threading.Thread(target=listen, daemon=True).start()

    from diffthrust._support._running.cache import enable_compilation_cache

    enable_compilation_cache()
    module, _, function = name.partition(":")
    answer = getattr(importlib.import_module(module), function)
    print("ready", file=answers, flush=True)
    while True:
        try:
            question = questions.get(timeout=_IDLE)
        except queue.Empty:
            os._exit(0)
        print(json.dumps(answer(json.loads(question))), file=answers, flush=True)


if __name__ == "__main__":
    serve(sys.argv[1])
