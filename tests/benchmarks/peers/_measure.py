"""The measurement: all tools of one job and size take turns, each in a process of its own."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ._jobs import JOBS
from ._tools import Tool
from ._worker import Failed, Late, Worker

START = 120.0
"""A process may take so long to import and to prepare its job [s]."""


@dataclass
class Cell:
    """One tool at one job and size.

    Args:
        tool: its name.
        job: by name.
        size: in the job's unit.
        platform: "cpu" or "gpu".
        times: seconds of a unit of work, one of each turn, warm.
        counts: units of work, one of each turn.
        started: seconds of the imports.
        first: seconds of the first call, which compiles.
        imported: memory after the imports [MiB].
        peak: the most memory [MiB].
        apart: difference of its first answer to this package's, as the job counts it.
        status: "measured", "absent" (see the tool), "not installed", "late", "failed", or "wrong"
            where the answers differ by more than the job allows.
        message: why it failed.
    """

    tool: str
    job: str
    size: int
    platform: str = "cpu"
    times: list[float] = field(default_factory=list)
    counts: list[float] = field(default_factory=list)
    started: float | None = None
    first: float | None = None
    imported: float = math.nan
    peak: float = math.nan
    apart: float | None = None
    status: str = "measured"
    message: str = ""

    @property
    def seconds(self) -> float:
        """The median; NaN where nothing was measured."""
        return float(np.median(self.times)) if self.times else math.nan


def growth(cells: Sequence[Cell]) -> tuple[float, float]:
    """Exponent of the time over the size, and its standard error; NaN where too few are known."""
    known = [(cell.size, cell.seconds) for cell in cells if cell.times]
    sizes, seconds = np.log(np.reshape(known, (-1, 2))).T
    if len(set(sizes)) < 2:
        return math.nan, math.nan
    x = sizes - sizes.mean()
    slope = float(x @ seconds / (x @ x))
    rest = seconds - seconds.mean() - slope * x
    left = len(known) - 2
    return slope, math.sqrt(float(rest @ rest) / left / float(x @ x)) if left else math.nan


def measure(
    jobs: Sequence[str],
    sizes: Sequence[int],
    tools: Sequence[Tool],
    *,
    repeats: int,
    limit: float,
    gpu: bool = False,
    tell: Callable[[str], None] = lambda message: None,
) -> Iterator[Cell]:
    """Measure every tool at every job and size.

    Args:
        jobs: by name.
        sizes: in samples; each job has its own scale.
        tools: the first gives the answers that the others' are held against.
        repeats: turns after the one that compiles.
        limit: for one call [s]; a tool that takes longer is not tried at larger sizes.
        gpu: run `Tool.accelerated` on one as well.
        tell: called with what is under way.
    """
    for job in jobs:
        late: set[tuple[str, str]] = set()
        for size in (JOBS[job].scale(size) for size in sizes):
            tell(f"{JOBS[job].name}: {size:,} {JOBS[job].unit}")
            cells = _plan(job, size, tools, gpu, late)
            _row(cells, {tool.name: tool.module for tool in tools}, repeats, limit)
            late |= {(cell.tool, cell.platform) for cell in cells if cell.status == "late"}
            yield from cells


def _plan(
    job: str, size: int, tools: Sequence[Tool], gpu: bool, late: set[tuple[str, str]]
) -> list[Cell]:
    """The cells of one job and size, with those marked that need not be tried."""
    cells = []
    for tool in tools:
        cells.append(Cell(tool.name, job, size))
        if job in tool.absent:
            cells[-1].status = "absent"
        elif not tool.installed:
            cells[-1].status = "not installed"
        if gpu and job in tool.accelerated:
            cells.append(Cell(tool.name, job, size, "gpu"))
    for cell in cells:
        if (cell.tool, cell.platform) in late:
            cell.status = "late"
    return cells


def _row(cells: Sequence[Cell], modules: dict[str, str], repeats: int, limit: float) -> None:
    """Fill the cells: one call of each that compiles, then turns, so that all suffer alike."""
    at_work: list[tuple[Cell, Worker]] = []
    answers: list[Any] = []
    try:
        for cell in cells:
            if cell.status != "measured":
                continue
            worker = Worker(modules[cell.tool], cell.job, cell.size, cell.platform)
            at_work.append((cell, worker))
            with _noted(cell, worker):
                cell.started, cell.imported = worker.ready(START)
                cell.first, answer, cell.peak = worker.run(0, limit)
                answers.append(answer)
                _compare(cell, answers[0], answer)
        for turn in range(1, repeats + 1):
            for cell, worker in at_work:
                if cell.status not in ("late", "failed"):
                    with _noted(cell, worker):
                        seconds, answer, cell.peak = worker.run(turn, limit)
                        cell.counts.append(JOBS[cell.job].count(answer))
                        cell.times.append(seconds / cell.counts[-1])
    finally:
        for _, worker in at_work:
            worker.close()


@contextmanager
def _noted(cell: Cell, worker: Worker) -> Iterator[None]:
    """What goes wrong is noted in the cell, and the worker stops."""
    try:
        yield
    except (Late, Failed) as error:
        cell.status = "late" if isinstance(error, Late) else "failed"
        cell.message, cell.times = str(error), []
        worker.close()


def _compare(cell: Cell, ours: Any, theirs: Any) -> None:
    job = JOBS[cell.job]
    cell.apart = job.apart(ours, theirs)
    if not cell.apart <= job.allowed:
        cell.status = "wrong"
        cell.message = f"differs by {cell.apart:.1e}, allowed {job.allowed:.0e}"
