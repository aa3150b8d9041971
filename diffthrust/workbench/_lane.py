"""A thread that works for a page: of what waits only the newest is done, and it can be stopped."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from diffthrust._support.progress import Progress

_PAUSE = 0.2
"""Display: seconds between two messages of progress; a diagnosis has hundreds."""
Work = Callable[[Progress], Any]
Answer = Callable[[Any], None]


class Stopped(Exception):
    """Raised inside work that was stopped, where it reports its progress."""


class Lane:
    """One thread and one place to wait.

    A slider asks faster than a simulation answers: what waits gives way to what is newer, so that
    the page follows the mouse and never runs behind it. ``deliver`` calls a function in the thread
    of the page, where progress and answers are told.
    """

    def __init__(
        self, deliver: Callable[[Callable[[], None]], Any], progress: Progress | None = None
    ) -> None:
        self._deliver, self._progress = deliver, progress
        self._changed = threading.Condition()
        self._waiting: tuple[Work, Answer, Answer] | None = None
        self._working = self._stopping = self._closed = False
        self._told = 0.0
        threading.Thread(target=self._run, daemon=True).start()

    @property
    def busy(self) -> bool:
        """Whether something is being done, or waits."""
        with self._changed:
            return self._working or self._waiting is not None

    def ask(self, work: Work, then: Answer, failed: Answer, *, stop: bool = False) -> None:
        """Have something done: in the page's thread ``then`` gets the result, ``failed`` the error.

        With ``stop`` what is being done ends where it next reports its progress.
        """
        with self._changed:
            self._waiting = work, then, failed
            self._stopping = self._stopping or (stop and self._working)
            self._changed.notify()

    def stop(self) -> None:
        """Stop what is being done, and forget what waits."""
        with self._changed:
            self._waiting, self._stopping = None, self._working

    def close(self) -> None:
        """End the thread as soon as its work lets it."""
        self.stop()
        with self._changed:
            self._closed = True
            self._changed.notify()

    def _report(self, message: str, share: float) -> None:
        if self._stopping:
            raise Stopped
        if self._progress is not None and time.monotonic() - self._told > _PAUSE:
            self._told = time.monotonic()
            self._deliver(partial(self._progress, message, share))

    def _run(self) -> None:
        while True:
            with self._changed:
                self._working = self._stopping = False
                self._changed.wait_for(lambda: self._waiting is not None or self._closed)
                if self._waiting is None:
                    return
                request, self._waiting, self._working = self._waiting, None, True
            self._do(*request)

    def _do(self, work: Work, then: Answer, failed: Answer) -> None:
        try:
            answer = partial(then, work(self._report))
        except Exception as error:  # whatever it is, the page says so and goes on
            answer = partial(failed, error)
        self._deliver(answer)
