"""What the examples in the docstrings of public names begin with: logs, fits and files, made once.

An example finds these names as if it had made them itself, and begins in a folder that holds
``run1.csv``, ``run2.csv`` and ``fit.toml``, the same logs as files.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import diffthrust as dft

SAMPLES, STEP = 240, 0.05
TRUTH = {"alpha": 0.037, "beta": 42.0, "ct": 0.02}
NOISE = {"speed": 0.3, "thrust": 0.2}
SPEC = """\
model = "thruster"

[logs]
train = ["run1.csv"]
holdout = ["run2.csv"]
time = { column = "time", unit = "s" }

[channels]
command = { column = "command", unit = "V" }
speed = { column = "speed", unit = "rad/s" }
thrust = { column = "thrust", unit = "N" }

[fit]
starts = 2
"""


def _made(model: dft.Model, seed: int, name: str) -> dft.Log:
    rng = np.random.default_rng(seed)
    time = STEP * np.arange(SAMPLES)
    command = np.repeat(rng.uniform(-3.0, 3.0, SAMPLES // 20), 20)
    found = dft.simulate(model, dft.Log(time, {"command": command}))
    measured = {n: found[n] + s * rng.standard_normal(SAMPLES) for n, s in NOISE.items()}
    units = {"command": "V", "speed": "rad/s", "thrust": "N"}
    return dft.Log(time, {"command": command}, measured, units=units, name=name)


@cache
def log() -> dft.Log:
    """A thruster under steps of the command, 240 samples at 20 Hz: command, speed and thrust."""
    return _made(dft.Thruster(**TRUTH), 1, "run1.csv")


@cache
def unseen() -> dft.Log:
    """Another record of the same thruster."""
    return _made(dft.Thruster(**TRUTH), 2, "run2.csv")


@cache
def fit() -> dft.estimation.Fit:
    """A thruster fitted to `log`, judged on `unseen`."""
    return dft.fit(dft.Thruster(), log(), holdout=unseen(), starts=2)


@cache
def post() -> Any:
    """A short chain of the posterior of `fit`."""
    return dft.sample(fit(), log(), draws=400, warmup=200)


@cache
def lacking() -> tuple[dft.Log, dft.Log]:
    """Two records of a thruster that ignores small commands."""
    model = dft.Thruster(**TRUTH) + dft.effects.CommandDeadband(half_width=0.4)
    return _made(model, 3, "run3.csv"), _made(model, 4, "run4.csv")


@cache
def diag() -> dft.diagnosis.Diagnosis:
    """The diagnosis of a thruster on `lacking`, with two effects to choose from."""
    train, held = lacking()
    few = ["command_deadband", "thrust_sensor_offset"]
    return dft.diagnose(dft.Thruster(), train, holdout=held, candidates=few, experiment=False)


@cache
def boat_log() -> dft.Log:
    """A small vessel with a propeller and a rudder, 20 s of a zigzag at 10 Hz."""
    time = 0.1 * np.arange(200)
    rudder = 0.3 * np.sign(np.sin(0.7 * time))
    drive = {"propeller_speed": np.full(200, 98.0), "rudder_angle": rudder}
    found = dft.simulate(dft.Vessel(), dft.Log(time, drive))
    rng = np.random.default_rng(5)
    kept = ("surge", "sway", "yaw_rate", "north", "east", "heading")
    measured = {name: found[name] + 0.01 * rng.standard_normal(200) for name in kept}
    return dft.Log(time, drive, measured, name="zigzag.csv")


@cache
def loop() -> dft.control.Loop:
    """A position controller around a thruster that pushes a vehicle."""
    return dft.control.Loop(
        thruster=dft.Thruster(ct=0.022),
        vehicle=dft.AxisVehicle(),
        controller=dft.control.PD(frequency=1.0, damping=0.707),
    )


@cache
def run() -> dft.control.LoopRun:
    """A run of `loop`: back to zero from 0.1 m away, 10 s."""
    return loop().simulate(dft.control.Step(0.0), 10.0, initial={"position": 0.1})


@cache
def mpc() -> dft.control.MPC:
    """A predictive controller for a vessel, with a short horizon."""
    return dft.control.MPC(
        model=dft.Vessel(),
        limits={"propeller_speed": (0, 150), "rudder_angle": (-0.42, 0.42)},
        rate=2.0,
        horizon=4,
        iterations=3,
    )


def sighted() -> dict[str, float]:
    """What the sensors of a vessel at rest say, half a metre to starboard of its path."""
    still = dict.fromkeys(("surge", "sway", "yaw_rate", "north", "heading"), 0.0)
    return {**still, "east": 0.5}


@cache
def track() -> dft.control.TrackRun:
    """A vessel under `mpc` along a straight path, 4 s."""
    loop = dft.control.VesselLoop(vessel=dft.Vessel(), controller=mpc())
    return loop.simulate(dft.control.StraightPath(0.8), 4.0, initial={"east": 0.5})


@cache
def fits() -> dft.many.Many:
    """Three thrusters, each fitted to two records of its own: vehicle/dive."""
    models = [dft.Thruster(**{**TRUTH, "ct": ct}) for ct in (0.019, 0.020, 0.022)]
    logs = [_made(model, 10 + 2 * i + j, "") for i, model in enumerate(models) for j in (0, 1)]
    names = [f"auv{i}/{j}" for i in range(3) for j in (0, 1)]
    return dft.many.fit(dft.Thruster(), logs, names=names, starts=2)


@cache
def fleet() -> dft.many.Fleet:
    """The fits of `fits` as a fleet."""
    at = [0.0, 1.0] * 3
    return dft.many.fleet(fits(), vehicle=lambda name: name.split("/")[0], time=at)


@cache
def held() -> dft.Log:
    """A thruster at two commands, each held for six seconds: what a static test needs."""
    time = STEP * np.arange(SAMPLES)
    bare = dft.Log(time, {"command": np.where(time < 6.0, 1.0, 2.0)})
    found = dft.simulate(dft.Thruster(**TRUTH), bare)
    return dft.Log(time, dict(bare.inputs), {name: found[name] for name in NOISE}, name="held.csv")


@cache
def manoeuvred() -> tuple[tuple[dft.Log, ...], tuple[dft.Log, ...]]:
    """Straight runs of a vessel from rest at three propeller speeds, and circles at one of them."""
    straight = tuple(_sailed(speed, 0.0) for speed in (69.2, 98.0, 120.0))
    return straight, tuple(_sailed(98.0, angle) for angle in (-16.0, 8.0, 16.0))


def _sailed(speed: float, angle: float) -> dft.Log:
    time = 0.1 * np.arange(201)
    drive = {
        "propeller_speed": np.full(201, speed),
        "rudder_angle": np.where(time >= 5.0, np.radians(angle), 0.0),
    }
    found = dft.simulate(dft.Vessel(), dft.Log(time, drive))
    return dft.Log(time, drive, {name: found[name] for name in ("surge", "sway", "yaw_rate")})


@cache
def done() -> dft.many.Campaign:
    """A campaign over one spec file, ``fit.toml``."""
    folder = Path(tempfile.mkdtemp())
    write_files(folder)
    return dft.many.campaign(folder / "fit.toml", output=folder / "results", jobs=1)


LIBRARIES = {"dft": dft, "np": np, "jnp": jnp, "plt": plt, "math": math, "Path": Path}
MADE: dict[str, Callable[[], Any]] = {
    f.__name__: f
    for f in (
        *(log, unseen, fit, post, lacking, diag, boat_log),
        *(loop, run, mpc, sighted, track, fits, fleet, held, manoeuvred, done),
    )
}


def names(wanted: Iterable[str]) -> dict[str, Any]:
    """The libraries, and those of the names made once that an example speaks of."""
    return {**LIBRARIES, **{name: MADE[name]() for name in wanted if name in MADE}}


def write_files(folder: Path) -> None:
    """The folder in which examples begin."""
    for made in (log(), unseen()):
        columns = {"time": made.time, **made.inputs, **made.measured}
        rows = (",".join(f"{v:.6g}" for v in row) for row in zip(*columns.values(), strict=True))
        (folder / made.name).write_text("\n".join([",".join(columns), *rows, ""]))
    (folder / "fit.toml").write_text(SPEC)
