"""Diagnose sets of users' logs: one row a seed, from the folder ``tests``.

    python -m hidden.users boat --count 10 --jobs 1 --out rows.jsonl
    python -m hidden.users all --count 1 --plain        # only the plain least squares, no diagnosis
    python -m hidden.users boat --write folder          # the CSV files, to look at

Rows are written as they come; the same command again goes on where it was cut. Beside each
diagnosis stand the errors over the whole unseen logs of a plain least squares: of the model as
given, and of the true structure.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import signal
import time
import traceback
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from reference import whole_runs as wr

from . import KINDS, UserSet, draw, judge
from .judge import said

Row = dict[str, Any]


class TooLong(Exception):
    """A diagnosis went on for longer than allowed."""


def plain(made: UserSet, starts: int) -> Row:
    """Errors of the unseen logs: the model as given and the true structure, by least squares."""
    train, unseen = made.runs()
    row: Row = {}
    if made.per_log:  # amplitude and phase belong to one log: fitted to the unseen one itself
        train = unseen
    for name, system in zip(("given", "true"), made.systems, strict=True):
        begun = time.perf_counter()
        found = wr.fit(system, train, starts=starts)
        row[name] = {
            "errors": wr.errors(system, unseen, found.values),
            "values": found.values,
            "costs": found.costs,
            "seconds": round(time.perf_counter() - begun, 1),
        }
    return row


def diagnosed(made: UserSet, limit: float) -> Row:
    """The verdict of a diagnosis, what is wrong in it, and its errors over whole runs."""
    import diffthrust as dft

    def stop(*_: object) -> None:
        raise TooLong

    begun = time.perf_counter()
    signal.signal(signal.SIGALRM, stop)
    signal.alarm(int(limit))
    try:
        diag = dft.diagnose(made.model, made.train, holdout=made.unseen, experiment=False)
        signal.alarm(0)
    except TooLong:
        return {"verdict": "too long", "right": False, "seconds": limit}
    except Exception:
        signal.alarm(0)
        why = traceback.format_exc(limit=-4)
        return {
            "verdict": "failed",
            "right": False,
            "why": why,
            "seconds": time.perf_counter() - begun,
        }
    judged = judge(diag, made)
    learned = diag.laws[-1].reported.holdout if diag.laws else None
    last = learned or diag.stages[-1].holdout
    return {
        "verdict": str(diag.verdict),
        "right": judged.right,
        "added": list(diag.added),
        "detectable": list(diag.detectable),
        **{key: value for key, value in judged._asdict().items() if key != "right"},
        "before": diag.stages[0].holdout.to_json(),
        "after": last.to_json(),
        "seconds": round(time.perf_counter() - begun, 1),
        "said": said(diag),
    }


def work(task: tuple[str, int], limit: float, only_plain: bool, starts: int) -> Row:
    """One row."""
    kind, seed = task
    made = draw(kind, seed)
    hidden = [{"what": h.what, "required": h.required, **h.parameters} for h in made.hidden]
    row: Row = {"kind": kind, "seed": seed, "hidden": hidden}
    if starts:
        row["plain"] = plain(made, starts)
    if not only_plain:
        row |= diagnosed(made, limit)
        if row.get("after") and made.close and starts:
            true = row["plain"]["true"]["errors"]["all"]
            row["ratio"] = row["after"]["nrmse"] / true
            row["right"] = row["right"] and row["ratio"] <= made.close
    return row


def line(row: Row) -> str:
    """A row in words."""
    text = f"{row['kind']} {row['seed']}:"
    if "plain" in row:
        given, true = (row["plain"][name]["errors"] for name in ("given", "true"))
        text += f" least squares {given['all']:.3f}, true structure {true['all']:.3f};"
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
    return text


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
    parser.add_argument("--starts", type=int, default=3, help="of the least squares; 0 for none")
    parser.add_argument("--write", type=Path, help="write the CSV files there, and stop")
    arguments = parser.parse_args(words)
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
    if arguments.jobs == 1:
        coming = map(job, left)
    else:
        coming = multiprocessing.get_context("spawn").Pool(arguments.jobs).imap_unordered(job, left)
    for row in coming:
        rows.append(row)
        print(line(row), flush=True)
        if arguments.out:
            with arguments.out.open("a") as file:
                file.write(json.dumps(row) + "\n")
    for kind in kinds:
        judged = [row for row in rows if row["kind"] == kind and "verdict" in row]
        if judged:
            print(f"{kind}: {sum(row['right'] for row in judged)} of {len(judged)} right")
    return rows


if __name__ == "__main__":
    main()
