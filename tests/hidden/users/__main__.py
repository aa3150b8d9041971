"""Diagnose sets of users' logs: one row a seed, from the folder ``tests``.

    python -m hidden.users boat --count 10 --jobs 1 --out rows.jsonl
    python -m hidden.users all --count 10 --plain       # only the plain least squares, no diagnosis
    python -m hidden.users boat --write folder          # the CSV files, to look at

Rows are written as they come; the same command again goes on where it was cut. Beside each
diagnosis stand the errors over the whole unseen logs of a plain least squares: of the model as
given, and of the true structure, each beside the error of the truth itself. A set is worth a
diagnosis only where the true structure, fitted, reaches that of the truth: ``identified``.

Every set is worked on in a process of its own, which is ended where a diagnosis goes on for longer
than ``--limit``.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import partial
from pathlib import Path

from . import KINDS, draw
from .work import Row, work


def line(row: Row) -> str:
    """A row in words."""
    text = f"{row['kind']} {row['seed']}:"
    if "plain" in row:
        words = {"given": "least squares", "true": "true structure"}
        errors = {n: row["plain"][n]["errors"]["all"] for n in words if n in row["plain"]}
        text += " " + ", ".join(f"{words[n]} {error:.3f}" for n, error in errors.items())
        apart = {c: round(r, 2) for c, r in row["plain"]["reached"].items()}
        text += ";" if row["plain"]["identified"] else f" NOT IDENTIFIED {apart};"
    if "verdict" not in row:
        return text
    text += f" {'RIGHT' if row['right'] else 'wrong'} {row['verdict']} {row['seconds']:.0f} s"
    if "before" not in row:
        return text
    text += f", errors {row['before']['nrmse']:.3f} -> {row['after']['nrmse']:.3f}"
    text += f", added {row['added']}"
    for key in ("missed", "false", "unsaid", "wrongly", "off"):
        text += f", {key} {list(row[key])}" if row[key] else ""
    text += f", LEADING {row['leading']}" if row["leading"] else ""
    return text + f", {row['ratio']:.2f} times the true structure's error"


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Read the command line, work, report."""
    parser = argparse.ArgumentParser(prog="python -m hidden.users", description=__doc__)
    parser.add_argument("kinds", nargs="+", help=f"of {', '.join(KINDS)}; or all")
    parser.add_argument("--count", type=int, default=10, help="seeds of each kind")
    parser.add_argument("--seed", type=int, default=0, help="the first of them")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--out", type=Path, help="JSON-lines file of rows, also to go on from")
    parser.add_argument("--limit", type=float, default=900.0, help="seconds a diagnosis may take")
    parser.add_argument("--plain", action="store_true", help="the least squares alone")
    parser.add_argument(
        "--starts", type=int, default=3, help="of the model as given; 0 leaves it out"
    )
    parser.add_argument("--write", type=Path, help="write the CSV files there, and stop")
    arguments = parser.parse_args(words)
    if arguments.starts < 0:
        parser.error("--starts: at least 0")
    kinds = list(KINDS) if arguments.kinds == ["all"] else arguments.kinds
    plan = [(k, arguments.seed + n) for k in kinds for n in range(arguments.count)]
    if arguments.write:
        for kind, seed in plan:
            draw(kind, seed).write(arguments.write / f"{kind}_{seed}")
        return []
    rows = []
    if arguments.out and arguments.out.exists():
        rows = [json.loads(text) for text in arguments.out.read_text().splitlines() if text]
    done = {(row["kind"], row["seed"]) for row in rows}
    left = [task for task in plan if task not in done]
    job = partial(work, limit=arguments.limit, only_plain=arguments.plain, starts=arguments.starts)
    with ThreadPoolExecutor(arguments.jobs) as workers:
        for future in as_completed(workers.submit(job, task) for task in left):
            rows.append(row := future.result())
            print(line(row), flush=True)
            if arguments.out:
                with arguments.out.open("a") as file:
                    file.write(json.dumps(row) + "\n")
    for kind in kinds:
        judged = [row for row in rows if row["kind"] == kind and "verdict" in row]
        if judged:
            print(f"{kind}: {sum(row['right'] for row in judged)} of {len(judged)} right")
        sound = [
            row["plain"]["identified"] for row in rows if row["kind"] == kind and "plain" in row
        ]
        print(f"{kind}: the true structure is identified in {sum(sound)} of {len(sound)} sets")
    return rows


if __name__ == "__main__":
    main()
