"""What diagnoses and fits cost, each in a process of its own, from the folder ``tests``.

    python -m benchmarks.diagnoses                        # cold, then with the cache filled
    python -m benchmarks.diagnoses demo ngs --before ../../before

One row for each case: processor seconds of the process and its children, seconds on the wall, peak
of memory, memory maps at the end, traces and compilations, verdict and effects. Cold is with an
empty compilation cache, cached right after it with the same one. ``--before`` runs another checkout
by turns. Half of the cases need the measured logs (`DIFFTHRUST_DATA`), and all nothing else
running.
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
EVENTS = {"traced": "jaxpr_trace_duration", "compiled": "backend_compile_duration"}
"""What JAX tells of; a program that is read back from the cache counts as compiled, too."""
FIGURES = {"cpu": "CPU s", "wall": "wall s", "peak": "peak MB", "maps": "maps"}
FIGURES |= {name: name for name in EVENTS}
HEADS = ("case", "version", "cache", *FIGURES.values(), "verdict")


class Case(NamedTuple):
    """Logs to diagnose, or only to fit, and the model to begin with."""

    model: Any
    train: Sequence[Any]
    unseen: Any
    only_fit: bool = False


def demo() -> Case:
    """Two logs of a made-up thruster with a dead band."""
    from hidden import sets

    drawn = sets.draw("clear/command_deadband", 11)
    return Case(drawn.model, drawn.train, drawn.unseen)


def vessel() -> Case:
    """Two logs of a made-up vessel with a quadratic drag of sway."""
    from hidden import sets

    drawn = sets.draw("vessel/quadratic_sway_drag", 11)
    return Case(drawn.model, drawn.train, drawn.unseen)


def drafted() -> Case:
    """A bench as a new user logs it: 50 Hz with jitter, samples dropped, a sagging battery."""
    from hidden import users

    made = users.draw("bench", 300)
    return Case(made.model, made.train, made.unseen)


def sticking() -> Case:
    """Three logs of 1200 samples of a shaft with Stribeck friction."""
    import numpy as np

    import diffthrust as dft

    rng, step, logs = np.random.default_rng(5), 0.05, []
    for _ in range(3):
        command = np.repeat(rng.uniform(-1.0, 1.0, 60), 20)
        speed = np.zeros(command.size)
        for k in range(command.size - 1):
            w = speed[k]
            for _ in range(20):
                friction = np.tanh(w / 0.2) * (6.0 + 6.0 * np.exp(-((w / 8.0) ** 2)))
                w += step / 20 * (60.0 * command[k] - 0.03 * w * abs(w) - friction)
            speed[k + 1] = w
        measured = {
            "speed": speed + rng.normal(0.0, 0.3, speed.size),
            "thrust": 0.01 * speed * abs(speed) + rng.normal(0.0, 0.2, speed.size),
        }
        logs.append(dft.Log(step * np.arange(command.size), {"command": command}, measured))
    return Case(dft.Thruster(alpha=0.03, beta=60.0, ct=0.01), logs[:2], logs[2:])


def rates() -> Case:
    """A fit of a boat whose speed, heading and yaw rate come at 5, 10 and 50 Hz."""
    import numpy as np

    import diffthrust as dft

    rng, time = np.random.default_rng(6), 0.02 * np.arange(12_500)
    true = dft.Vessel(drive="twin", lever_arm=0.3, m11=25.0, m22=30.0, i33=2.0)
    true = true.replace({"d11": 20.0, "d22": 60.0, "d33": 4.0})
    logs = []
    for _ in range(4):
        inputs = {
            f"{side}_force": np.repeat(rng.uniform(-5.0, 20.0, 50), 250)
            for side in ("left", "right")
        }
        run = dft.simulate(true, dft.Log(time, inputs))
        measured = {}
        for name, every, noise in (
            ("surge", 10, 0.02),
            ("heading", 5, 0.01),
            ("yaw_rate", 1, 0.01),
        ):
            values = np.asarray(run[name]) + rng.normal(0.0, noise, time.size)
            measured[name] = np.where(np.arange(time.size) % every == 0, values, np.nan)
        logs.append(dft.Log(time, inputs, measured))
    given = dft.Vessel(drive="twin", lever_arm=0.3)
    return Case(given, logs, None, only_fit=True)


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
    case.__name__: case
    for case in (demo, vessel, drafted, sticking, rates, ngs, t200, esso, blueboat)
}


def child(name: str) -> dict[str, Any]:
    """One diagnosis in this process, and what it cost."""
    import jax

    counted = dict.fromkeys(EVENTS, 0)

    def heard(event: str, seconds: float, **_: Any) -> None:
        for name, ending in EVENTS.items():
            counted[name] += event.endswith(ending)

    jax.monitoring.register_event_duration_secs_listener(heard)
    begun = time.perf_counter()
    import diffthrust as dft

    case = CASES[name]()
    if case.only_fit:
        fit = dft.fit(case.model, case.train)
        outcome = {"verdict": fit.status.value, "added": [], "unseen": [fit.train.nrmse]}
    else:
        diag = dft.diagnose(case.model, case.train, holdout=case.unseen, experiment=False)
        unseen = [stage.holdout.nrmse for stage in diag.stages]
        outcome = {"verdict": diag.verdict, "added": list(diag.added), "unseen": unseen}
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
        **counted,
        **outcome,
    }


def measured(name: str, tree: Path, cache: str, limit: float) -> dict[str, Any]:
    """One diagnosis by the package in ``tree``; no figures where it failed or took too long."""
    paths = [str(tree), str(HERE / "tests")]
    # not JAX_COMPILATION_CACHE_DIR, with which JAX keeps only what took a second to compile
    env = {n: v for n, v in os.environ.items() if n != "JAX_COMPILATION_CACHE_DIR"}
    env |= {"PYTHONPATH": os.pathsep.join(paths), "DIFFTHRUST_CACHE": cache}
    words = [sys.executable, "-m", "benchmarks.diagnoses", "--child", name]
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
    drawn = Table(title="Diagnoses and fits")
    for k, head in enumerate(HEADS):
        drawn.add_column(head, justify="right" if 3 <= k < 3 + len(FIGURES) else "left")
    for row in rows:
        figures = [row.get(key) for key in FIGURES]
        shown = ["" if value is None else f"{value:.0f}" for value in figures]
        verdict = ": ".join(filter(None, (row["verdict"], ", ".join(row["added"]))))
        drawn.add_row(row["case"], row["version"], row["cache"], *shown, verdict)
    return drawn


def main(words: Sequence[str] | None = None) -> None:
    """Read the command line, measure, print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.diagnoses")
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
