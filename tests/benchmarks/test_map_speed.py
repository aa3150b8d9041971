"""Seconds of a describing-function map, against a loop of SciPy simulations.

``pytest -m benchmark -s tests/benchmarks/test_map_speed.py``. Nothing here asserts a time.
"""

from __future__ import annotations

import time

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import diffthrust as dft
from benchmarks.test_benchmarks import show
from diffthrust import effects
from diffthrust.describing import describing_function

pytestmark = pytest.mark.benchmark

SIZES = (4, 8, 16, 32, 64, 128)
TURNS = 3
SAMPLED = 4
"""The loop is run at this many amplitudes and frequencies, evenly over the map."""


def grids(size: int) -> tuple[np.ndarray, np.ndarray]:
    return np.geomspace(0.05, 10.0, size), np.geomspace(0.1, 30.0, size)


def scipy_point(a: float, w: float, most: int = 400) -> tuple[complex, int]:
    """What a user would write: period after period, until the first harmonic stays the same."""
    length = 2 * np.pi / w
    x, before = 0.0, np.inf
    for k in range(most):
        at = np.linspace(k * length, (k + 1) * length, 257)
        found = solve_ivp(
            lambda t, x: 42.0 * a * np.sin(w * t) - 0.037 * x * np.abs(x),
            (at[0], at[-1]), [x], method="LSODA", rtol=1e-6, atol=1e-8, t_eval=at,
        ).y[0]  # fmt: skip
        x = found[-1]
        thrust = 0.019 * found[:-1] * np.abs(found[:-1])
        turn = w * at[:-1]
        first = complex(2 * np.mean(thrust * (np.sin(turn) + 1j * np.cos(turn))) / a)
        if abs(first - before) < 1e-4 * abs(first):
            return first, k + 1
        before = first
    return first, most


def fastest(model: dft.Model, size: int, method: str) -> float:
    """Seconds of one map, compiled, the best of some."""
    a, w = grids(size)
    describing_function(model, a, w, method=method)
    times = []
    for _ in range(TURNS):
        start = time.perf_counter()
        found = describing_function(model, a, w, method=method)
        times.append(time.perf_counter() - start)
    assert found.settled.all()
    return min(times)


def test_seconds_of_a_map():
    start = time.perf_counter()
    describing_function(dft.Thruster(), *grids(64))
    rows = [["64 x 64, plain thruster, with compilation", f"{time.perf_counter() - start:.2f} s"]]
    models = {
        "plain thruster": dft.Thruster(),
        "with command_deadband": dft.Thruster() + effects.CommandDeadband(half_width=0.3),
        "with actuator_lag": dft.Thruster() + effects.ActuatorLag(time_constant=0.2),
    }
    for name, model in models.items():
        for method in ("simulation", "harmonic_balance"):
            took = fastest(model, 64, method)
            rows.append([f"64 x 64, {name}, {method}", f"{took:.3f} s"])
    show("Maps, compiled (target: 5 s)", [*map(tuple, rows)], ("map", "time"))


def test_cost_of_a_point_falls_with_the_size_of_the_map():
    rows = []
    for size in SIZES:
        took = fastest(dft.Thruster(), size, "simulation")
        rows.append([f"{size} x {size}", f"{took * 1e3:.1f} ms", f"{took / size**2 * 1e6:.1f} us"])
    show(
        "Cost of a point by simulation, compiled",
        [*map(tuple, rows)],
        ("map", "time", "each point"),
    )


def test_ratio_to_a_loop_of_scipy_simulations():
    a, w = grids(64)
    model = dft.Thruster()
    describing_function(model, a, w)
    picked = np.linspace(0, 63, SAMPLED).round().astype(int)
    ours, theirs, periods, apart = [], [], [], []
    for i in picked:  # in turns, so that a busy machine hurts both alike
        start = time.perf_counter()
        found = describing_function(model, a, w)
        ours.append(time.perf_counter() - start)
        for j in picked:
            start = time.perf_counter()
            first, count = scipy_point(a[i], w[j])
            theirs.append(time.perf_counter() - start)
            periods.append(count)
            apart.append(abs(first / found.complex[i, j] - 1))
    whole = float(np.mean(theirs)) * found.complex.size
    rows = [
        ["SciPy's LSODA, one point", f"{np.mean(theirs):.3f} s, {np.mean(periods):.0f} periods"],
        ["a loop over 64 x 64, extrapolated from 16 points", f"{whole:.0f} s"],
        ["describing_function, 64 x 64, measured", f"{min(ours):.3f} s"],
        ["ratio", f"{whole / min(ours):.0f}"],
        ["largest difference of the loop's answers", f"{max(apart):.1e}"],
    ]
    show("Against a loop of SciPy simulations", [*map(tuple, rows)], ("what", "found"))
