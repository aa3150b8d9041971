"""The compiled core of this package, without the checks, copies and tables around it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from problems import build, solve
from trajectories import trajectory_module

import diffthrust as dft

from . import _problem
from ._diffthrust import NAMES, log_of, thruster
from ._problem import GUESS, TRUTH


def compiled_simulation(model: dft.Model, log: dft.Log, uniform: bool) -> Callable[[], Any]:
    """The compiled simulation of a thruster, with its arguments made beforehand."""
    # substeps: a number, as in a run
    grid = trajectory_module.Grid((("command", "zero"),), substeps=0, uniform=uniform)
    given = (
        {name: jnp.asarray(p.value) for name, p in model.parameters.items()},
        jnp.asarray(log.time),
        {"command": jnp.asarray(log.inputs["command"])},
        {"speed": jnp.asarray(0.0)},
        np.asarray(1.0),
    )
    program = (trajectory_module.Key(model), grid), given
    return lambda: jax.block_until_ready(trajectory_module.compiled_simulation(*program))


def simulation(samples: int) -> Any:
    log = log_of(_problem.record(samples))
    simulated = compiled_simulation(thruster(TRUTH), log, log.even)

    def run(turn: int) -> np.ndarray:
        outputs, _ = simulated()
        return np.stack([outputs["speed"], outputs["thrust"]])

    return run


def fit(samples: int) -> Any:
    problem = build(thruster(GUESS), [log_of(_problem.record(samples))])
    start = problem.start()

    def run(turn: int) -> np.ndarray:
        values = problem.values(solve(problem, start).z)
        return np.array([values[name] for name in NAMES])

    return run
