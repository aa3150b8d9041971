"""What a diagnosis of measured logs costs, each in a process of its own, from the folder ``tests``.

    python -m benchmarks.real_diagnoses                        # cold, then with the cache filled
    python -m benchmarks.real_diagnoses demo ngs --before ../../before

One row for each case: processor seconds of the process and its children, seconds on the wall, peak
of memory, memory maps at the end, compilations, verdict and effects. Cold is with an empty
compilation cache, cached right after it with the same one. ``--before`` runs another checkout by
turns. Needs the measured logs (`DIFFTHRUST_DATA`), and nothing else running.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console
from rich.table import Table

HERE = Path(__file__).resolve().parents[2]
HEADS = ("case", "version", "cache", "CPU s", "wall s", "peak MB", "maps", "compiled", "verdict")


class Case(NamedTuple):
    """Logs to diagnose, and the model to begin with."""

    model: Any
    train: Sequence[Any]
    unseen: Any


def demo() -> Case:
    """Two logs of a made-up thruster with a dead band."""
    from hidden import sets

    drawn = sets.draw("clear/command_deadband", 11)
    return Case(drawn.model, drawn.train, drawn.unseen)


def ngs() -> Case:
    """Twelve runs of a small thruster of a vehicle."""
    import diffthrust as dft

    runs = dft.datasets.ngs_thruster(("CL*",))
    return Case(dft.Thruster(), runs.train, runs.unseen)


def t200() -> Case:
    """Tables of a thruster at five voltages, as records."""
    import diffthrust as dft

    sheets = dft.datasets.t200(held=0.25).logs
    train = [log for name, log in sheets.items() if name not in ("14V", "20V")][:3]
    model = dft.Thruster(alpha=0.1, beta=600.0, ct=3.5e-4).fix("alpha")
    return Case(model, train, [sheets[name] for name in ("14V", "20V")])


def esso() -> Case:
    """Manoeuvres of a tanker's model."""
    import diffthrust as dft

    runs = dft.datasets.esso_osaka(("zigzag*", "turn*"))
    train, unseen = ([log.averaged(5) for log in logs] for logs in (runs.train, runs.unseen))
    return Case(dft.Vessel(lever_arm=1.5), train, unseen)


def blueboat() -> Case:
    """A small boat with twin thrusters."""
    import diffthrust as dft

    runs = dft.datasets.blueboat()
    train, unseen = ([log.averaged(5) for log in logs] for logs in (runs.train, runs.unseen))
    model = dft.Vessel(drive="twin", lever_arm=0.285).replace(
        m11={"value": 20.0, "bounds": (15.0, None)},
        m22={"value": 20.0, "bounds": (15.0, None)},
        i33={"value": 1.7, "fixed": True},
        d11=30.0,
        d22=30.0,
        d33={"value": 5.0, "bounds": (0.0, 20.0)},
    )
    return Case(model, train, unseen)


CASES: dict[str, Callable[[], Case]] = {
    one.__name__: one for one in (demo, ngs, t200, esso, blueboat)
}


def child(name: str) -> dict[str, Any]:
    """One diagnosis in this process, and what it cost."""
    import jax

    compiled = [0]

    def heard(event: str, seconds: float, **_: Any) -> None:
        compiled[0] += event.endswith("backend_compile_duration")

    jax.monitoring.register_event_duration_secs_listener(heard)
    begun = time.perf_counter()
    import diffthrust as dft

    case = CASES[name]()
    diag = dft.diagnose(case.model, case.train, holdout=case.unseen, experiment=False)
    wall = time.perf_counter() - begun
    own, others = (
        resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    maps = Path("/proc/self/maps")
    return {
        "cpu": sum(used.ru_utime + used.ru_stime for used in (own, others)),
        "wall": wall,
        "peak": (own.ru_maxrss + others.ru_maxrss) / 1024,
        "maps": len(maps.read_text().splitlines()) if maps.exists() else None,
        "compiled": compiled[0],
        "verdict": diag.verdict,
        "added": list(diag.added),
        "unseen": [stage.holdout.nrmse for stage in diag.stages],
    }


def measured(name: str, tree: Path, cache: str, limit: float) -> dict[str, Any]:
    """One diagnosis by the package in ``tree``; no figures where it failed or took too long."""
    paths = [str(tree), str(HERE / "tests")]
    env = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(paths),
        "JAX_COMPILATION_CACHE_DIR": cache,
        "EQX_ON_ERROR": "nan",
    }
    words = [sys.executable, "-m", "benchmarks.real_diagnoses", "--child", name]
    try:
        ran = subprocess.run(
            words, env=env, cwd=HERE / "tests", capture_output=True, text=True, timeout=limit
        )
    except subprocess.TimeoutExpired:
        return {"verdict": f"none within {limit:g} s", "added": []}
    if ran.returncode:
        return {"verdict": (ran.stderr.strip().splitlines() or ["failed"])[-1], "added": []}
    return json.loads(ran.stdout.strip().splitlines()[-1])


def by_turns(names: Sequence[str], trees: Sequence[Path], limit: float) -> list[dict[str, Any]]:
    """Each case cold and then cached, by each of the versions in turn."""
    rows = []
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            for state in ("cold", "cached"):
                for k, tree in enumerate(trees):
                    found = measured(name, tree, f"{folder}/{k}", limit)
                    version = ("now", "before")[k]
                    rows.append({"case": name, "version": version, "cache": state, **found})
                    print(f"{name} {version} {state}: {found}", file=sys.stderr, flush=True)
    return rows


def table(rows: Sequence[dict[str, Any]]) -> Table:
    """All figures, a row for each diagnosis."""
    drawn = Table(title="Diagnoses of measured logs")
    for k, head in enumerate(HEADS):
        drawn.add_column(head, justify="right" if 3 <= k <= 7 else "left")
    for row in rows:
        figures = [row.get(key) for key in ("cpu", "wall", "peak", "maps", "compiled")]
        shown = ["" if value is None else f"{value:.0f}" for value in figures]
        verdict = ": ".join(filter(None, (row["verdict"], ", ".join(row["added"]))))
        drawn.add_row(row["case"], row["version"], row["cache"], *shown, verdict)
    return drawn


def main(words: Sequence[str] | None = None) -> None:
    """Read the command line, measure, print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.real_diagnoses")
    parser.add_argument("cases", nargs="*", help=f"of {', '.join(CASES)}; all by default")
    parser.add_argument("--before", type=Path, help="another checkout, measured by turns")
    parser.add_argument("--limit", type=float, default=1800.0, help="seconds for one diagnosis")
    parser.add_argument("--json", type=Path, help="file for the figures")
    parser.add_argument("--child", choices=CASES, help=argparse.SUPPRESS)
    asked = parser.parse_args(words)
    if asked.child:
        print(json.dumps(child(asked.child)))
        return
    if unknown := {*asked.cases} - {*CASES}:
        parser.error(f"no such case: {', '.join(sorted(unknown))}")
    trees = [HERE, *([asked.before.resolve()] if asked.before else [])]
    rows = by_turns(asked.cases or list(CASES), trees, asked.limit)
    if asked.json:
        asked.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    Console(width=160).print(table(rows))


if __name__ == "__main__":
    main()
