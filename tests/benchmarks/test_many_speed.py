"""A thousand logs on two cores, against numba and SciPy in a pool of two processes.

Ratios of one run, printed: ``pytest -m benchmark -s tests/benchmarks/test_many_speed.py``. Sizes
come from ``MANY_LOGS`` (1000) and ``MANY_SAMPLES`` (5000).
"""

from __future__ import annotations

import os
import resource
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import Any

import numpy as np
import pytest

import diffthrust as dft
from benchmarks.peers._numba import numba_rk4, parameters
from benchmarks.peers._problem import GUESS, TRUTH, Record
from benchmarks.test_benchmarks import show

pytestmark = pytest.mark.benchmark

LOGS = int(os.environ.get("MANY_LOGS", "1000"))
SAMPLES = int(os.environ.get("MANY_SAMPLES", "5000"))
MODEL = dft.Thruster(**dict(zip(("alpha", "beta", "ct"), GUESS, strict=True)))


def arrays(seed: int, samples: int) -> Record:
    """Time, command, speed and thrust of a thruster of its own."""
    rng = np.random.default_rng(seed)
    t = 0.01 * np.arange(samples)
    command = 1.5 * np.sin(np.cumsum(0.05 * rng.normal(size=samples)))
    truth = np.asarray(TRUTH) * rng.uniform(0.8, 1.25, 3)
    speed, thrust = numba_rk4(t, command, *truth, 0.0)
    noise = rng.normal(size=(2, samples))
    return Record(t, command, speed + 0.3 * noise[0], thrust + 0.5 * noise[1])


def log_of(i: int, t: Any, command: Any, speed: Any, thrust: Any) -> dft.Log:
    return dft.Log(t, {"command": command}, {"speed": speed, "thrust": thrust}, name=f"log{i}")


@pytest.mark.parametrize("starts", [1, 8])
def test_a_thousand_logs(starts):
    given = [arrays(i, SAMPLES) for i in range(LOGS)]
    logs = [log_of(i, *one) for i, one in enumerate(given)]
    begun = time.perf_counter()
    first = dft.many.fit(MODEL, logs[:24], starts=starts)  # compiles
    cold = time.perf_counter() - begun
    begun = time.perf_counter()
    found = dft.many.fit(MODEL, logs, starts=starts)
    ours = time.perf_counter() - begun
    begun = time.perf_counter()
    divided = dft.many.fit(MODEL, logs, starts=starts, processes=2)
    both = time.perf_counter() - begun
    assert divided[3].parameters["alpha"].value == found[3].parameters["alpha"].value
    begun = time.perf_counter()
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        list(pool.map(parameters, [arrays(0, 100)] * 4))  # compiles; the peer checks nothing
        started = time.perf_counter() - begun
        begun = time.perf_counter()
        each = partial(parameters, starts=starts)
        theirs_found = np.array(list(pool.map(each, given, chunksize=20)))
        theirs = time.perf_counter() - begun
    estimates = found.table()[["alpha", "beta", "ct"]].to_numpy()
    np.testing.assert_allclose(estimates, theirs_found, rtol=2e-4)
    singles = [dft.fit(MODEL, log, starts=starts) for log in logs[:10]]
    worst = max(
        abs(found[i].parameters[n].value / one.parameters[n].value - 1)
        for i, one in enumerate(singles)
        for n in one.parameters
    )
    assert worst < 1e-8
    assert first[3].parameters["alpha"].value == found[3].parameters["alpha"].value

    def row(what: str, one: float, other: float) -> tuple[str, ...]:
        return (what, f"{one:.2f} s", f"{other:.2f} s", f"{one / other:.2f}", "<= 0.5")

    rows = [
        row("one process, warm", ours, theirs),
        row("two processes, from their start", both, started + theirs),
        row("start and compile", cold, started),
        ("worst difference to single fits", f"{worst:.1e}", "", "", "< 1e-8"),
    ]
    title = f"{LOGS} logs of {SAMPLES} samples, {starts} start(s), against numba + SciPy x 2"
    show(title, rows, ("what", "many.fit", "peer", "ratio", "target"))


def test_time_for_a_log_is_flat():
    counts = [10, 30, 100, 300, 1000]
    logs = [log_of(i, *arrays(i, 2000)) for i in range(counts[-1])]
    dft.many.fit(MODEL, logs[:24], starts=1)
    rows = []
    for count in counts:
        begun = time.perf_counter()
        dft.many.fit(MODEL, logs[:count], starts=1, width=8)
        spent = time.perf_counter() - begun
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        rows.append(
            (str(count), f"{spent:.2f} s", f"{1e3 * spent / count:.2f} ms", f"{memory:.0f} MiB")
        )
    show(
        "many.fit of logs of 2000 samples", rows, ("logs", "wall", "per log", "most memory so far")
    )
