"""This package as its users call it, with all its checks."""

from __future__ import annotations

from typing import Any

import numpy as np

import diffthrust as dft

from . import _problem
from ._problem import DRAWS, GUESS, NOISE, STARTS, TRUTH, WALKERS, WARMUP, Record

NAMES = ("alpha", "beta", "ct")


def thruster(values: Any) -> dft.Thruster:
    return dft.Thruster(**dict(zip(NAMES, values, strict=True)))


def log_of(record: Record, name: str = "log") -> dft.Log:
    measured = {"speed": record.speed, "thrust": record.thrust}
    return dft.Log(record.time, {"command": record.command}, measured, noise=NOISE, name=name)


def simulation(samples: int) -> Any:
    log, model = log_of(_problem.record(samples)), thruster(TRUTH)

    def run(turn: int) -> np.ndarray:
        found = dft.simulate(model, log, initial={"speed": 0.0}, substeps=1)
        return np.stack([found["speed"], found["thrust"]])

    return run


def fit(samples: int, starts: int = 1) -> Any:
    log, model = log_of(_problem.record(samples)), thruster(GUESS)

    def run(turn: int) -> np.ndarray:
        found = dft.fit(model, log, starts=starts, substeps=1)
        return np.array([found.parameters[name].value for name in NAMES])

    return run


def multi_start(samples: int) -> Any:
    return fit(samples, STARTS)


def posterior(samples: int) -> Any:
    log = log_of(_problem.record(samples))
    fitted = dft.fit(thruster(GUESS), log, starts=1, substeps=1)

    def run(turn: int) -> np.ndarray:
        post = dft.sample(fitted, log, draws=DRAWS, warmup=WARMUP, walkers=WALKERS, seed=turn)
        return np.stack([np.asarray(post.posterior[name]) for name in NAMES], axis=-1)

    return run


def describing_function(points: int) -> Any:
    model, grids = thruster(TRUTH), _problem.grids(points)
    return lambda turn: dft.describing_function(model, *grids).complex


def many_logs(count: int) -> Any:
    logs = [log_of(one, f"log{i}") for i, one in enumerate(_problem.many_records(count))]
    model = thruster(GUESS)

    def run(turn: int) -> np.ndarray:
        table = dft.many.fit(model, logs, starts=1, substeps=1).table()
        return table[list(NAMES)].to_numpy()

    return run
