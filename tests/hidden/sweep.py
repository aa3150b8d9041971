"""How far each setting of a diagnosis may move before it decides otherwise, by sets of the bench.

    python -m hidden.bench --watch --count 48 --seed 3511 --out results.jsonl
    python -m hidden.sweep results.jsonl                # the table
    python -m hidden.sweep results.jsonl --again 3 --out answers.json

With ``--watch`` a row of the bench holds, for each setting, the nearest values at which one of its
comparisons would have come out otherwise. Between these, over all sets, every decision stays and so
does every answer. Beyond them an answer may change or not: ``--again`` runs the sets that are
nearest again, with the setting moved just past the value, and compares what is said; ``--at`` runs
one set with one value.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console
from rich.table import Table

import diffthrust as dft
from diffthrust.diagnosis._settings import SETTINGS  # private: what is swept

from . import bench
from .sweep_watch import changed, named, using

Row = dict[str, Any]
SIDES = ("below", "above")
PAST = 1e-3
"""A setting is moved past a critical value by this share of the way to it."""
IMPORTANT = (
    "screening.least_share_of_price",
    "admission.least_bic_gain",
    "admission.least_share_of_unknown",
    "admission.most_joint_growth",
    "whole_runs.negligible_share",
    "equivalence.most_bic_apart",
    "verdict.far_above_one_step",
    "verdict.repeating_share",
    "structure.false_alarms",
    "unknown_term.least_evidence",
)


class Turn(NamedTuple):
    """A value at which a decision of a set turns.

    Args:
        value: of the setting.
        kind: of the set, with its ``seed``.
        where: the function that decides.
    """

    value: float
    kind: str
    seed: int
    where: str


def turns(rows: Sequence[Row], name: str, side: str) -> list[Turn]:
    """The values of a setting at which decisions turn, the nearest of each set, nearest first."""
    at, value = SIDES.index(side), named(SETTINGS)[name]
    nearest = [
        Turn(held[0], row["kind"], row["seed"], held[1])
        for row in rows
        if (held := row.get("decisions", {}).get(name, (None, None))[at])
        if held[0] * value > 0  # a threshold of the other sign has no meaning
    ]
    return sorted(nearest, key=lambda turn: abs(turn.value - value))


def answer(diagnosis: Row | None) -> Row:
    """What of a diagnosis is an answer: not its numbers."""
    said = diagnosis or {}
    remaining = said.get("remaining") or {}
    groups = (sorted(group) for group in said.get("groups", ()))
    return {
        "verdict": said.get("verdict"),
        "added": sorted(said.get("added", ())),
        "detectable": sorted(said.get("detectable", ())),
        "groups": sorted(groups),
        "remaining": remaining.get("port"),
        "learned": [law["form"] for law in said.get("learned", ())],
        "odd_logs": sorted(log["log"] for log in said.get("odd_logs", ())),
        "held": sorted(said.get("held", ())),
    }


def difference(before: Row, after: Row) -> str:
    """What of an answer is another, in words; empty where nothing is."""
    return "; ".join(
        f"{key} {_words(value)} becomes {_words(after[key])}"
        for key, value in before.items()
        if after[key] != value
    )


def _words(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(map(_words, value)) or "nothing"
    return str(value)


def past(value: float, turn: Turn) -> float:
    """A value of a setting just past a turn."""
    return turn.value + PAST * (turn.value - value)


def tried(rows: Sequence[Row], name: str, value: float, kind: str, seed: int) -> Row:
    """A set diagnosed with another value of a setting: what of its answer changes."""
    stored = next(row for row in rows if (row["kind"], row["seed"]) == (kind, seed))
    with using(changed(**{name.replace(".", "__"): value})):
        row = bench.examine(kind, seed, partial(dft.diagnose, experiment=False), ratio=False)
    changes = difference(answer(stored["diagnosis"]), answer(row["diagnosis"]))
    return {"at": value, "kind": kind, "seed": seed, "changes": changes}


def tried_again(rows: Sequence[Row], name: str, side: str, most: int) -> list[Row]:
    """The sets nearest to a turn, diagnosed past it, until an answer changes; ``most`` of them."""
    outcomes: list[Row] = []
    for turn in turns(rows, name, side)[:most]:
        value = past(named(SETTINGS)[name], turn)
        outcomes.append(tried(rows, name, value, turn.kind, turn.seed))
        if outcomes[-1]["changes"]:
            break
    return outcomes


def swept(rows: Sequence[Row]) -> dict[str, Row]:
    """For each setting that decided anything, the range in which no decision changes."""
    return {
        name: {"value": value, **{side: _nearest(turns(rows, name, side)) for side in SIDES}}
        for name, value in named(SETTINGS).items()
        if any(name in row.get("decisions", {}) for row in rows)
    }


def _nearest(found: Sequence[Turn]) -> Row | None:
    return found[0]._asdict() if found else None


def report(rows: Sequence[Row], console: Console) -> None:
    """Print the table."""
    table = Table(title=f"Decisions of {len(rows)} sets")
    for head in ("setting", "value", "turns below", "set", "turns above", "set"):
        table.add_column(head)
    for name, found in swept(rows).items():
        cells = [name, f"{found['value']:.4g}"]
        for side in SIDES:
            turn = found[side]
            cells += [f"{turn['value']:.4g}", turn["kind"]] if turn else ["", ""]
        table.add_row(*cells)
    console.print(table)


def main(words: Sequence[str] | None = None) -> None:
    """Read the results, print the table, and run sets again where that is asked for."""
    parser = argparse.ArgumentParser(prog="python -m hidden.sweep", description=__doc__)
    parser.add_argument("results", type=Path, help="of hidden.bench --watch --out")
    parser.add_argument("--again", type=int, default=0, help="most sets to run again for each turn")
    parser.add_argument("--settings", nargs="*", default=IMPORTANT, help="to run sets again for")
    parser.add_argument(
        "--at", nargs=4, action="append", default=[], metavar=("SETTING", "VALUE", "KIND", "SEED")
    )
    parser.add_argument("--out", type=Path, help="JSON file of the table and of what changed")
    arguments = parser.parse_args(words)
    console = Console(width=150)
    lines = arguments.results.read_text(encoding="utf-8").splitlines()
    rows = [row for row in map(json.loads, filter(None, lines)) if "decisions" in row]
    found = swept(rows)
    report(rows, console)
    for name in arguments.settings if arguments.again else ():
        for side in SIDES:
            found[name][f"again {side}"] = tried_again(rows, name, side, arguments.again)
    for name, value, kind, seed in arguments.at:
        side = SIDES[float(value) > found[name]["value"]]
        outcome = tried(rows, name, float(value), kind, int(seed))
        found[name].setdefault(f"again {side}", []).append(outcome)
    for name, setting in found.items():
        for outcome in (tries for side in SIDES for tries in setting.get(f"again {side}", ())):
            changes = outcome["changes"] or "the same answer"
            console.print(f"{name} {outcome['at']:.4g}: {outcome['kind']}: {changes}")
    if arguments.out:
        document = {"sets": len(rows), "settings": found}
        arguments.out.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
