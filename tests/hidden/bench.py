"""The whole bench in one command, from the folder ``tests``.

    python -m hidden.bench --jobs 2 --out results.jsonl

Results are written as they come, one JSON object a line; the same command again goes on where it
was cut. ``--kinds`` takes classes or kinds: ``--kinds clear field-none outside/load_hump``.
Those of `further` (unmeasured states, wrong constants, odd logs, rivals, small effects, held and
lost samples) are done where they are asked for: ``--kinds further``. ``--watch`` keeps in each row
at which values of its settings the diagnosis would have decided otherwise (`sweep`).
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

import diffthrust as dft

from . import further, sets
from .further import FURTHER, FurtherSet
from .score import LABELS, Line, Outcome, confusion, held_out_ratio, score
from .sets import CLASSES, HiddenSet
from .sweep_watch import watching

Row = dict[str, Any]
Task = tuple[str, int, bool, bool]
CHUNK = 8


def examine(kind: str, seed: int, diagnose: Callable[..., Any], ratio: bool = True) -> Row:
    """Draw a set, diagnose it, judge the diagnosis. A diagnosis that raises is a failure."""
    hidden = drawn(kind, seed)
    options = {}
    if isinstance(hidden, FurtherSet) and hidden.candidates:
        options["candidates"] = hidden.candidates
    begun, close, diag = time.perf_counter(), None, None
    try:
        diag = diagnose(hidden.model, hidden.train, holdout=hidden.unseen, **options)
        seconds = time.perf_counter() - begun
        outcome = score(hidden, diag)
        if ratio and not options and outcome.right and diag.added and hidden.truth:
            close = held_out_ratio(hidden, diag)
    except Exception:
        seconds = time.perf_counter() - begun
        outcome = Outcome(False, "failed", traceback.format_exc(limit=-4))
    return {
        "kind": kind,
        "seed": seed,
        "group": hidden.group,
        "truth": list(hidden.truth),
        "right": outcome.right,
        "label": outcome.label,
        "why": outcome.why,
        "ratio": close,
        "seconds": round(seconds, 2),
        "unseen": [] if diag is None else _unseen(diag.to_json()),
        "diagnosis": None if diag is None else _brief(diag),
    }


def drawn(kind: str, seed: int) -> HiddenSet:
    """A set of either half of the bench."""
    half = further if kind.partition("/")[0] in FURTHER else sets
    return half.draw(kind, seed)


def _brief(diag: Any) -> Row:
    """What a diagnosis says, and on what it rests, without the errors of its stages."""
    return {key: value for key, value in diag.to_json().items() if key != "stages"}


def _unseen(told: Row) -> list[float]:
    """NRMSE of the unseen log, stage by stage."""
    return [stage["holdout"]["nrmse"] for stage in told.get("stages", []) if stage["holdout"]]


def _work(task: Task) -> Row:
    kind, seed, ratio, watch = task
    diagnose = partial(dft.diagnose, experiment=False)
    if not watch:
        return examine(kind, seed, diagnose, ratio)
    with watching() as decisions:
        row = {**examine(kind, seed, diagnose, ratio), "decisions": decisions}
    # Numbers that are watched note their comparisons and cannot be sent to another process.
    return json.loads(json.dumps(row))


def _start_worker() -> None:
    """A process of its own: its compiled code is shared with the others through the disk."""
    from diffthrust._support._running.cache import enable_compilation_cache  # private: as pools do

    enable_compilation_cache()


def results(tasks: Sequence[Task], jobs: int) -> Iterator[Row]:
    """Work through the tasks; neighbours, which share compiled code, go to the same process."""
    if jobs == 1:
        _start_worker()
        yield from map(_work, tasks)
        return
    with multiprocessing.get_context("spawn").Pool(jobs, _start_worker) as pool:
        yield from pool.imap_unordered(_work, tasks, CHUNK)


def report(rows: Sequence[Row], console: Console) -> None:
    """Print the confusion table, then every failure with its kind and seed."""
    table = Table(title="Hidden-effect bench")
    heads = ["class", "sets", *LABELS, "share", "target", "95 %", "held-out within 5 %", "s a set"]
    for head in heads:
        table.add_column(head, justify="left" if head == "class" else "right")
    for line in confusion(rows):
        table.add_row(*_cells(line))
    console.print(table)
    for row in rows:
        if not row["right"]:
            console.print(
                f"{row['kind']} {row['seed']}: {row['label']}; {row['why']}", markup=False
            )
    right = sum(row["right"] for row in rows)
    console.print(f"{right} of {len(rows)} right.")


def _cells(line: Line) -> list[str]:
    low, high = line.interval
    met = "green" if line.share >= line.target else "red"
    return [
        line.group,
        str(line.count),
        *(str(line.labels[label] or "") for label in LABELS),
        f"[{met}]{line.share:.2f}[/]",
        f"{line.target:.2f}",
        f"{low:.2f} to {high:.2f}",
        f"{line.close[0]} of {line.close[1]}" if line.close[1] else "",
        f"{line.seconds:.1f}",
    ]


def _earlier(path: Path | None) -> dict[tuple[str, int], Row]:
    """Results of a run that was cut; a line torn by the cut is left out."""
    if path is None or not path.exists():
        return {}
    found = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            continue
        found[row["kind"], row["seed"]] = row
    return found


def run(arguments: argparse.Namespace, console: Console) -> list[Row]:
    """Do what is left of the plan, write each result as it comes, and give all of them."""
    asked = tuple(arguments.kinds)
    classes = {**CLASSES, **FURTHER} if asked else CLASSES
    if "further" in asked:
        asked = (*(name for name in asked if name != "further"), *FURTHER)
    plan = sets.plan(arguments.count, arguments.seed, asked, arguments.only_field, classes)
    rows = {task: row for task, row in _earlier(arguments.out).items() if task in set(plan)}
    left = [(*task, not arguments.no_ratio, arguments.watch) for task in plan if task not in rows]
    console.print(f"{len(plan)} sets, {len(rows)} of them done.")
    for row in results(left, arguments.jobs):
        rows[row["kind"], row["seed"]] = row
        if arguments.out is not None:
            with arguments.out.open("a", encoding="utf-8") as file:
                file.write("\n" * _torn(arguments.out) + json.dumps(row) + "\n")
        said = f"{row['label']} {'' if row['right'] else row['why'].splitlines()[-1]}"
        count = f"{len(rows)}/{len(plan)} {row['kind']} {row['seed']} {row['seconds']:.1f} s"
        console.print(f"{count}: {said}", markup=False)
    return [rows[task] for task in plan]


def _torn(path: Path) -> bool:
    """Whether the file ends within a line, as a run that was killed leaves it."""
    if not path.exists() or not path.stat().st_size:
        return False
    with path.open("rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read() != b"\n"


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Read the command line, run, report."""
    parser = argparse.ArgumentParser(prog="python -m hidden.bench", description=__doc__)
    parser.add_argument(
        "--kinds", nargs="*", default=[], help="classes or kinds; 'further' for all of those"
    )
    parser.add_argument("--count", type=int, help="number of sets; one round by default")
    parser.add_argument("--seed", type=int, default=0, help="of the plan and of its sets")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--out", type=Path, help="JSON-lines file of results, also to go on from")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    parser.add_argument("--only-field", action="store_true", help="field conditions only")
    parser.add_argument("--watch", action="store_true", help="keep what the settings decide")
    parser.add_argument("--no-ratio", action="store_true", help="leave the true structure unfitted")
    arguments = parser.parse_args(words)
    console = Console(stderr=arguments.json, width=None if os.isatty(1) else 180)
    rows = run(arguments, console)
    report(rows, console)
    if arguments.json:
        print(json.dumps([line._asdict() for line in confusion(rows)], indent=1))
    return rows


if __name__ == "__main__":
    main()
