"""Many tasks on several processes, and on any executor: one after the other as they are done."""

from __future__ import annotations

import os
import queue
import threading
from collections import deque
from collections.abc import Callable, Generator, Hashable, Iterable, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial
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
    try:
        for i, task in enumerate(tasks):
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

    A thread stays with tasks of equal ``key``, which share compiled code. Leaving the pool ends its
    workers, in the midst of a task if need be.
    """

    def __init__(
        self, workers: Sequence[Worker], key: Callable[..., Hashable] = lambda *_: None
    ) -> None:
        super().__init__(len(workers), initializer=self._begin)
        self._workers, self._key, self._unused = workers, key, deque(workers)
        self._choosing = threading.Lock()
        self._begun: set[Hashable] = set()
        self._left: dict[Hashable, deque[tuple[Future[Any], Callable[[], Any]]]] = {}

    def _begin(self) -> None:
        _own.worker, _own.key = self._unused.popleft(), None
        # A task is taken when the worker is ready: by then most are submitted, and the largest
        # group is known. One that does not start is asked all the same, and says why.
        with suppress(Exception):
            _own.worker.start()

    def submit(self, call: Callable[..., Any], /, *arguments: Any, **options: Any) -> Future[Any]:
        """Call a function in one of the threads."""
        future, key = Future[Any](), self._key(*arguments)
        with self._choosing:
            task = future, partial(call, *arguments, **options)
            self._left.setdefault(key, deque()).append(task)
        super().submit(self._do_next)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = True) -> None:
        """Cancel what has not begun, and end the workers."""
        with self._choosing:
            for future, _ in (task for tasks in self._left.values() for task in tasks):
                future.cancel()
        # Stop before join: a thread that waits for its worker ends only when that is killed.
        for worker in self._workers:
            worker.stop()
        super().shutdown(cancel_futures=True)
        for worker in self._workers:
            worker.close()

    def _do_next(self) -> None:
        """A task of the last group, or of the largest that is left, untouched ones first."""
        with self._choosing:
            if _own.key not in self._left:
                sizes = {k: (k not in self._begun, len(tasks)) for k, tasks in self._left.items()}
                _own.key = max(sizes, key=sizes.__getitem__)
            tasks = self._left[_own.key]
            self._begun.add(_own.key)
            future, task = tasks.popleft()
            if not tasks:
                del self._left[_own.key]
        if future.set_running_or_notify_cancel():
            try:
                future.set_result(task())
            except BaseException as error:  # raised where the result is asked for
                future.set_exception(error)
