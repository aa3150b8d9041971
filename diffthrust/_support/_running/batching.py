"""Compiled programs of several members, run side by side.

A program that several members ask for at once, with numbers of equal shapes, is run for
some of them together: their numbers are stacked, and every member gets its own row of the result.
On a processor a few rows fill its vector units, and more rows fall out of its cache; an accelerator
takes hundreds. Between programs (its checks, its next start) every member works independently, so
that none waits for the slowest, and a failure ends only the member in which it occurs.

Members take turns in one thread, as greenlets: each goes on until it asks for a program. Threads
would pass Python's lock to and fro at every operation of NumPy, which takes longer than the work.
Programs run in a few threads beside it, while other members have their turn.

Outside `SharedRuns` a program is run at once, as it is.
"""

from __future__ import annotations

import math
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

from diffthrust._support._running.programs import Programs, program
from diffthrust._support.warned import silence

_present: ContextVar[SharedRuns | None] = ContextVar("shared_runs", default=None)
_ladder: ContextVar[Sequence[int]] = ContextVar("ladder", default=())
_SHORT = 16
"""Samples: shorter series are padded to this length; they do not deserve separate programs."""


def shared_runs() -> SharedRuns | None:
    """What runs this member's programs beside those of others, if it has company."""
    return _present.get()


@contextmanager
def padded_to(lengths: Sequence[int]) -> Iterator[None]:
    """Within it, series are padded to these lengths, ascending, so that they share programs."""
    token = _ladder.set(lengths)
    try:
        yield
    finally:
        _ladder.reset(token)


def is_unbatched() -> bool:
    """Whether programs run for one log at a time, so that what is padded can be left out."""
    return shared_runs() is None


def padded_length(samples: int) -> int:
    """The length to which a log is padded: the shortest of a few lengths that holds it.

    The lengths are those of `padded_to`, or, without these, two to each doubling. Each length needs
    a separate compiled program.
    """
    lengths = _ladder.get()
    at = int(np.searchsorted(lengths, samples))
    if at < len(lengths):
        return int(lengths[at])
    if len(lengths):
        return samples
    # Two lengths to a doubling: at most 41 % padding, and some 20 programs between 16 and 16 000
    # samples. The 1e-9 keeps a length that is one of the ladder, such as 4096, from being rounded
    # up.
    halves = math.ceil(2 * math.log2(max(samples, _SHORT)))
    return max(samples, math.ceil(2 ** (halves / 2) - 1e-9))


def padded(values: np.ndarray, length: int = 0) -> np.ndarray:
    """A series with its last value repeated up to a length, by default its `padded_length`.

    For equations that are evaluated sample by sample without being compiled: JAX keeps the code of
    each operation for each length, twenty of them and 27 MB for a diagnosis of a thruster. A
    process that diagnosed ninety sets of logs held 5.5 GB.
    """
    return np.pad(values, (0, (length or padded_length(values.size)) - values.size), "edge")


def run_program(program: Programs, static: Hashable, numbers: Any, rows: int = 1) -> Any:
    """``program(static, numbers)``, compiled; beside those of other members where there are any.

    ``rows`` is the number of rows that the program already processes side by side.
    """
    company = shared_runs()
    if company is None:
        return program(static, numbers)
    return company.ask(program, static, numbers, rows)


@program(2)
def run_stacked(program: Programs, static: Hashable, rows: Any) -> Any:
    """A program on rows of numbers, side by side."""
    return jax.vmap(partial(program.function, static))(rows)


class _Program(NamedTuple):
    """A program that requests may share: its code, the shapes of its numbers, and its rows."""

    function: Programs
    static: Hashable
    tree: Any
    shapes: tuple[Any, ...]
    width: int


@dataclass(eq=False)
class _Request:
    """What one member waits for."""

    member: greenlet
    leaves: list[np.ndarray]
    row: Any = None
    error: BaseException | None = None


class SharedRuns:
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
        self._waiting: dict[_Program, list[_Request]] = {}
        self._under_way: dict[Future[list[Any]], list[_Request]] = {}
        self._ready: deque[_Request] = deque()
        self._closed = False

    def drive(self, works: Iterable[Callable[[], Any]]) -> Generator[None]:
        """Do pieces of work, each in a separate member; yields whenever one has ended."""
        self._driver = getcurrent()
        waiting, members = iter(works), set[greenlet]()
        # One group's worth of members for each run in progress, and one more that fills the next
        # group: further members would only hold memory.
        most = self._width * self._devices * (self._runs + 1)
        try:
            while True:
                if self._ready:
                    member = self._ready.popleft().member
                elif len(members) < most and (work := next(waiting, None)) is not None:
                    member = greenlet(partial(self._within, work))
                    members.add(member)
                # A thread is free and no member can go on: a group that is not full runs now, since
                # waiting for more members would wait for ever.
                elif self._waiting and len(self._under_way) < self._runs:
                    self._begin(max(self._waiting, key=lambda program: len(self._waiting[program])))
                    continue
                elif self._under_way:
                    self._collect()
                    continue
                else:
                    return
                program = member.switch()
                if member.dead:
                    members.remove(member)
                    yield
                elif len(self._waiting[program]) >= program.width:
                    self._begin(program)
        finally:
            self._closed = True
            for member in members:
                if not member.dead:
                    member.throw()  # GreenletExit at the switch in `ask`, so that `finally` runs
            self._pool.shutdown(wait=False, cancel_futures=True)

    def _within(self, work: Callable[[], Any]) -> None:
        _present.set(self)  # a greenlet has a separate context
        silence()
        work()

    def ask(self, program: Programs, static: Hashable, numbers: Any, rows: int = 1) -> Any:
        """``program(static, numbers)`` for this member; others have their turn meanwhile.

        A program that works on several ``rows`` by itself is run for fewer members at a time.
        """
        # A `finally` of a member that was given up may ask for one more program; nobody would run
        # it.
        if self._closed:
            raise GreenletExit
        leaves, tree = jax.tree.flatten(numbers)
        leaves = [np.asarray(leaf) for leaf in leaves]
        shapes = tuple((leaf.shape, leaf.dtype) for leaf in leaves)
        width = max(1, min(self._most, self._width // rows)) * self._devices
        shared = _Program(program, static, tree, shapes, width)
        request = _Request(getcurrent(), leaves)
        self._waiting.setdefault(shared, []).append(request)
        self._driver.switch(shared)
        if request.error is not None:
            raise request.error
        return request.row

    def _begin(self, program: _Program) -> None:
        """Run the requests that wait for a program in a thread; `_collect` takes the results."""
        if len(self._under_way) >= self._runs:
            self._collect()
        group = self._waiting.pop(program)
        self._under_way[self._pool.submit(self._run, program, group)] = group

    def _run(self, program: _Program, group: list[_Request]) -> list[Any]:
        """The results of a program for each request of a group."""
        # An incomplete group is filled up with copies of its first member: every number of rows is
        # a shape of its own, and compiling one takes far longer than the superfluous rows.
        spare = [group[0]] * (program.width - len(group))
        columns = zip(*(request.leaves for request in [*group, *spare]), strict=True)
        rows = jax.tree.unflatten(program.tree, [np.stack(column) for column in columns])
        if self._sharding is not None:
            rows = jax.device_put(rows, self._sharding)
        results = jax.tree.map(np.asarray, run_stacked(program.function, program.static, rows))
        return [jax.tree.map(lambda leaf, i=i: leaf[i], results) for i in range(len(group))]

    def _collect(self) -> None:
        """Wait for the first run to end, and hand every member its row."""
        for run in wait(self._under_way, return_when=FIRST_COMPLETED).done:
            group = self._under_way.pop(run)
            try:
                for request, row in zip(group, run.result(), strict=True):
                    request.row = row
            except Exception as error:  # it is raised in all of them
                for request in group:
                    request.error = error
            self._ready.extend(group)


def _by_rows(devices: Sequence[Any]) -> Any:
    mesh = jax.sharding.Mesh(np.array(devices), ("rows",))
    return jax.sharding.NamedSharding(mesh, jax.sharding.PartitionSpec("rows"))
