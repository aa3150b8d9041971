"""Compiled programs of several members, run side by side.

A program that is asked for by several members at once, with numbers of equal shapes, is run for
some of them together: their numbers are stacked, and every member gets its own row of the result.
On a processor a few rows fill its vector units, and more only leave its cache; an accelerator takes
hundreds. Whatever a member does in between (its checks, its next start) goes on by itself, so that
nobody waits for the slowest, and what fails in one is lost to that one alone.

Members take turns in one thread, as greenlets: each goes on until it asks for a program. Threads
would pass Python's lock to and fro at every operation of NumPy, which takes longer than the work.
Programs run in a few threads beside it, while other members have their turn.

Outside `Lanes` a program is run at once, as it is.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Hashable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from greenlet import GreenletExit, getcurrent, greenlet

from diffthrust._support.warned import silence

_present: ContextVar[Lanes | None] = ContextVar("lanes", default=None)
_ladder: ContextVar[Sequence[int]] = ContextVar("ladder", default=())


def lanes() -> Lanes | None:
    """The lanes that this member's programs run in, if any."""
    return _present.get()


@contextmanager
def padded_to(lengths: Sequence[int]) -> Iterator[None]:
    """Within it, series are padded to these lengths, ascending, so that they share programs."""
    token = _ladder.set(lengths)
    try:
        yield
    finally:
        _ladder.reset(token)


def padded_length(samples: int) -> int:
    """How long a log of so many samples is made: the least length that it fits in."""
    lengths = _ladder.get()
    at = int(np.searchsorted(lengths, samples))
    return int(lengths[at]) if at < len(lengths) else samples


def run(program: Callable[..., Any], static: Hashable, numbers: Any, rows: int = 1) -> Any:
    """``program(static, numbers)``, compiled; beside those of other members where there are any.

    Args:
        program: compiled by ``jax.jit``, with ``static`` fixing the code.
        static: hashable.
        numbers: a pytree of arrays.
        rows: that the program works on side by side by itself already.
    """
    present = lanes()
    if present is None:
        return program(static, numbers)
    return present.ask(program, static, numbers, rows)


@partial(jax.jit, static_argnums=(0, 1))
def _side_by_side(program: Callable[..., Any], static: Hashable, rows: Any) -> Any:
    return jax.vmap(partial(program, static))(rows)


class _Kind(NamedTuple):
    """What is equal among programs that are run together, and how many are."""

    program: Callable[..., Any]
    static: Hashable
    tree: Any
    shapes: tuple[Any, ...]
    width: int


@dataclass(eq=False)
class _Asked:
    """What one member waits for."""

    member: greenlet
    leaves: list[np.ndarray]
    found: Any = None
    error: BaseException | None = None


class Lanes:
    """Runs the programs of the members whose work it drives.

    Args:
        width: rows of one run on each device.
        devices: over which the rows of a run are divided; where JAX puts them if none are given.
        members: how many there will be, where runs need not be wider.
        runs: at a time.
    """

    def __init__(
        self, width: int, devices: Sequence[Any] = (), members: int | None = None, runs: int = 2
    ) -> None:
        self._width, self._devices, self._runs = width, max(1, len(devices)), runs
        self._most = width if members is None else max(1, -(-members // self._devices))
        self._sharding = _by_rows(devices) if len(devices) else None
        self._pool = ThreadPoolExecutor(runs, thread_name_prefix="diffthrust")
        self._driver: greenlet = getcurrent()
        self._waiting: dict[_Kind, list[_Asked]] = {}
        self._under_way: dict[Future[list[Any]], list[_Asked]] = {}
        self._ready: deque[_Asked] = deque()
        self._closed = False

    def drive(self, works: Iterable[Callable[[], Any]]) -> Generator[None]:
        """Do some work, each piece in a member of its own; yields whenever one has ended.

        Raises:
            BaseException: what a piece of work raised; all others are given up.
        """
        self._driver = getcurrent()
        left, members = iter(works), set[greenlet]()
        most = self._width * self._devices * (self._runs + 1)  # some are under way, others gather
        try:
            while True:
                if self._ready:
                    member = self._ready.popleft().member
                elif len(members) < most and (work := next(left, None)) is not None:
                    member = greenlet(partial(self._within, work))
                    members.add(member)
                elif self._waiting and len(self._under_way) < self._runs:  # rather than be idle
                    self._begin(max(self._waiting, key=lambda kind: len(self._waiting[kind])))
                    continue
                elif self._under_way:
                    self._collect()
                    continue
                else:
                    return
                kind = member.switch()
                if member.dead:
                    members.remove(member)
                    yield
                elif len(self._waiting[kind]) >= kind.width:
                    self._begin(kind)
        finally:
            self._closed = True
            for member in members:
                if not member.dead:
                    member.throw()  # its work ends where it waits
            self._pool.shutdown(wait=False, cancel_futures=True)

    def _within(self, work: Callable[[], Any]) -> None:
        _present.set(self)  # a greenlet has a context of its own
        silence()
        work()

    def ask(
        self, program: Callable[..., Any], static: Hashable, numbers: Any, rows: int = 1
    ) -> Any:
        """``program(static, numbers)`` for this member; others have their turn meanwhile.

        A program that works on several ``rows`` by itself is run for fewer members at a time.
        """
        if self._closed:
            raise GreenletExit
        leaves, tree = jax.tree.flatten(numbers)
        leaves = [np.asarray(leaf) for leaf in leaves]
        shapes = tuple((leaf.shape, leaf.dtype) for leaf in leaves)
        width = max(1, min(self._most, self._width // rows)) * self._devices
        kind = _Kind(program, static, tree, shapes, width)
        asked = _Asked(getcurrent(), leaves)
        self._waiting.setdefault(kind, []).append(asked)
        self._driver.switch(kind)
        if asked.error is not None:
            raise asked.error
        return asked.found

    def _begin(self, kind: _Kind) -> None:
        """Run what waits for a program, beside all else; what it gives is collected later."""
        if len(self._under_way) >= self._runs:
            self._collect()
        group = self._waiting.pop(kind)
        self._under_way[self._pool.submit(self._run, kind, group)] = group

    def _run(self, kind: _Kind, group: list[_Asked]) -> list[Any]:
        """What a program gives to each of a group."""
        spare = [group[0]] * (kind.width - len(group))  # one shape, one compilation
        columns = zip(*(asked.leaves for asked in [*group, *spare]), strict=True)
        rows = jax.tree.unflatten(kind.tree, [np.stack(column) for column in columns])
        if self._sharding is not None:
            rows = jax.device_put(rows, self._sharding)
        found = jax.tree.map(np.asarray, _side_by_side(kind.program, kind.static, rows))
        return [jax.tree.map(lambda leaf, i=i: leaf[i], found) for i in range(len(group))]

    def _collect(self) -> None:
        """Wait for the first run to end, and hand every member its row."""
        for run in wait(self._under_way, return_when=FIRST_COMPLETED).done:
            group = self._under_way.pop(run)
            try:
                for asked, row in zip(group, run.result(), strict=True):
                    asked.found = row
            except Exception as error:  # it is raised in all of them
                for asked in group:
                    asked.error = error
            self._ready.extend(group)


def _by_rows(devices: Sequence[Any]) -> Any:
    mesh = jax.sharding.Mesh(np.array(devices), ("rows",))
    return jax.sharding.NamedSharding(mesh, jax.sharding.PartitionSpec("rows"))
