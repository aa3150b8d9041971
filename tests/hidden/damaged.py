"""Logs with sensors held between readings, and with gaps: the same verdicts as of whole logs.

From the folder ``tests``:

    python -m hidden.damaged --seed 211 --out damaged.jsonl

draws twenty sets of the bench, diagnoses each as it is, with sensors that are read at every second
to twentieth sample, and with gaps of a tenth of each log; prints each that comes out otherwise.
Results are written as they come; the same command again goes on where it was cut.
"""

from __future__ import annotations

import argparse
import json
import time
import traceback
import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import diffthrust as dft

from . import sets

KINDS = (
    "clear/command_deadband",
    "clear/command_saturation",
    "clear/coulomb_friction",
    "clear/linear_damping",
    "clear/reverse_drive_asymmetry",
    "clear/reverse_thrust_asymmetry",
    "clear/cavitation",
    "clear/thrust_sensor_offset",
    "clear/command_offset",
    "clear/reverse_load_asymmetry",
    "none",
    "none",
    "field-none",
    "field-clear/command_deadband",
    "vessel/quadratic_surge_drag",
    "vessel/quadratic_yaw_drag",
    "vessel/rudder_offset",
    "vessel/wind",
    "vessel_none",
    "vessel_none",
)
WAYS = ("whole", "held", "gaps")
MOST = 20
LOST = 0.1


def held(log: dft.Log, every: dict[str, int], rng: np.random.Generator) -> dft.Log:
    """The log with some channels read at every so many samples, and held in between."""
    measured = dict(log.measured)
    for name, k in every.items():
        at, phase = np.arange(len(log)), int(rng.integers(k))
        measured[name] = measured[name][np.maximum((at + phase) // k * k - phase, 0)]
    return dft.Log(log.time, log.inputs, measured, name=log.name)


def with_gaps(log: dft.Log, rng: np.random.Generator) -> dft.Log:
    """The log with one to four stretches of each channel missing, a tenth of it in all."""
    measured = {name: values.copy() for name, values in log.measured.items()}
    for values in measured.values():
        shares = rng.dirichlet(np.ones(int(rng.integers(1, 5))))
        for share in shares:
            length = int(share * LOST * len(log))
            begin = int(rng.integers(len(log) - length + 1))
            values[begin : begin + length] = np.nan
    return dft.Log(log.time, log.inputs, measured, name=log.name)


def damaged(hidden: sets.HiddenSet, way: str) -> sets.HiddenSet:
    """A set whose logs are whole, held or have gaps; the same for every log of a held set."""
    if way == "whole":
        return hidden
    rng = np.random.default_rng([zlib.crc32(hidden.name.encode()), WAYS.index(way)])
    names = list(hidden.train[0].measured)
    chosen = [n for n in names if rng.random() < 0.5] or [str(rng.choice(names))]
    every = {name: int(rng.integers(2, MOST + 1)) for name in chosen}

    def change(log: dft.Log) -> dft.Log:
        return held(log, every, rng) if way == "held" else with_gaps(log, rng)

    return replace(hidden, train=tuple(map(change, hidden.train)), unseen=change(hidden.unseen))


def said_of(kind: str, seed: int, way: str) -> dict[str, Any]:
    """What a diagnosis says of a set; one that stops says why."""
    hidden = damaged(sets.draw(kind, seed), way)
    begun = time.process_time()
    row: dict[str, Any] = {"kind": kind, "seed": seed, "way": way}
    try:
        diag = dft.diagnose(hidden.model, hidden.train, holdout=hidden.unseen, experiment=False)
    except Exception:
        return {**row, "stopped": traceback.format_exc(limit=-4)}
    return {
        **row,
        "verdict": diag.verdict,
        "added": list(diag.added),
        "groups": [list(group) for group in diag.groups],
        "seconds": round(time.process_time() - begun, 1),
    }


def alike(whole: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether two diagnoses say the same: the verdict, and effects of the same groups."""
    if "stopped" in other or whole["verdict"] != other["verdict"]:
        return False
    pairs = zip(whole["added"], other["groups"], strict=False)
    return len(whole["added"]) == len(other["added"]) and all(n in group for n, group in pairs)


def main(words: Sequence[str] | None = None) -> None:
    """Read the command line, run, report."""
    parser = argparse.ArgumentParser(prog="python -m hidden.damaged", description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", nargs="*", default=list(KINDS))
    parser.add_argument("--ways", nargs="*", default=list(WAYS))
    parser.add_argument("--out", type=Path, help="JSON-lines file of results, also to go on from")
    asked = parser.parse_args(words)
    lines = asked.out.read_text().splitlines() if asked.out and asked.out.exists() else []
    rows = {(r["kind"], r["seed"], r["way"]): r for r in map(json.loads, lines)}
    tasks = [(kind, asked.seed + place) for place, kind in enumerate(asked.kinds)]
    right, count = 0, 0
    for kind, seed in tasks:
        for way in asked.ways:
            key = (kind, seed, way)
            if key not in rows:
                rows[key] = said_of(*key)
                if asked.out:
                    with asked.out.open("a") as file:
                        file.write(json.dumps(rows[key]) + "\n")
            whole, other = rows.get((kind, seed, "whole")), rows[key]
            if way == "whole" or whole is None:
                continue
            same = alike(whole, other)
            right, count = right + same, count + 1
            said = [
                {k: v for k, v in r.items() if k not in ("kind", "seed")} for r in (whole, other)
            ]
            print(kind, seed, way, "same" if same else f"OTHER: {said}", flush=True)
    print(f"{right} of {count} as without.")


if __name__ == "__main__":
    main()
