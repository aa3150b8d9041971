"""How large the signals of a model are over logs, and effects that take their sizes from that."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache

import jax.numpy as jnp
import numpy as np

from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Signals
from diffthrust.simulation._fixed_step import simulate_fixed
from diffthrust.simulation._inputs import inputs_of
from diffthrust.simulation._linearise import Reading
from diffthrust.simulation._trajectory import equations_of


def with_sizes(model: Model, logs: Sequence[Log]) -> Model:
    """The model with the sizes that its effects take from the logs."""
    levels = levels_when_asked(model, logs)
    return model._copy(effects=tuple(effect.scaled(levels) for effect in model.effects))


def levels_when_asked(model: Model, logs: Sequence[Log]) -> Callable[[], Mapping[str, float]]:
    """How large the signals of a model are, worked out at the first call: most effects ask not.

    Of inputs, states, measured outputs, ports, what the model tells there, and "duration". States
    that a log measures are as measured, others as simulated.
    """
    return cache(lambda: levels_over([_signals(model, log) for log in logs], logs))


def levels_over(
    series: Sequence[Mapping[str, np.ndarray]], logs: Sequence[Log]
) -> dict[str, float]:
    """The 90th percentile of the absolute value of every signal, and the longest duration."""
    every = [name for name in series[0] if all(name in one for one in series)]
    pooled = {name: np.abs(np.concatenate([one[name] for one in series])) for name in every}
    seen = {name: values[np.isfinite(values)] for name, values in pooled.items()}
    levels = {name: float(np.quantile(v, 0.9)) for name, v in seen.items() if v.size}
    return {**levels, "duration": max(log.duration for log in logs)}


def port_readings(model: Model, series: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What passes each port over a log, and what the model tells, given its inputs and states."""
    s = Signals({name: jnp.asarray(value) for name, value in series.items()})
    port = Reading(model.effects, s)
    equations_of(model, s, port)
    shape, every = np.shape(series["time"]), {**port.told, **port.seen}
    return {name: np.broadcast_to(np.asarray(value), shape) for name, value in every.items()}


def _signals(model: Model, log: Log) -> dict[str, np.ndarray]:
    """Every signal of a model over a log."""
    series = {"time": log.time, **inputs_of(model, log)}
    series |= {n: log.values(n, u) for n, u in model.states.items() if n in log.measured}
    if any(name not in series for name in model.all_states):
        modelled = simulate_fixed(model, log, None, 1)
        series = {n: v for n, v in modelled.items() if n in model.all_states} | series
    measured = {n: log.values(n, u) for n, u in model.outputs.items() if n in log.measured}
    return {**measured, **port_readings(model, series), **series}
