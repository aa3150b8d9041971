"""Many tasks on several processes; each process stays with tasks that share compiled code."""

from __future__ import annotations

import os
import queue
import threading
from collections import deque
from collections.abc import Callable, Generator, Hashable, Sequence
from typing import TypeVar

from diffthrust._support._running.process import LineProcess

_TICK = 1.0
"""Seconds after which the caller regains control although no result has come."""
T = TypeVar("T")
R = TypeVar("R")


def processors() -> int:
    """Processors that this process may use: fewer than all, in a container."""
    usable = getattr(os, "sched_getaffinity", None)
    return len(usable(0)) if usable else os.cpu_count() or 1


def on_processes(
    tasks: Sequence[T],
    keys: Sequence[Hashable],
    processes: Sequence[LineProcess],
    work: Callable[[LineProcess, T], R],
) -> Generator[tuple[int, R] | None]:
    """Work through tasks, with one thread of this process for each worker process.

    Processes are ended when the iteration is left, in the midst of a task if need be.

    Args:
        tasks: what to do.
        keys: one for each task, equal where tasks share compiled code.
        processes: as many tasks are done at a time.
        work: does a task with a process.

    Yields:
        The place of a task and what ``work`` gave, as they come; ``None`` when none has come for a
        second.

    Raises:
        BaseException: what ``work`` raised.
    """
    groups = Groups(keys)
    outcomes: queue.SimpleQueue[tuple[int, R] | BaseException] = queue.SimpleQueue()

    def use(process: LineProcess) -> None:
        key = None
        try:
            while (taken := groups.next(key)) is not None:
                key, i = taken
                outcomes.put((i, work(process, tasks[i])))
        except BaseException as error:  # raised in the caller's thread, which waits for outcomes
            outcomes.put(error)
        finally:
            process.close()

    threads = [threading.Thread(target=use, args=(p,), daemon=True) for p in processes]
    remaining = len(tasks)
    try:
        for thread in threads:
            thread.start()
        while remaining:
            try:
                outcome = outcomes.get(timeout=_TICK)
            except queue.Empty:
                yield None
                continue
            if isinstance(outcome, BaseException):
                raise outcome
            remaining -= 1
            yield outcome
    finally:
        groups.clear()
        # Stop before join: a thread that waits for its process ends only when the process is
        # killed.
        for process in processes:
            process.stop()
        for thread in threads:
            if thread.ident is not None:  # joining a thread that was never started raises
                thread.join()


class Groups:
    """Tasks that are left, in groups that share compiled code; who takes one stays with its group.

    Args:
        keys: one for each task, equal within a group.
    """

    def __init__(self, keys: Sequence[Hashable]) -> None:
        self._lock = threading.Lock()
        self._begun: set[Hashable] = set()
        self._left: dict[Hashable, deque[int]] = {}
        for i, key in enumerate(keys):
            self._left.setdefault(key, deque()).append(i)

    def next(self, last: Hashable | None) -> tuple[Hashable, int] | None:
        """The next task of the group, or of the largest group that is left, untouched ones first.

        Args:
            last: the key of the group.

        Returns:
            The key of its group and its place; ``None`` where nothing is left.
        """
        with self._lock:
            if not self._left:
                return None
            key = last if last in self._left else max(self._left, key=self._rank)
            self._begun.add(key)
            i = self._left[key].popleft()
            if not self._left[key]:
                del self._left[key]
            return key, i

    def clear(self) -> None:
        """Let no further task begin."""
        with self._lock:
            self._left.clear()

    def _rank(self, key: Hashable) -> tuple[bool, int]:
        return key not in self._begun, len(self._left[key])
