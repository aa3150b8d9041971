"""What the bench's diagnoses have learned beyond the catalogue, from the folder ``tests``.

    python -m hidden.bench --kinds outside field-outside vessel_outside none --out results.jsonl
    python -m hidden.learned results.jsonl

The whole-run error of the unseen log with what was learned is held against that of the true law,
where this would halve that of the model as given; then the port, and the closed form's name. What
the true law does is that of the plant itself (the reference simulator with its true numbers,
without noise), and also that of the law with its numbers estimated from the same logs: small errors
of these grow along some runs. Where nothing is hidden nothing may be learned.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from .sets import HiddenSet, draw
from .true_laws import estimated_error

CLOSE = {False: 1.1, True: 1.2}
"""Errors are close to the plant's up to so many times it, by whether the law remembers."""
REMEMBERING = ("command_play", "motor_heating", "load_memory")
NAMES: Mapping[str, frozenset[str]] = {
    "command_play": frozenset({"linear"}),
    "motor_heating": frozenset({"linear"}),
    "load_memory": frozenset({"linear"}),
    "load_hump": frozenset({"odd humps"}),
    "brush_loss": frozenset({"saturating", "dry"}),
    "thrust_hollow": frozenset({"hump of both signs"}),
    "reverse_stall": frozenset({"step"}),
    "resistance_hump": frozenset({"odd humps"}),
    "bow_wave_turning": frozenset({"hump"}),
    "heading_ripple": frozenset({"linear"}),  # of sin(wave_number * heading + phase)
}
"""The closed forms that are right."""


class Learned(NamedTuple):
    """How what was learned of a set compares with the truth.

    Args:
        kind: of the set.
        seed: of the set.
        given: error of the unseen log with the model as given.
        halves: whether the plant itself would halve the error.
        ratio: error of the unseen log with what was learned, over that of the plant.
        close: whether that is close enough.
        estimated: the same over that of the true law, estimated; ``None`` where ``ratio`` is close.
        port: whether it acts at a right port; ``None`` where nothing was learned.
        form: whether the first closed form is right; ``None`` where nothing was learned.
        told_form: whether it, or one that is told to be as likely, is right.
        told: what was learned, in short.
    """

    kind: str
    seed: int
    given: float
    halves: bool
    ratio: float
    close: bool
    estimated: float | None
    port: bool | None
    form: bool | None
    told_form: bool | None
    told: str


def plant_error(hidden: HiddenSet) -> float:
    """NRMSE of the plant without noise against the unseen log, over all channels."""
    assert hidden.plant is not None
    true = hidden.plant.run(2).measured
    log = hidden.unseen
    squares = []
    for name, series in log.measured.items():
        seen = np.isfinite(series)
        rest = np.mean((true[name][seen] - series[seen]) ** 2)
        squares.append(rest / np.var(series[seen]))
    return float(np.sqrt(np.mean(squares)))


def judged(row: Mapping[str, Any]) -> Learned:
    """What was learned of a set of the bench, held against the truth."""
    hidden = draw(row["kind"], row["seed"])
    name = row["kind"].rpartition("/")[2]
    truth, (given, *_), last = plant_error(hidden), row["unseen"], row["unseen"][-1]
    limit = CLOSE[name in REMEMBERING]
    laws = (row["diagnosis"] or {}).get("learned", [])
    after = laws[0]["holdout"]["nrmse"] if laws else last
    told = "; ".join(f"{one['port']}: {', '.join(one['signals'])}: {one['form']}" for one in laws)
    return Learned(
        row["kind"],
        row["seed"],
        given,
        truth < 0.5 * given,
        after / truth,
        after <= limit * truth,
        None if after <= limit * truth else after / estimated_error(hidden),
        laws[0]["port"] in hidden.ports if laws else None,
        laws[0]["form"] in NAMES[name] if laws else None,
        bool(NAMES[name] & {laws[0]["form"], *laws[0]["alike"]}) if laws else None,
        told or "nothing",
    )


def shares(rows: Sequence[Mapping[str, Any]], found: Sequence[Learned]) -> dict[str, list[int]]:
    """How many are right of how many, in words, by the rows and what was learned of them."""

    def near(one: Learned) -> bool:
        name = one.kind.rpartition("/")[2]
        return one.estimated is None or one.estimated <= CLOSE[name in REMEMBERING]

    matter = [one for one in found if one.halves]
    some = [one for one in found if one.port is not None]
    empty = [row for row in rows if row["kind"].rpartition("-")[2] in ("none", "vessel_none")]
    false = [row for row in empty if (row["diagnosis"] or {}).get("learned")]
    return {
        "close to the plant, where it halves the error": [
            sum(o.close for o in matter),
            len(matter),
        ],
        "or to the true law, estimated": [sum(near(o) for o in matter), len(matter)],
        "right port, of those learned": [sum(bool(o.port) for o in some), len(some)],
        "right form, of those learned": [sum(bool(o.form) for o in some), len(some)],
        "or told as alike": [sum(bool(o.told_form) for o in some), len(some)],
        "learned where nothing is hidden": [len(false), len(empty)],
    }


def all_judged(rows: Sequence[Mapping[str, Any]]) -> list[Learned]:
    """What was learned of each set that has something hidden beyond the catalogue."""
    beyond = (row for row in rows if row["kind"].rpartition("/")[2] in NAMES and row["unseen"])
    return [judged(row) for row in beyond]


def report(rows: Sequence[Mapping[str, Any]], console: Console) -> None:
    """Print a line for each set with something hidden, then the shares."""
    table = Table("set", "as given", "with it / plant (/ law)", "port", "form", "learned")
    found = all_judged(rows)
    for one in found:
        marks = [{None: "-", True: "right", False: "wrong"}[m] for m in (one.port, one.form)]
        close = f"{one.ratio:.2f}{'' if one.close else f' ({one.estimated:.2f})'}"
        table.add_row(f"{one.kind} {one.seed}", f"{one.given:.3f}", close, *marks, one.told)
    console.print(table)
    for text, (right, of) in shares(rows, found).items():
        console.print(f"{text}: {right} of {of}")


def main() -> None:
    """Read results of the bench, print what was learned."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, nargs="+")
    lines = [
        line
        for path in parser.parse_args().results
        for line in path.read_text(encoding="utf-8").splitlines()
    ]
    report([json.loads(line) for line in lines], Console(width=150))


if __name__ == "__main__":
    main()
