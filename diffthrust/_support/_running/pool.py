"""Many tasks on several processes, and on any executor: one after the other as they are done."""

from __future__ import annotations

import os
import queue
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any

from diffthrust._support._running.process import Worker

_TICK = 1.0
"""Seconds of one wait for a result: on Windows an interrupt is only seen between two."""
_own = threading.local()


def processors() -> int:
    """Processors that this process may use: fewer than all, in a container."""
    usable = getattr(os, "sched_getaffinity", None)
    return len(usable(0)) if usable else os.cpu_count() or 1


def own_worker(answer: Callable[..., Any] | None = None) -> Worker:
    """The worker of this thread; where it has none, one that answers, and ends with the thread."""
    if not hasattr(_own, "worker"):
        assert answer is not None
        _own.worker = Worker(answer, quiet=True)
    return _own.worker


def as_done(
    executor: Executor, call: Callable[[Any], Any], tasks: Iterable[Any]
) -> Generator[tuple[int, Future[Any]]]:
    """Give tasks to an executor; yields the place of each and its future, as they are done.

    Those that have not begun are cancelled when the iteration is left.
    """
    done: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
    places: dict[Future[Any], int] = {}
    numbered = list(enumerate(tasks))
    if isinstance(executor, WorkerPool):
        # Each worker takes a stretch of its own: neighbours often share compiled code, and two that
        # begin side by side would both compile it. 24 new fits of 6 kinds, kind after kind, took
        # two workers 15 s in their order.
        stretch = -(-len(numbered) // executor.workers) or 1
        numbered.sort(key=lambda pair: pair[0] % stretch)
    try:
        for i, task in numbered:
            try:
                future = executor.submit(call, task)
            except Exception as error:  # the executor is broken or closed
                future = Future()
                future.set_exception(error)
            if future.done():  # executors that work synchronously
                yield i, future
            else:
                places[future] = i
                future.add_done_callback(done.put)
        while places:
            try:
                future = done.get(timeout=_TICK)
            except queue.Empty:
                continue
            yield places.pop(future), future
    finally:
        for future in places:
            future.cancel()


class WorkerPool(ThreadPoolExecutor):
    """A thread for each of several workers, its `own_worker`.

    Leaving the pool ends its workers, in the midst of a task if need be.
    """

    def __init__(self, workers: Sequence[Worker]) -> None:
        super().__init__(len(workers), initializer=self._begin)
        self._workers, self._unused = workers, deque(workers)

    @property
    def workers(self) -> int:
        """How many there are."""
        return len(self._workers)

    def _begin(self) -> None:
        _own.worker = self._unused.popleft()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = True) -> None:
        """Cancel what has not begun, and end the workers."""
        # Stop before join: a thread that waits for its worker ends only when that is killed.
        for worker in self._workers:
            worker.stop()
        super().shutdown(cancel_futures=True)
        for worker in self._workers:
            worker.close()
