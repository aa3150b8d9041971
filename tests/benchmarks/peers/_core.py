"""The compiled core of this package, without the checks, copies and tables around it."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from problems import build, solve
from trajectories import fixed_step_module, trajectory_module

from . import _problem
from ._diffthrust import NAMES, log_of, thruster
from ._problem import GUESS, TRUTH


def simulation(samples: int) -> Any:
    log, model = log_of(_problem.record(samples)), thruster(TRUTH)
    key = trajectory_module.Key(model)
    grid = trajectory_module.Grid((("command", "zero"),), substeps=0, uniform=log.even)
    given = (
        {name: jnp.asarray(p.value) for name, p in model.parameters.items()},
        jnp.asarray(log.time),
        {"command": jnp.asarray(log.inputs["command"])},
        {"speed": jnp.asarray(0.0)},
        np.asarray(1.0),
    )

    def run(turn: int) -> np.ndarray:
        outputs, _ = jax.block_until_ready(
            fixed_step_module.compiled_simulation((key, grid), given)
        )
        return np.stack([outputs["speed"], outputs["thrust"]])

    return run


def fit(samples: int) -> Any:
    problem = build(thruster(GUESS), [log_of(_problem.record(samples))])
    start = problem.start()

    def run(turn: int) -> np.ndarray:
        values = problem.values(solve(problem, start).z)
        return np.array([values[name] for name in NAMES])

    return run
