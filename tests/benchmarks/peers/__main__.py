"""All peers in one command and one table, from the folder ``tests``.

    python -m benchmarks.peers --json peers.json

Sizes are samples of a log; the map has a sixteenth as many points, and "many logs" one log for
every 64 of them. Ratios are what counts: all tools of a row take turns in one run.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from ._jobs import JOBS
from ._measure import Cell, measure
from ._table import document, machine, table
from ._tools import TOOLS
from ._worker import gpu

WIDTH = 160


def sizes(text: str) -> list[int]:
    """Whole numbers divided by commas, increasing."""
    found = [int(word) for word in text.split(",")]
    if found != sorted(set(found)) or found[0] < 100:
        raise argparse.ArgumentTypeError(
            f"expected increasing numbers of samples from 100 on, found {text}"
        )
    return found


def positive(text: str) -> int:
    """A whole number from 1 on."""
    if int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number from 1 on, found {text}")
    return int(text)


def arguments(given: Sequence[str] | None = None) -> argparse.Namespace:
    """The options of the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--sizes", type=sizes, default=[1000, 4000, 16000], metavar="N,N,N")
    parser.add_argument("--repeats", type=positive, default=5, help="turns after the first call")
    parser.add_argument("--limit", type=float, default=60.0, help="seconds for one call")
    parser.add_argument("--jobs", nargs="+", choices=list(JOBS), default=list(JOBS))
    parser.add_argument("--json", type=Path, metavar="FILE")
    return parser.parse_args(given)


def main(given: Sequence[str] | None = None, console: Console | None = None) -> list[Cell]:
    """Measure, print the table, write the file."""
    from diffthrust._support.files import write_whole  # JAX with it: not for every worker

    asked = arguments(given)
    console = console or Console(width=WIDTH)
    device = gpu()
    told = machine(device)
    settings = {"sizes": asked.sizes, "repeats": asked.repeats, "limit": asked.limit}
    cells: list[Cell] = []

    def save() -> None:
        if asked.json:
            text = json.dumps(document(cells, told, settings), indent=1, allow_nan=False)
            write_whole(asked.json, f"{text}\n".encode())

    save()  # what cannot be written is told now
    for cell in measure(
        asked.jobs,
        asked.sizes,
        TOOLS,
        repeats=asked.repeats,
        limit=asked.limit,
        gpu=device is not None,
        tell=lambda message: console.print(message, style="dim", markup=False),
    ):
        cells.append(cell)
        save()  # a run that is cut keeps what it has measured
    shown, notes = table(cells, TOOLS, asked.limit, device)
    console.print(shown)
    for note in notes:
        console.print(note, markup=False)
    versions = ", ".join(f"{name} {number}" for name, number in told["versions"].items() if number)
    where = f"{told['date']}, {told['cores']} cores ({told['processor']}, {told['system']})"
    console.print(f"{where}, Python {told['python']}, {versions}", markup=False)
    return cells


if __name__ == "__main__":
    main()
