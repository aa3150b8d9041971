"""How large the signals of a model are over logs, and effects that take their sizes from that."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache

import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.batching import padded
from diffthrust.models._base.effect import Reading
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Signals
from diffthrust.simulation._record import Record
from diffthrust.simulation._trajectory import equations_of, simulate_fixed


def with_sizes(model: Model, records: Sequence[Record]) -> Model:
    """The model with the sizes that its effects take from the logs."""
    levels = levels_when_asked(model, records)
    return model._copy(effects=tuple(effect.scaled(levels) for effect in model.effects))


def levels_when_asked(model: Model, records: Sequence[Record]) -> Callable[[], Mapping[str, float]]:
    """How large the signals of a model are, worked out at the first call: few effects ask for it.

    Of inputs, states, measured outputs, ports, what the model tells there, and "duration". States
    that a log measures are as measured, others as simulated.
    """
    return cache(lambda: levels_over([_signals(model, record) for record in records], records))


def levels_over(
    signals: Sequence[Mapping[str, np.ndarray]], records: Sequence[Record]
) -> dict[str, float]:
    """The 90th percentile of the absolute value of every signal, and the longest duration.

    Not the maximum: a spike of a sensor is no level.
    """
    shared = [name for name in signals[0] if all(name in series for series in signals)]
    pooled = {name: np.abs(np.concatenate([series[name] for series in signals])) for name in shared}
    finite = {name: values[np.isfinite(values)] for name, values in pooled.items()}
    levels = {name: float(np.quantile(v, 0.9)) for name, v in finite.items() if v.size}
    return {**levels, "duration": max(record.duration for record in records)}


def port_readings(model: Model, series: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What passes each port over a log, and what the model tells, given its inputs and states."""
    s = Signals({name: jnp.asarray(padded(value)) for name, value in series.items()})
    port = Reading(model.effects, s)
    equations_of(model, s, port)
    count, shape = series["time"].size, s["time"].shape
    readings = {name: np.asarray(value) for name, value in {**port.told, **port.seen}.items()}
    return {name: np.broadcast_to(value, shape)[:count] for name, value in readings.items()}


def _signals(model: Model, record: Record) -> dict[str, np.ndarray]:
    """Every signal of a model at the samples of a log; channels as recorded."""
    inputs = {n: record.at_samples(v) for n, v in record.inputs_for(model).items()}
    series = {"time": record.log.time, **inputs}
    series |= {n: record.recorded[n] for n in model.states if n in record.recorded}
    if any(name not in series for name in model.all_states):
        # One step per sample: the size of a signal is wanted, to a few per cent.
        modelled = simulate_fixed(model, record, None, 1)
        series = {n: v for n, v in modelled.items() if n in model.all_states} | series
    return {**record.recorded, **port_readings(model, series), **series}
