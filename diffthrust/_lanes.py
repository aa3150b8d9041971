"""Compiled programs of several threads, run side by side.

A program that is asked for by many threads at once, with numbers of equal shapes, is run for some
of them together: their numbers are stacked, and every thread gets its own row of the result. On a
processor a few rows fill its vector units, and more only leave its cache; an accelerator takes
hundreds. Whatever a thread does in between (its checks, its next start) goes on by itself, so that
nobody waits for the slowest, and what fails in one thread is lost to that one alone.

Outside `Lanes` a program is run at once, as it is.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import jax
import numpy as np

PATIENCE = 0.2
"""For how long [s] rows wait for others while threads are busy with something else."""

_present: ContextVar[Lanes | None] = ContextVar("lanes", default=None)


def lanes() -> Lanes | None:
    """The lanes that this thread's programs run in, if any."""
    return _present.get()


def padded_length(samples: int) -> int:
    """How long a log of so many samples is made, so that logs of other lengths share programs."""
    present = lanes()
    return samples if present is None else present.length(samples)


def still_wanted(*_: Any) -> None:
    """Raise where this thread's lanes are closed: long work asks, as its `Progress`."""
    present = lanes()
    if present is not None and present.closed:
        raise _given_up()


@partial(jax.jit, static_argnums=(0, 1))
def _side_by_side(program: Callable[..., Any], static: Hashable, rows: Any) -> Any:
    return jax.vmap(partial(program, static))(rows)


@dataclass(eq=False)
class _Asked:
    """What one thread waits for."""

    leaves: list[np.ndarray]
    tree: Any
    ready: threading.Event = field(default_factory=threading.Event)
    found: Any = None
    error: BaseException | None = None


class Lanes:
    """Runs the programs of the threads that `do` their work in it.

    Args:
        width: rows of one run.
        workers: runs at a time.
        lengths: to which series may be padded, ascending.
        devices: over which the rows of a run are divided; where JAX puts them if none are given.
    """

    def __init__(
        self,
        width: int,
        workers: int,
        lengths: Sequence[int] = (),
        devices: Sequence[Any] = (),
    ) -> None:
        self.width, self.lengths = width, np.asarray(lengths, int)
        self._waiting: dict[Hashable, list[_Asked]] = {}
        self._thinking = 0
        self.closed = False
        self._changed = threading.Condition()
        self._sharding = _by_rows(devices) if len(devices) else None
        self._workers = [threading.Thread(target=self._work, daemon=True) for _ in range(workers)]
        for worker in self._workers:
            worker.start()

    def length(self, samples: int) -> int:
        """The least of the lengths that so many samples fit in."""
        at = int(np.searchsorted(self.lengths, samples))
        return int(self.lengths[at]) if at < self.lengths.size else samples

    def close(self) -> None:
        """End the workers; what still waits is given up, with an error in its thread."""
        with self._changed:
            self.closed = True
            given_up = [asked for group in self._waiting.values() for asked in group]
            self._waiting.clear()
            self._changed.notify_all()
        for asked in given_up:
            asked.error = _given_up()
        self._return(given_up)

    def do(self, work: Callable[[], Any]) -> Any:
        """Do some work in this thread, whose programs run side by side with those of others."""
        token = _present.set(self)
        self._think(1)
        try:
            return work()
        finally:
            self._think(-1)
            _present.reset(token)

    def ask(self, program: Callable[..., Any], static: Hashable, numbers: Any) -> Any:
        """``program(static, numbers)`` for this thread; blocks until it has been run."""
        leaves, tree = jax.tree.flatten(numbers)
        leaves = [np.asarray(leaf) for leaf in leaves]
        kind = (program, static, tree, tuple((leaf.shape, leaf.dtype) for leaf in leaves))
        asked = _Asked(leaves, tree)
        with self._changed:
            if self.closed:
                raise _given_up()
            self._waiting.setdefault(kind, []).append(asked)
            self._thinking -= 1
            self._changed.notify_all()
        asked.ready.wait()
        if asked.error is not None:
            raise asked.error
        return asked.found

    def _think(self, more: int) -> None:
        with self._changed:
            self._thinking += more
            self._changed.notify_all()

    def _return(self, group: list[_Asked]) -> None:
        """Let the threads that asked go on."""
        self._think(len(group))
        for asked in group:
            asked.ready.set()

    def _next(self, anyhow: bool = False) -> tuple[Hashable, list[_Asked]] | None:
        """A full run, or the fullest there is once every thread waits (or ``anyhow``)."""
        if not self._waiting:
            return None
        kind = max(self._waiting, key=lambda k: len(self._waiting[k]))
        group = self._waiting[kind]
        if len(group) < self.width and self._thinking > 0 and not anyhow:
            return None
        taken, left = group[: self.width], group[self.width :]
        if left:
            self._waiting[kind] = left
        else:
            del self._waiting[kind]
        return kind, taken

    def _work(self) -> None:
        while True:
            with self._changed:
                job = self._next()
                while job is None and not self.closed:
                    told = self._changed.wait(PATIENCE if self._waiting else None)
                    job = self._next(anyhow=not told)
            if job is None:
                return
            kind, group = job
            try:
                self._run(kind, group)
            except BaseException as error:  # told by the threads that asked, each by its own
                for asked in group:
                    asked.error = error
            self._return(group)

    def _run(self, kind: Any, group: list[_Asked]) -> None:
        program, static, tree, _ = kind
        spare = [group[0]] * (self.width - len(group))  # one shape, one compilation
        columns = zip(*(asked.leaves for asked in [*group, *spare]), strict=True)
        rows = jax.tree.unflatten(tree, [np.stack(column) for column in columns])
        if self._sharding is not None:
            rows = jax.device_put(rows, self._sharding)
        found = jax.tree.map(np.asarray, _side_by_side(program, static, rows))
        for i, asked in enumerate(group):
            asked.found = jax.tree.map(lambda leaf, i=i: leaf[i], found)


def _given_up() -> RuntimeError:
    return RuntimeError("These lanes are closed.")


def _by_rows(devices: Sequence[Any]) -> Any:
    mesh = jax.sharding.Mesh(np.array(devices), ("rows",))
    return jax.sharding.NamedSharding(mesh, jax.sharding.PartitionSpec("rows"))
