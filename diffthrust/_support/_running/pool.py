"""Many tasks on several processes, and on any executor: one after the other as they are done."""

from __future__ import annotations

import os
import queue
import threading
from collections import deque
from collections.abc import Callable, Generator, Hashable, Iterable, Sequence
from concurrent.futures import Executor, Future
from contextlib import suppress
from functools import partial
from typing import Any

from diffthrust._support._running.process import Worker

_TICK = 1.0
"""Seconds after which the caller regains control although no result has come."""
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
) -> Generator[tuple[int, Future[Any]] | None]:
    """Give tasks to an executor; yields the place of each and its future, as they are done.

    ``None`` when none was for a second. Those that have not begun are cancelled when the iteration
    is left.
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
                yield None
                continue
            yield places.pop(future), future
    finally:
        for future in places:
            future.cancel()


class WorkerPool(Executor):
    """A thread for each of several workers, its `own_worker`.

    A thread stays with tasks that share compiled code. Leaving the pool ends its workers, in the
    midst of a task if need be.

    Args:
        workers: as many tasks are done at a time.
        key: of the arguments of a task; equal where tasks share compiled code.
    """

    def __init__(
        self, workers: Sequence[Worker], key: Callable[..., Hashable] = lambda *_: None
    ) -> None:
        self._workers, self._key = workers, key
        self._changed = threading.Condition()
        self._closed = False
        self._begun: set[Hashable] = set()
        self._left: dict[Hashable, deque[tuple[Future[Any], Callable[[], Any]]]] = {}
        use = [threading.Thread(target=self._use, args=(w,), daemon=True) for w in workers]
        self._threads = use
        for thread in use:
            thread.start()

    def submit(self, call: Callable[..., Any], /, *arguments: Any, **options: Any) -> Future[Any]:
        """Call a function in one of the threads."""
        future, key = Future[Any](), self._key(*arguments)
        with self._changed:
            if self._closed:
                raise RuntimeError("The pool of workers is closed.")
            task = future, partial(call, *arguments, **options)
            self._left.setdefault(key, deque()).append(task)
            self._changed.notify()
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = True) -> None:
        """Cancel what has not begun, and end the workers."""
        with self._changed:
            self._closed = True
            for future, _ in (task for tasks in self._left.values() for task in tasks):
                future.cancel()
            self._left.clear()
            self._changed.notify_all()
        # Stop before join: a thread that waits for its worker ends only when that is killed.
        for worker in self._workers:
            worker.stop()
        for thread in self._threads:
            thread.join()

    def _use(self, worker: Worker) -> None:
        _own.worker, key = worker, None
        # A task is taken when the worker is ready: by then most are submitted, and the largest
        # group is known. One that does not start is asked all the same, and says why.
        with suppress(Exception):
            worker.start()
        while taken := self._next(key):
            key, (future, task) = taken
            if future.set_running_or_notify_cancel():
                try:
                    future.set_result(task())
                except BaseException as error:  # raised where the result is asked for
                    future.set_exception(error)
        worker.close()

    def _next(
        self, last: Hashable
    ) -> tuple[Hashable, tuple[Future[Any], Callable[[], Any]]] | None:
        """A task of the last group, or of the largest that is left, untouched ones first."""
        with self._changed:
            self._changed.wait_for(lambda: self._left or self._closed)
            if not self._left:
                return None
            key = last
            if key not in self._left:
                key = max(self._left, key=lambda k: (k not in self._begun, len(self._left[k])))
            self._begun.add(key)
            task = self._left[key].popleft()
            if not self._left[key]:
                del self._left[key]
            return key, task
