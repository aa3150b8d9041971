"""Diagnose sets of users' logs: one row a seed, from the folder ``tests``.

    python -m hidden.users boat --count 10 --jobs 1 --out rows.jsonl
    python -m hidden.users all --count 10 --plain       # only the plain least squares, no diagnosis
    python -m hidden.users boat --write folder          # the CSV files, to look at

Rows are written as they come; the same command again goes on where it was cut. Beside each
diagnosis stand the errors over the whole unseen logs of a plain least squares: of the model as
given, and of the true structure, each beside the error of the truth itself. A set is worth a
diagnosis only where the true structure, fitted, reaches that of the truth: ``identified``.

Every set is worked on in a process of its own, which is ended where a diagnosis goes on for longer
than ``--limit``: an alarm does not interrupt compiled code.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import time
import traceback
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import partial
from pathlib import Path
from typing import Any

from reference import whole_runs as wr

from . import KINDS, UserSet, draw, judge
from .judge import last_error

Row = dict[str, Any]

IDENTIFIED = 1.15
"""Times the truth's own error that the true structure, fitted, may leave: what is found is held
against the fit by the same share (``UserSet.close``)."""


def plain(made: UserSet, starts: int) -> Row:
    """Errors of the unseen logs: the model as given and the true structure, by least squares.

    Runs begin at their true states: a first sample is noise, and a compass a degree off at the
    start leads a track astray that any model would follow.
    """
    train, unseen = made.begun()
    truth = wr.errors(made.systems[1], unseen, made.truth)
    if made.per_log:  # amplitude and phase belong to one log: fitted to the unseen one itself
        train = unseen
    row: Row = {"truth": truth}
    # Nothing fits better than what is near the truth: the true structure needs one start, there.
    # By the noise: a motor's angle goes on for hundreds of radians, beside which a hundredth, its
    # noise, counts for nothing.
    channels = [c for c in made.noise if c not in made.ruled]
    true: dict[str, Any] = {"first": made.truth, "sizes": made.noise, "channels": channels}
    ways = {"given": {"starts": starts}, "true": {"starts": 1, **true}}
    for (name, way), system in zip(ways.items(), made.systems, strict=True):
        begun = time.perf_counter()
        result = wr.fit(system, train, **way)
        row[name] = {
            "errors": wr.errors(system, unseen, result.values),
            "values": result.values,
            "costs": result.costs,
            "seconds": round(time.perf_counter() - begun, 1),
        }
    fitted = row["true"]["errors"]
    row["reached"] = {c: fitted[c] / truth[c] for c in channels}
    # over the channels together, as a diagnosis is judged: an arm that all but stands on its head
    # errs by three times the noise of its angle, and by none of its rate's
    sums = [sum(errors[c] ** 2 for c in channels) for errors in (fitted, truth)]
    row["identified"] = sums[0] <= IDENTIFIED**2 * sums[1]
    return row


def diagnosed(made: UserSet, true_error: float) -> Row:
    """The verdict of a diagnosis, what is wrong in it, and its errors over whole runs."""
    import diffthrust as dft

    begun = time.perf_counter()
    try:
        diag = dft.diagnose(made.model, made.train, holdout=made.unseen, experiment=False)
    except Exception:
        why = traceback.format_exc(limit=-4)
        spent = round(time.perf_counter() - begun, 1)
        return {"verdict": "failed", "right": False, "why": why, "seconds": spent}
    return {
        "verdict": str(diag.verdict),
        "added": list(diag.added),
        "detectable": list(diag.detectable),
        **judge(diag, made, true_error)._asdict(),
        "before": diag.stages[0].holdout.to_json(),
        "after": last_error(diag).to_json(),
        "seconds": round(time.perf_counter() - begun, 1),
        "steps": {step: round(spent, 1) for step, spent in diag.seconds.items()},
        "summary": diag.summary,
        "notes": list(diag.notes),
        "doubts": [str(doubt) for doubt in diag.fit.doubts],
    }


def send(
    pipe: Any, kind: str, seed: int, starts: int, only_plain: bool
) -> None:  # in a process of its own
    """Send the plain least squares, then what the diagnosis makes of the set."""
    made = draw(kind, seed)
    hidden = [{"what": h.what, "required": h.required, **h.parameters} for h in made.hidden]
    squares = plain(made, starts)
    pipe.send({"hidden": hidden, "plain": squares})
    if not only_plain:
        pipe.send(diagnosed(made, squares["true"]["errors"]["all"]))


def work(task: tuple[str, int], limit: float, only_plain: bool, starts: int) -> Row:
    """One row."""
    kind, seed = task
    context = multiprocessing.get_context("spawn")
    rows, pipe = context.Pipe(duplex=False)
    process = context.Process(target=send, args=(pipe, kind, seed, starts, only_plain))
    process.start()
    pipe.close()  # so that the end of the process is seen
    row: Row = {"kind": kind, "seed": seed}
    try:
        row |= rows.recv()
        if only_plain:
            return row
        too_long = {"verdict": "too long", "right": False, "seconds": limit}
        return row | (rows.recv() if rows.poll(limit) else too_long)
    except EOFError:
        return row | {"verdict": "died", "right": False, "seconds": 0.0}
    finally:
        process.kill()
        process.join()


def line(row: Row) -> str:
    """A row in words."""
    text = f"{row['kind']} {row['seed']}:"
    if "plain" in row:
        given, true = (row["plain"][name]["errors"] for name in ("given", "true"))
        text += f" least squares {given['all']:.3f}, true structure {true['all']:.3f}"
        apart = {c: round(r, 2) for c, r in row["plain"]["reached"].items()}
        text += ";" if row["plain"]["identified"] else f" NOT IDENTIFIED {apart};"
    if "verdict" not in row:
        return text
    text += f" {'RIGHT' if row['right'] else 'wrong'} {row['verdict']} {row['seconds']:.0f} s"
    if "before" not in row:
        return text
    text += f", errors {row['before']['nrmse']:.3f} -> {row['after']['nrmse']:.3f}"
    text += f", added {row['added']}"
    for key in ("missed", "false", "unsaid", "wrongly", "off", "astray"):
        text += f", {key} {list(row[key])}" if row[key] else ""
    text += f", LEADING {row['leading']}" if row["leading"] else ""
    text += f", {row['ratio']:.2f} times the true structure's error"
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
    parser.add_argument("--starts", type=int, default=3, help="of the least squares, at least 1")
    parser.add_argument("--write", type=Path, help="write the CSV files there, and stop")
    arguments = parser.parse_args(words)
    if arguments.starts < 1:
        parser.error("--starts: at least 1, for a diagnosis is held against the least squares")
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
