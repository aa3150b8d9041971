"""A fit in the innovations form: its observer, its one-step predictions and what it tells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._channels import listing
from diffthrust._errors import InputError
from diffthrust._likelihood import residuals
from diffthrust._log import Log
from diffthrust._model import Model
from diffthrust._observer import CLIP, Observer, observer_of
from diffthrust._problem import Problem, channels_of
from diffthrust._result import Estimate
from diffthrust._starts import Search


def observer_for(model: Model, logs: Sequence[Log]) -> Observer:
    """The observer of a model for what the logs measure.

    Raises:
        InputError: no state is measured as it is, or the logs prescribe different states.
    """
    prescribed = {tuple(n for n in model.states if n in log.inputs) for log in logs}
    if len(prescribed) > 1:
        raise InputError(
            f"The innovations form needs logs that drive the model alike; '{model}' is given "
            f"{' and '.join(listing(names) or 'no state' for names in prescribed)} as an input.",
            "Fit these logs apart, or use likelihood='simulation'.",
        )
    channels = channels_of(model, logs)
    remembering = {port for effect in model.effects if effect.memory for port in effect.ports}
    observer = observer_of(model, logs[0], channels, remembering)
    if observer is None:
        raise InputError(
            f"The innovations form needs a measured state of '{model}': expected one of "
            f"{listing(model.states) or 'none that it has'}, found {listing(channels) or 'none'}.",
            "Map a column to one of these channels, or use likelihood='simulation'.",
        )
    return observer


def clipped(found: Search, problem: Problem) -> tuple[Search, Problem]:
    """The search carried on with errors limited to a few times what they are.

    A spike then moves the states no further than a large error does.
    """
    for _ in range(2):
        limit = jnp.asarray(CLIP * found.best.quadratic.sigma)
        problem = replace(problem, arrays={**problem.arrays, "clip": limit})
        found = found.followed(problem)
    return found, problem


def disturbance_of(problem: Problem, z: np.ndarray) -> dict[str, Estimate]:
    """The observer's gains and memories, without standard errors."""
    values = problem.values(z)
    found = {}
    for name, p in problem.nuisance.items():
        touching = any(np.isclose(values[name], end, rtol=1e-9, atol=1e-9) for end in p.limits)
        found[name] = Estimate(values[name], None, p.unit, fixed=False, at_bound=touching)
    return found


def one_step_errors(problem: Problem, z: np.ndarray) -> list[dict[str, np.ndarray]]:
    """Measured minus predicted, ``(T,)`` by log and channel; NaN where nothing was measured."""
    found: list[dict[str, np.ndarray]] = [{} for _ in problem.logs]
    passes = _residuals(problem.layout, problem.arrays, jnp.asarray(z))
    for batch, indices, rests in zip(problem.arrays["batches"], problem.order, passes, strict=True):
        rests = np.where(np.isnan(batch["measured"]), np.nan, rests)
        for row, index in enumerate(indices):
            log = problem.logs[index]
            for i, channel in enumerate(problem.layout.channels):
                if channel in log.measured:
                    found[index][channel] = rests[row, i, : len(log)]
    return found


@partial(jax.jit, static_argnums=0)
def _residuals(layout: Any, arrays: Any, z: Any) -> Any:
    """Residuals ``(B, C, T)`` of each batch of logs."""
    n, m = layout.width or len(layout.free), len(layout.starts)
    at, found = n, []
    for index, batch in enumerate(arrays["batches"]):
        count = batch["time"].shape[0]
        starts = z[at : at + count * m].reshape(count, m)
        at += count * m

        def one(log: Any, index: int = index) -> Any:
            return residuals(layout, index, arrays, log, z[:n], log["start"])

        found.append(jax.lax.map(one, {**batch, "start": starts}))
    return found
