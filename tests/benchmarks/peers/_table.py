"""What was measured: one table for people, one file for programs."""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from datetime import date
from importlib import metadata
from typing import Any

from rich.table import Table

from ._jobs import JOBS
from ._measure import Cell, growth
from ._problem import DRAWS, WALKERS, WARMUP
from ._tools import INSTALL, Tool

PACKAGES = (
    "jax", "jaxlib", "numpy", "scipy", "numba", "casadi", "diffrax", "optimistix", "emcee",
)  # fmt: skip


class Notes:
    """Footnotes, each told once."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def mark(self, text: str) -> str:
        """The mark of a footnote, a letter in brackets."""
        if text not in self.texts:
            self.texts.append(text)
        return f"({chr(ord('a') + self.texts.index(text))})"


def machine(gpu: str | None) -> dict[str, Any]:
    """What the figures depend on; no name of the machine."""
    versions = {}
    for name in PACKAGES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = None
    return {
        "date": date.today().isoformat(),
        "cores": len(os.sched_getaffinity(0))
        if hasattr(os, "sched_getaffinity")
        else os.cpu_count(),
        "processor": platform.machine(),
        "system": platform.system(),
        "python": platform.python_version(),
        "gpu": gpu,
        "versions": versions,
    }


def document(cells: Sequence[Cell], told: dict[str, Any], settings: dict[str, Any]) -> Any:
    """All figures, for JSON; what is not known is null."""

    def row(cell: Cell) -> dict[str, Any]:
        found = {**asdict(cell), "seconds": cell.seconds}
        return {
            key: None if isinstance(value, float) and not math.isfinite(value) else value
            for key, value in found.items()
        }

    exponents = []
    for rows in _lines(cells):
        slope, error = growth(rows)
        if math.isfinite(slope):
            first = rows[0]
            exponents.append(
                {
                    "job": first.job,
                    "tool": first.tool,
                    "platform": first.platform,
                    "exponent": slope,
                    "std_error": error if math.isfinite(error) else None,
                }
            )
    return {
        "schema": 1,
        "machine": told,
        "settings": settings,
        "cells": [row(cell) for cell in cells],
        "growth": exponents,
    }


def table(
    cells: Sequence[Cell], tools: Sequence[Tool], limit: float, gpu: str | None
) -> tuple[Table, list[str]]:
    """The table, and the footnotes below it.

    Each time is followed by its ratio to that of the first tool.
    """
    notes, of = Notes(), {tool.name: tool for tool in tools}
    columns = max(len(line) for line in _lines(cells))
    out = Table(
        title="Work beside peers: median time of a warm run (over that of diffthrust)",
        caption="start: import + first call; memory: after the import + more at the peak; "
        "both of the largest size, as is the GPU's time; "
        f"posterior: {WALKERS * (WARMUP + DRAWS):,} densities",
    )
    heads = ["", *("" for _ in range(columns)), "growth", "start", "memory", "GPU"]
    for i, head in enumerate(heads):
        out.add_column(head, justify="left" if i == 0 else "right", no_wrap=True)
    for job in dict.fromkeys(cell.job for cell in cells):
        lines = [line for line in _lines(cells) if line[0].job == job]
        sizes = [f"[bold]{cell.size:,} {JOBS[job].unit}[/]" for cell in lines[0]]
        out.add_section()
        out.add_row(f"[bold]{JOBS[job].name}[/]", *sizes)
        ours = lines[0]
        for line in lines:
            if line[0].platform != "cpu":
                continue
            tool = of[line[0].tool]
            shown = [
                _cell(cell, base, tool, limit, notes) for cell, base in zip(line, ours, strict=True)
            ]
            out.add_row(tool.name, *shown, *_rest(line, lines, tool, gpu, limit, notes))
    marked = [f"({chr(ord('a') + i)}) {text}" for i, text in enumerate(notes.texts)]
    return out, marked


def _lines(cells: Sequence[Cell]) -> Iterator[list[Cell]]:
    """The cells of one job, tool and platform, size by size."""
    found: dict[tuple[str, str, str], list[Cell]] = {}
    for cell in cells:
        found.setdefault((cell.job, cell.tool, cell.platform), []).append(cell)
    yield from found.values()


def _cell(cell: Cell, ours: Cell, tool: Tool, limit: float, notes: Notes) -> str:
    if cell.status == "absent":
        return f"- {notes.mark(tool.absent[cell.job])}"
    if cell.status == "not installed":
        return f"not installed {notes.mark(f'To install: {INSTALL}')}"
    if cell.status == "late":
        return f"> {limit:g} s"
    if cell.status == "failed":
        return f"failed {notes.mark(f'{cell.tool}, {JOBS[cell.job].name}: {cell.message}')}"
    ratio = "" if cell is ours or not ours.times else f" ({times(cell.seconds / ours.seconds)})"
    wrong = ""
    if cell.status == "wrong":
        wrong = " " + notes.mark(f"{cell.tool}, {JOBS[cell.job].name}: {cell.message}")
    return f"{duration(cell.seconds)}{ratio}{wrong}"


def _rest(
    line: Sequence[Cell],
    lines: Sequence[Sequence[Cell]],
    tool: Tool,
    gpu: str | None,
    limit: float,
    notes: Notes,
) -> Iterator[str]:
    """Growth, start, memory and the GPU, of the largest size that was measured."""
    slope, error = growth(line)
    yield (
        ""
        if math.isnan(slope)
        else f"{slope:.2f}" + ("" if math.isnan(error) else f" ± {error:.2f}")
    )
    done = [cell for cell in line if cell.first is not None]
    if done:
        last = done[-1]
        yield f"{last.started:.1f} + {last.first:.1f} s"
        yield f"{last.imported:.0f} + {last.peak - last.imported:.0f} MiB"
    else:
        yield from ("", "")
    there = [
        other[-1] for other in lines if other[0].tool == tool.name and other[0].platform == "gpu"
    ]
    if there:
        yield _cell(there[0], line[-1], tool, limit, notes)
    elif line[0].job in tool.accelerated and gpu is None:
        yield "no GPU here"
    else:
        yield ""


def times(ratio: float) -> str:
    """A ratio with two figures, or all before the point."""
    return f"{ratio:,.0f}" if ratio >= 10 else f"{ratio:.2g}"


def duration(seconds: float) -> str:
    """Three figures and a unit."""
    unit, size = ("s", 1.0) if seconds >= 1.0 else ("ms", 1e-3) if seconds >= 1e-3 else ("us", 1e-6)
    return f"{seconds / size:.3g} {unit}"
