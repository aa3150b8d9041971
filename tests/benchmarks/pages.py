"""The pages of measured numbers in docs/numbers, written from the measurements stored beside them.

    cd tests && python -m benchmarks.pages                                # the pages anew
    cd tests && python -m benchmarks.pages --bench results.jsonl --seed 53   # of `hidden.bench`
    cd tests && python -m benchmarks.pages --peers peers.json             # of `benchmarks.peers`
    cd tests && python -m benchmarks.pages --sweep answers.json --seed 3511  # of `hidden.sweep`

With a file of results its figures are taken in, with their origin (commit, day and machine, or the
version). A page is never written by hand: a test holds it against what this script gives.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any

from hidden import learned
from hidden.score import wilson
from places import ROOT

import diffthrust as dft

NUMBERS = ROOT / "docs" / "numbers"
BENCH, PEERS = NUMBERS / "hidden_effects.json", NUMBERS / "benchmarks.json"
SWEEP = NUMBERS / "thresholds.json"
Run = dict[str, Any]

CLASSES: dict[str, tuple[str, str, tuple[str, ...]]] = {
    # name: words, share that is asked for, groups of the bench
    "clear": ("one effect, clear (thrusters, vessels)", "99 %", ("clear", "vessel")),
    "faint": ("one effect, faint", "95 %", ("faint", "vessel_faint")),
    "limit": (
        "one effect at the limit of detection: none named, or the right one",
        "95 %",
        ("limit",),
    ),
    "poor": ("speed only, poor excitation", "95 %", ("speed_only", "poor")),
    "none": (
        "nothing hidden (white, AR(1), field, redundant): no effect named",
        "95 %",
        ("none", "none_ar", "redundant", "vessel_none", "field-none", "field-vessel_none"),
    ),
    "pairs": ("two effects", "95 %", ("pairs",)),
    "outside": (
        "outside the catalogue, with the right port",
        "90 %",
        ("outside", "vessel_outside", "field-outside", "field-vessel_outside"),
    ),
    "field": (
        "field conditions, one effect",
        "95 %",
        ("field-clear", "field-speed_only", "field-poor", "field-vessel"),
    ),
    "field_pairs": ("field conditions, two effects", "85 %", ("field-pairs",)),
}
LEARNED = {
    # words of `hidden.learned`: words of the page, share that is asked for
    "close to the plant, where it halves the error": (
        "learned: unseen error within 10 % (20 % with memory) of the plant's, where that halves it",
        "90 %",
    ),
    "or to the true law, estimated": (
        "learned: or of the true law's, its numbers estimated from the same logs",
        "90 %",
    ),
    "right port, of those learned": ("learned: right port", "95 %"),
    "right form, of those learned": ("learned: right closed form first", "85 %"),
    "or told as alike": ("learned: right closed form first, or told as alike", ""),
    "learned where nothing is hidden": ("learned where nothing is hidden", "at most 5 %"),
}
CLOSE = "error on the unseen log within 5 % of that of the true structure"
MADE = "% made by `cd tests && python -m benchmarks.pages`; do not edit"


def taken(where: Path) -> Run:
    """The stored measurements of one kind: runs, and notes on them."""
    return json.loads(where.read_text(encoding="utf-8"))


def stamp() -> Run:
    """Day, commit and machine of a measurement; no name of the machine."""
    words = ["git", "describe", "--always", "--dirty"]
    commit = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True)
    return {
        "date": date.today().isoformat(),
        "commit": commit.stdout.strip(),
        "machine": f"{len(os.sched_getaffinity(0))} cores, {platform.machine()}, "
        f"Python {platform.python_version()}",
    }


def of_bench(rows: Sequence[Mapping[str, Any]], seed: int) -> Run:
    """The figures of a run of the bench: right answers and sets by class."""
    classes = {}
    for name, (_, _, groups) in CLASSES.items():
        ours = [row["right"] for row in rows if row["group"] in groups]
        if ours:
            classes[name] = [sum(ours), len(ours)]
    ratios = [row["ratio"] for row in rows if row["ratio"] is not None]
    close = [sum(ratio <= 1.05 for ratio in ratios), len(ratios)]
    found = {"seed": seed, **stamp(), "classes": classes, "close": close if ratios else None}
    laws = learned.all_judged(rows)
    return {**found, "learned": learned.shares(rows, laws)} if laws else found


def of_peers(document: Mapping[str, Any]) -> Run:
    """The figures of a comparison with peers, a row for each job and tool."""
    from benchmarks.peers._jobs import JOBS
    from benchmarks.peers._table import duration, times

    lines: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for cell in document["cells"]:
        if cell["platform"] == "cpu" and cell["status"] not in ("absent", "not installed"):
            lines.setdefault((cell["job"], cell["tool"]), []).append(cell)
    slopes = {(g["job"], g["tool"]): g for g in document["growth"] if g["platform"] == "cpu"}
    rows = []
    for (job, tool), cells in lines.items():
        ours = lines[job, next(t for j, t in lines if j == job)]
        told = []
        for cell, base in zip(cells, ours, strict=True):
            if cell["seconds"] is None:
                told.append(f"over {document['settings']['limit']:g} s")
            elif cells is ours:
                told.append(duration(cell["seconds"]))
            else:
                told.append(times(cell["seconds"] / base["seconds"]))
        slope = slopes.get((job, tool))
        sizes = ", ".join(f"{cell['size']}" for cell in cells)
        rows.append(
            {
                "job": f"{JOBS[job].name}: {sizes} {JOBS[job].unit}",
                "tool": tool,
                "told": ", ".join(told),
                "growth": f"{slope['exponent']:.2f}" if slope else "",
                "memory": "",
            }
        )
    machine = document["machine"]
    settings = document["settings"]
    return {
        **stamp(),
        "machine": f"{machine['cores']} cores, {machine['processor']}, Python {machine['python']}, "
        f"jax {machine['versions']['jax']}",
        "settings": f"{settings['repeats']} turns, {settings['limit']:g} s allowed for a call",
        "rows": rows,
    }


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    yield f"| {' | '.join(heads)} |"
    yield f"|{' --- |' * len(heads)}"
    for row in rows:
        yield f"| {' | '.join(row)} |"


def _origins(runs: Sequence[Run], of: str) -> Iterator[str]:
    rows = [[str(run.get(of, "")), run["date"], f"`{run['commit']}`", run["machine"],
             run.get("note", "")] for run in runs]  # fmt: skip
    yield from _table((of, "day", "commit", "machine", "remark"), rows)


def bench_page(found: Run) -> str:
    """The page of the bench of hidden effects."""
    runs = found["runs"]
    rows = []
    told = {name: [run["classes"].get(name) for run in runs] for name in CLASSES}
    told |= {name: [run.get("learned", {}).get(name) for run in runs] for name in LEARNED}
    said = {**{name: row[:2] for name, row in CLASSES.items()}, **LEARNED}
    for name, (words, asked) in said.items():
        right, sets = (sum(f[i] for f in told[name] if f) for i in (0, 1))
        low, high = (100.0 * end for end in wilson(right, sets))
        cells = [f"{f[0]} of {f[1]}" if f else "" for f in told[name]]
        rows.append([words, *cells, asked, f"{low:.0f} to {high:.0f} %"])
    close = [run["close"] for run in runs]
    cells = [f"{c[0]} of {c[1]}" if c else "" for c in close]
    rows.append([CLOSE, *cells, "all", ""])
    heads = ["class", *(f"seed {run['seed']}" for run in runs), "target", "share, 95 %"]
    return "\n".join(
        [
            MADE,
            "",
            "# The bench of hidden effects",
            "",
            "The bench draws a plant, hides something in it, simulates two training logs and an",
            "unseen one with sensor noise, and runs a diagnosis with the full catalogue. A set",
            "counts as right if exactly the hidden effects are named. Each seed was new to the",
            "code under test, unless the remark says otherwise. The last column is the interval",
            "of the share over all seeds (Wilson 1927).",
            "",
            *_table(heads, rows),
            "",
            *textwrap.wrap(found["notes"], 96),
            "",
            "What these figures do not cover is described in",
            "[How a diagnosis decides]"
            "(../explanation/diagnosis.md#what-these-figures-do-not-cover).",
            "",
            "## Origin",
            "",
            *_origins(runs, "seed"),
            "",
            "The commit is that of the code or, if marked so, the one that recorded the figures.",
            "The machine affects only the times. To repeat with another seed:",
            "",
            "```console",
            "$ cd tests",
            "$ python -m hidden.bench --count 216 --seed 7 --jobs 2 --out results.jsonl",
            "$ python -m benchmarks.pages --bench results.jsonl --seed 7",
            "```",
            "",
        ]
    )


def peers_page(found: Run) -> str:
    """The page of speeds beside peers."""
    lines = [
        MADE,
        "",
        "# Speed beside peers",
        "",
        "Each job by this package and by typical code with numba, CasADi, diffrax or emcee. All",
        "tools of a row take turns, each in a separate process, and their answers must agree. The",
        "table gives the time of a warm run of this package, and for the others the ratio to it:",
        "above 1 they are slower. Growth is the exponent of the time over the size; memory is that",
        "of the job beyond the imports, at the largest size.",
        "",
        "Peers are ahead for short logs: a fit of 1000 samples spends its time on checks,",
        "comparison and status, which numba and SciPy leave out. Ratios exclude the first call,",
        "which compiles.",
        "",
        *textwrap.wrap(found["notes"], 96),
        "",
    ]
    for number, run in enumerate(found["runs"], 1):
        rows, last = [], ""
        for row in run["rows"]:
            job, last = ("" if row["job"] == last else row["job"]), row["job"]
            rows.append([job, row["tool"], row["told"], row["growth"], row["memory"]])
        lines += [
            f"## Run {number}, {run['date']}",
            "",
            f"{run['machine']}; {run['settings']}; commit `{run['commit']}`{run.get('note', '')}.",
            "",
            *_table(("job, sizes", "tool", "time or ratio", "growth", "memory"), rows),
            "",
        ]
    lines += [
        "## Repeat",
        "",
        "```console",
        "$ python -m pip install -e '.[test,benchmark]'",
        "$ cd tests",
        "$ python -m benchmarks.peers --repeats 3 --limit 30 --json peers.json",
        "$ python -m benchmarks.pages --peers peers.json",
        "```",
        "",
    ]
    return "\n".join(lines)


def _turn(found: Run, side: str) -> tuple[str, str]:
    """The value at which the first decision changes, and what the answer is just past it."""
    turn = found[side]
    if turn is None:
        return "", ""
    tried = [
        f"{run['at']:.3g} ({run['kind']}): {run['changes'] or 'same answer'}"
        for run in found.get(f"again {side}", ())
    ]
    return f"{turn['value']:.4g}", "; ".join(tried) or turn["kind"]


def sweep_page(found: Run) -> str:
    """The page of settings and how far they may move."""
    lines = [
        MADE,
        "",
        "# How flat each threshold is",
        "",
        "The numbers by which a diagnosis decides stand in `diffthrust/diagnosis/_settings.py`,",
        "each with its origin. While sets of the bench are diagnosed, each comparison with such a",
        "number notes at which value of it the outcome would turn. Between the nearest of these,",
        "every decision of all sets stays, and so does every answer: there the choice is flat. The",
        "columns 'below' and 'above' name the set whose decision turns first; where sets were",
        "diagnosed again with the number moved just past that, they say what becomes of it.",
        "Numbers that only count something, or enter a sum, are not in the table.",
        "",
        *textwrap.wrap(found["notes"], 96),
        "",
    ]
    for run in found["runs"]:
        rows = []
        for name, setting in run["settings"].items():
            (low, below), (high, above) = (_turn(setting, side) for side in ("below", "above"))
            rows.append([f"`{name}`", f"{setting['value']:.4g}", low, high, below, above])
        lines += [
            f"## {run['sets']} sets of seed {run['seed']}",
            "",
            *_table(("setting", "value", "flat from", "to", "below", "above"), rows),
            "",
        ]
    return "\n".join(
        [
            *lines,
            "## Where they are from",
            "",
            *_table(
                ("seed", "sets", "version", "remark"),
                [
                    [str(run["seed"]), str(run["sets"]), run["version"], run.get("note", "")]
                    for run in found["runs"]
                ],
            ),
            "",
            "```console",
            "$ cd tests",
            "$ python -m hidden.bench --watch --count 48 --seed 7 --out results.jsonl",
            "$ python -m hidden.sweep results.jsonl --again 3 --out answers.json",
            "$ python -m benchmarks.pages --sweep answers.json --seed 7",
            "```",
            "",
        ]
    )


def rendered() -> dict[Path, str]:
    """Each page as the stored measurements give it."""
    return {
        SWEEP.with_suffix(".md"): sweep_page(taken(SWEEP)),
        BENCH.with_suffix(".md"): bench_page(taken(BENCH)),
        PEERS.with_suffix(".md"): peers_page(taken(PEERS)),
    }


def _add(where: Path, run: Run) -> None:
    found = taken(where)
    text = json.dumps({**found, "runs": [*found["runs"], run]}, indent=1, ensure_ascii=False)
    where.write_text(f"{text}\n", encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Take in what was measured, and write the pages."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.pages")
    parser.add_argument("--bench", type=Path, metavar="FILE", help="of hidden.bench --out")
    parser.add_argument("--seed", type=int, help="that --bench or --sweep was run with")
    parser.add_argument("--peers", type=Path, metavar="FILE", help="of benchmarks.peers --json")
    parser.add_argument("--sweep", type=Path, metavar="FILE", help="of hidden.sweep --out")
    options = parser.parse_args(arguments)
    if options.sweep:
        if options.seed is None:
            parser.error("--sweep needs --seed")
        _add(SWEEP, {"seed": options.seed, "version": dft.__version__, **taken(options.sweep)})
    if options.bench:
        lines = options.bench.read_text(encoding="utf-8").splitlines()
        if options.seed is None:
            parser.error("--bench needs --seed")
        _add(BENCH, of_bench([json.loads(line) for line in lines if line], options.seed))
    if options.peers:
        _add(PEERS, of_peers(json.loads(options.peers.read_text(encoding="utf-8"))))
    for path, text in rendered().items():
        path.write_text(text, encoding="utf-8")
        print(path.relative_to(ROOT))
    return 0


if __name__ == "__main__":
    sys.exit(main())
