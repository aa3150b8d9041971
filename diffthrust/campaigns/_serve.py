"""The program of a `Helper`: jobs come in as lines of JSON, and rows go out as such."""

from __future__ import annotations

import json
import os
import queue
import sys
import threading

IDLE = 120.0
"""Seconds without a job after which the process gives its memory back."""


def main() -> None:
    """Work until the pipe is closed, which it is as well when the owner is killed."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what a model of the user's prints is no answer

    jobs: queue.Queue[str] = queue.Queue()

    def listen() -> None:
        for line in sys.stdin:
            jobs.put(line)
        os._exit(0)

    threading.Thread(target=listen, daemon=True).start()

    from diffthrust._cache import enable_compilation_cache
    from diffthrust.campaigns._job import Job
    from diffthrust.campaigns._task import run

    enable_compilation_cache()
    print("ready", file=answers, flush=True)
    while True:
        try:
            line = jobs.get(timeout=IDLE)
        except queue.Empty:
            os._exit(0)
        print(json.dumps(run(Job(**json.loads(line)))), file=answers, flush=True)


if __name__ == "__main__":
    main()
