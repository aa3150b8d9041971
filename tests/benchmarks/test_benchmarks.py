"""Speed as ratios measured in one run, printed as tables: ``pytest -m benchmark -s``.

Nothing here asserts a time: the targets stand beside the figures for people to judge.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import ROOT
from problems import build, evaluate, solve
from rich.console import Console
from rich.table import Table

import diffthrust as dft
from benchmarks.peers._core import compiled_simulation
from benchmarks.peers._numba import best_fit, numba_rk4, peer_fit
from benchmarks.peers._problem import GUESS, TRUTH, guesses, record
from diffthrust.effects import ActuatorLag, CommandDeadband, ReverseThrustAsymmetry

pytestmark = pytest.mark.benchmark


def make_log(count: int = 10_000, seed: int = 0) -> dft.Log:
    """A log of the thruster with white sensor noise."""
    t, command, speed, thrust = record(count, seed)
    return dft.Log(t, {"command": command}, {"speed": speed, "thrust": thrust})


def interleaved(*jobs: Callable[[], Any], repeats: int = 21) -> list[float]:
    """Median seconds of each job; the jobs take turns, so that a busy machine hurts all alike."""
    for job in jobs:
        job()
    times = np.empty((repeats, len(jobs)))
    for row in times:
        for i, job in enumerate(jobs):
            begin = time.perf_counter()
            job()
            row[i] = time.perf_counter() - begin
    return list(np.median(times, axis=0))


def show(title: str, rows: list[tuple[str, ...]], header: tuple[str, ...]) -> None:
    """Print a table."""
    table = Table(title=title, title_justify="left")
    for i, name in enumerate(header):
        table.add_column(name, justify="left" if i == 0 else "right")
    for row in rows:
        table.add_row(*row)
    Console(width=110).print(table)


def milli(seconds: float) -> str:
    return f"{1e3 * seconds:.2f} ms"


RATIO = ("what", "diffthrust", "peer", "ratio", "target")


def ratio_row(what: str, ours: float, peer: float, target: str = "") -> tuple[str, ...]:
    return (what, milli(ours), milli(peer), f"{ours / peer:.2f}", target)


def test_simulation_and_fit_of_one_log():
    log = make_log()
    model = dft.Thruster()
    ours, whole, peer = interleaved(
        compiled_simulation(model, log, uniform=False),
        lambda: dft.simulate(model, log, substeps=1),
        lambda: numba_rk4(log.time, log.inputs["command"], *TRUTH, 0.0),
        repeats=101,
    )
    rows = [
        ratio_row("simulation, compiled, against numba RK4", ours, peer, "<= 1.5"),
        ratio_row("simulate() with its checks and copies", whole, peer),
    ]
    guess = model.replace(dict(zip(("alpha", "beta", "ct"), GUESS, strict=True)))
    problem = build(guess, [log])
    start = problem.start()
    solved = solve(problem, start)
    assert solved.done
    found = list(problem.values(solved.z).values())
    np.testing.assert_allclose(found, peer_fit(record(10_000)).x[:3], rtol=1e-4)
    given = record(10_000)
    ours, peer = interleaved(lambda: solve(problem, start), lambda: peer_fit(given), repeats=11)
    rows.append(ratio_row("fit, one start, against numba RK4 + SciPy", ours, peer, "<= 1"))
    show("Thruster, 10 000 samples, float64, one log", rows, RATIO)


def test_sixty_four_starts():
    log, given = make_log(), record(10_000)
    model = dft.Thruster(**dict(zip(("alpha", "beta", "ct"), GUESS, strict=True)))

    def peers():
        return best_fit(given, guesses(64))

    ours, peer = interleaved(lambda: dft.fit(model, log, starts=64, substeps=1), peers, repeats=3)
    rows = [ratio_row("fit(starts=64) against 64 fits of the peer", ours, peer, "<= 0.5")]
    show("Multi-start", rows, RATIO)


def test_where_the_time_of_a_fit_goes():
    log = make_log()
    plain = dft.Thruster(**dict(zip(("alpha", "beta", "ct"), GUESS, strict=True)))
    models = {
        "thruster": plain,
        "+ actuator_lag": plain + ActuatorLag(),
        "+ three effects": plain + ActuatorLag() + CommandDeadband() + ReverseThrustAsymmetry(),
    }
    compiled = jax.jit(evaluate, static_argnums=0)
    rows = []
    for name, model in models.items():
        problem = build(model, [log])
        z = jnp.asarray(problem.start())
        steps = solve(problem, problem.start()).steps
        run, once, fit = interleaved(
            lambda model=model: dft.simulate(model, log, substeps=1),
            lambda p=problem, z=z: jax.block_until_ready(compiled(p.layout, p.numbers, z)),
            lambda p=problem: solve(p, p.start()),
            repeats=7,
        )
        rows.append((name, milli(run), milli(once), milli(fit), str(steps), milli(fit / steps)))
    header = ("model", "simulate()", "cost and Jacobian", "fit", "steps", "per step")
    show("Where the time goes, 10 000 samples", rows, header)


LONG = """
import os, sys, time
import numpy as np
import diffthrust as dft
from diffthrust.estimation._arrange import build  # private: the solver by itself
from diffthrust.estimation._solver import solve  # private: the solver by itself
from diffthrust.simulation._record import bind  # private: logs as a fit reads them
n = int(sys.argv[1])
rng = np.random.default_rng(0)
t = 0.01 * np.arange(n)
c = 1.5 * np.sin(np.cumsum(0.05 * rng.normal(size=n)))
log = dft.Log(t, {"command": c}, {})
found = dft.simulate(dft.Thruster(), log, substeps=1)
noisy = {k: found[k] + s * rng.normal(size=n) for k, s in (("speed", 0.3), ("thrust", 0.5))}
log = dft.Log(t, {"command": c}, noisy)
model = dft.Thruster(alpha=0.03, beta=35.0, ct=0.015)
p = build(model, bind(model, [log]))
solve(p, p.start())
begin = time.perf_counter()
done = solve(p, p.start())
took = time.perf_counter() - begin
assert done.done
peak = 0.0
if os.path.exists("/proc/self/status"):  # the system's own figure counts the parent in
    text = open("/proc/self/status").read()
    peak = int(text.split("VmHWM:")[1].split()[0]) / 1024
print(took, done.steps, peak)
"""


def test_cost_and_memory_against_length():
    rows = []
    for count in (1_000, 10_000, 100_000, 1_000_000):
        command = [sys.executable, "-c", LONG, str(count)]
        text = subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT).stdout
        seconds, steps, peak = (float(word) for word in text.split())
        per = seconds / steps / count
        rows.append((f"{count:,}", milli(seconds), f"{1e9 * per:.0f} ns", f"{peak:.0f} MiB"))
    header = ("samples", "fit", "per sample and step", "peak memory (2048 MiB allowed)")
    show("Cost against length", rows, header)


def process_time(code: list[str], env: dict[str, str] | None = None) -> float:
    begin = time.perf_counter()
    subprocess.run(
        [sys.executable, *code],
        check=True,
        capture_output=True,
        cwd=ROOT,
        env={**os.environ, **(env or {})},
    )
    return time.perf_counter() - begin


def test_processes_from_cold(tmp_path):
    jax_alone = [process_time(["-c", "import jax"]) for _ in range(5)]
    import_all = "import jax, diffthrust as dft; [getattr(dft, name) for name in dft.__all__]"
    package = [process_time(["-c", import_all]) for _ in range(5)]
    gap = float(np.median(package) - np.median(jax_alone))
    rows = [("every name at the door over import jax", f"{gap:.2f} s", "< 0.7 s")]
    spec = ROOT / "fits" / "jason_thruster" / "fit.toml"
    entry = "import sys; from diffthrust.cli._app import main; sys.exit(main())"
    if spec.exists():
        env = {"DIFFTHRUST_CACHE": str(tmp_path / "cache")}
        command = ["-c", entry, "fit", str(spec)]
        rows.append(("diffthrust fit, first time", f"{process_time(command, env):.2f} s", "< 6 s"))
        warm = min(process_time(command, env) for _ in range(3))
        rows.append(("diffthrust fit, compilation cached", f"{warm:.2f} s", "< 3 s"))
    show("Processes", rows, ("what", "time", "target"))
    assert gap > 0.0
