"""Seconds of a craft of eight thrusters in six degrees of freedom, against a loop in numba.

``pytest -m benchmark -s tests/benchmarks/test_craft_speed.py``. Nothing here asserts a time. The
loop integrates Fossen's equations (2021: 3.46, 4.6, quaternions by 2.85) with as many Runge-Kutta
steps of order four.
"""

from __future__ import annotations

import resource
import time

import numba
import numpy as np
import pytest
from hidden.crafts import CURVE, EIGHT
from reference import craft

import diffthrust as dft
from benchmarks.test_benchmarks import milli, show

pytestmark = pytest.mark.benchmark

STEP, SAMPLES, TURNS = 0.1, 10_000, 5
MASSES = {"m11": 17.0, "m22": 24.0, "m33": 26.0, "i44": 0.3, "i55": 0.35, "i66": 0.28}
LINEAR = {"d11": 4.0, "d22": 6.0, "d33": 5.0, "d44": 0.1, "d55": 0.1, "d66": 0.07}
QUADRATIC = {"q11": 18.0, "q22": 22.0, "q33": 37.0, "q44": 1.4, "q55": 1.6, "q66": 1.5}
WEIGHT, BUOYANCY, BELOW = 112.8, 114.8, 0.05
LAW_GAIN = CURVE["gain"]
VELOCITIES = ("surge", "sway", "heave", "roll_rate", "pitch_rate", "yaw_rate")
READ = (*VELOCITIES, "depth", "heading", "roll", "pitch")


@numba.njit
def rates(x, thrust, mass, mobility, linear, quadratic, places):
    v, q = x[:6], x[9:13]
    tau = places @ (LAW_GAIN * np.sign(thrust) * np.abs(thrust) ** 1.5)
    p = mass @ v
    force = tau - (linear + quadratic * np.abs(v)) * v
    force[:3] -= np.cross(v[3:], p[:3])
    force[3:] -= np.cross(v[3:], p[3:]) + np.cross(v[:3], p[:3])
    w, a, b, c = q
    down = np.array([2 * (a * c - w * b), 2 * (b * c + w * a), 1 - 2 * (a * a + b * b)])
    force[:3] += (WEIGHT - BUOYANCY) * down
    force[3:] += np.cross(np.array([0.0, 0.0, WEIGHT * BELOW]), down)
    out = np.empty(13)
    out[:6] = mobility @ force
    turned = np.cross(q[1:], v[:3])
    out[6:9] = v[:3] + 2 * (w * turned + np.cross(q[1:], turned))
    out[9] = -0.5 * (a * v[3] + b * v[4] + c * v[5])
    out[10:] = 0.5 * (w * v[3:] + np.cross(q[1:], v[3:]))
    return out


@numba.njit
def loop(commands, mass, mobility, linear, quadratic, places, step, substeps):
    x = np.zeros(13)
    x[9] = 1.0
    h = step / substeps
    out = np.empty((commands.shape[1], 13))
    for k in range(commands.shape[1]):
        out[k] = x
        u = np.ascontiguousarray(commands[:, k])
        for _ in range(substeps):
            k1 = rates(x, u, mass, mobility, linear, quadratic, places)
            k2 = rates(x + 0.5 * h * k1, u, mass, mobility, linear, quadratic, places)
            k3 = rates(x + 0.5 * h * k2, u, mass, mobility, linear, quadratic, places)
            k4 = rates(x + h * k3, u, mass, mobility, linear, quadratic, places)
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return out


def vehicle() -> dft.Model:
    """With the numbers that are true."""
    law = dft.actuators.StaticThruster(**CURVE)
    mounts = {name: law.at(*at) for name, at in EIGHT.items()}
    model = dft.Craft(dft.bodies.SixDegrees(), **mounts, share=[tuple(EIGHT)])
    known = {"weight": WEIGHT, "buoyancy": BUOYANCY, "z_g": BELOW}
    return model.replace({**MASSES, **LINEAR, **QUADRATIC, **known}).fix("t1.gain", "weight", "z_g")


def commands(samples: int, seed: int) -> np.ndarray:
    draws = np.random.default_rng(seed).uniform(-1.0, 1.0, (8, samples // 15 + 1))
    scale = np.array([0.6] * 4 + [0.2] * 4)[:, None]  # it does not tumble
    return scale * np.repeat(draws, 15, axis=1)[:, :samples]


def by_numba(given: np.ndarray, substeps: int) -> np.ndarray:
    centre = (0.0, 0.0, BELOW)
    columns = [
        craft.Actuator(place, lambda *_: (0.0, 0.0), pointing).columns[0]
        for place, pointing in EIGHT.values()
    ]
    body = craft.Body([*MASSES.values()], centre=centre)
    numbers = (np.array([*LINEAR.values()]), np.array([*QUADRATIC.values()]))
    places = np.ascontiguousarray(np.stack(columns, axis=1))
    return loop(given, body.mass_matrix, body.mobility, *numbers, places, STEP, substeps)


def log_of(given: np.ndarray, measured: dict[str, np.ndarray]) -> dft.Log:
    inputs = {f"{name}.command": series for name, series in zip(EIGHT, given, strict=True)}
    units = dict.fromkeys(inputs, "effort")
    return dft.Log(STEP * np.arange(given.shape[1]), inputs, measured, units=units)


def recorded(samples: int, seed: int, weak: float = 1.0) -> dft.Log:
    given = commands(samples, seed)
    plant = vehicle().replace({"t3.strength": weak})
    runs = dft.simulate(plant, log_of(given, {}), substeps=4)
    draws = np.random.default_rng(seed + 100)
    noisy = {n: runs[n] + 0.01 * draws.standard_normal(samples) for n in READ}
    return log_of(given, noisy)


def test_a_simulation_beside_a_loop_in_numba():
    model, given = vehicle(), commands(SAMPLES, 1)
    log, rows = log_of(given, {}), []
    start = time.perf_counter()
    dft.simulate(model, log, substeps=2)
    rows.append(("the first simulation, with compilation", f"{time.perf_counter() - start:.1f} s"))
    by_numba(given[:, :10], 2)
    ours, theirs = [], []
    for _ in range(TURNS):
        start = time.perf_counter()
        run = dft.simulate(model, log, substeps=2)
        ours.append(time.perf_counter() - start)
        start = time.perf_counter()
        peer = by_numba(given, 2)
        theirs.append(time.perf_counter() - start)
    apart = max(np.abs(run[n] - peer[:, k])[:50].max() for k, n in enumerate(VELOCITIES))
    rows += [
        ("simulate, 10 000 samples, two steps each", milli(min(ours))),
        ("a loop in numba, written with arrays", milli(min(theirs))),
        ("ratio (target: 1.5)", f"{min(ours) / min(theirs):.2f}"),
        ("largest difference of a velocity in 5 s", f"{apart:.1e}"),
    ]
    assert apart < 1e-4
    show("Eight thrusters, six degrees", rows, ("what", "took"))


def guessed(seed: int) -> dft.Model:
    """The vehicle with its free numbers some 15 % off."""
    draws, model = np.random.default_rng(seed), vehicle()
    free = {n: p.value for n, p in model.parameters.items() if not p.fixed}
    return model.replace({n: v * np.exp(0.15 * draws.standard_normal()) for n, v in free.items()})


def test_a_fit():
    model, logs, rows = guessed(6), [recorded(3000, seed) for seed in (2, 3, 4)], []
    for starts in (1, 8):
        start, used = time.perf_counter(), time.process_time()
        fit = dft.fit(model, logs, starts=starts)
        clock = f"{time.process_time() - used:.1f} / {time.perf_counter() - start:.1f} s"
        rows.append((f"20 numbers, 3 x 3 000, {starts} starts: {fit.status}", clock))
    show("Fit of eight thrusters (target: 20 s)", rows, ("what", "processor / clock"))


def test_a_diagnosis():
    logs = [recorded(3000, seed, weak=0.8) for seed in (2, 3)]
    start, used = time.perf_counter(), time.process_time()
    diag = dft.diagnose(guessed(6), logs, holdout=[recorded(1500, 5, weak=0.8)], experiment=False)
    clock = f"{time.process_time() - used:.1f} / {time.perf_counter() - start:.1f} s"
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    rows = [
        (f"2 x 3 000 and 1 500, one is weak: {', '.join((*diag.added, *diag.held))}", clock),
        ("peak memory", f"{most:.0f} MB"),
    ]
    show("Diagnosis of eight thrusters (target: 120 s, 1 500 MB)", rows, ("what", "took"))
