"""Folders of small specs for the tests of campaigns, and an executor without processes."""

from __future__ import annotations

from concurrent.futures import Executor, Future
from pathlib import Path

import numpy as np
from reference import inputs, noise, thruster

SENSOR = """
model = "linear_sensor"
[logs]
train = ["train.csv"]
time = false
[channels]
depth = { column = "depth_m", unit = "m" }
reading = { column = "reading_V", unit = "V" }
"""
THRUSTER = """
model = "thruster"
[logs]
train = ["train.csv"]
holdout = ["unseen.csv"]
time = "t"
[channels]
command = { column = "u", unit = "V" }
speed = { column = "n", unit = "rad/s" }
[parameters]
alpha = { value = 0.03 }
beta = { value = 50.0 }
ct = { value = 0.02, fixed = true }
[fit]
starts = 2
"""
CANDIDATES = ["command_deadband", "actuator_lag", "coulomb_friction"]
DEADBAND = 0.25
TRUE = {"alpha": 0.037, "beta": 42.0, "ct": 0.02}


def sensor_log(path: Path, slope: float, offset: float, seed: int = 0) -> None:
    """The static readings of a depth sensor."""
    depth = np.linspace(0, 10, 12)
    reading = offset + slope * depth + 0.01 * np.random.default_rng(seed).standard_normal(12)
    rows = zip(depth, reading, strict=True)
    path.write_text("depth_m,reading_V\n" + "".join(f"{a:.6f},{b:.6f}\n" for a, b in rows))


def sensor_spec(folder: Path, slope: float, offset: float = 1.0) -> Path:
    """A spec with its log, in a folder that is made."""
    folder.mkdir(parents=True)
    sensor_log(folder / "train.csv", slope, offset)
    (folder / "fit.toml").write_text(SENSOR)
    return folder / "fit.toml"


def thruster_log(path: Path, seed: int, deadband: float, samples: int = 90) -> None:
    """A thruster under steps, from the reference simulator, with noise of its sensor."""
    rng = np.random.default_rng(seed)
    time = inputs.grid((samples - 1) * 0.1, 0.1)
    command = inputs.staircase(time, list(rng.uniform(-1.5, 1.5, 9)), 1.0)
    acting = np.sign(command) * np.maximum(np.abs(command) - deadband, 0.0)
    made = thruster.simulate(time, acting, **TRUE, method="rk4")
    speed = made.truth["speed"] + noise.ar1(rng, samples, 0.2, 0.0)
    rows = zip(time, command, speed, strict=True)
    path.write_text("t,u,n\n" + "".join(f"{a:.6f},{b:.6f},{c:.6f}\n" for a, b, c in rows))


def thruster_spec(folder: Path, seed: int) -> Path:
    """A spec with a training and an unseen log; every second thruster has a deadband."""
    folder.mkdir(parents=True)
    deadband = DEADBAND * (seed % 2)
    thruster_log(folder / "train.csv", 2 * seed, deadband)
    thruster_log(folder / "unseen.csv", 2 * seed + 1, deadband)
    (folder / "fit.toml").write_text(THRUSTER)
    return folder / "fit.toml"


class InPlace(Executor):
    """Does each task when it is submitted, and stops at some number of tasks as it is told."""

    def __init__(self, stop: int | None = None, error: BaseException | None = None) -> None:
        self.done: list[str] = []
        self.stop, self.error = stop, error

    def submit(self, fn, /, *args, **kwargs):
        if len(self.done) == self.stop and self.error:
            raise self.error
        self.done.append(args[0].name)
        future: Future = Future()
        future.set_result(fn(*args, **kwargs))
        return future
