"""Simulate one log with many draws of the parameters, in one compiled program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.programs import program
from diffthrust.estimation._arguments import LOSSES
from diffthrust.estimation._observer import (
    Correction,
    Limits,
    Observer,
    is_memory,
    limited,
    observer_of,
)
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Signals
from diffthrust.simulation._record import Record
from diffthrust.simulation._trajectory import Grid, Key, march, read_out, trajectory
from diffthrust.uncertainty._prediction.draws import Draws

_BATCH = 8
"""Simulations per batch; more do not fit the processor's cache."""


def mean_runs(
    draws: Draws, record: Record, channels: Sequence[str], substeps: int, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """The outputs over a record by draw, without noise: ``(n, T)`` each.

    Measured states start from their first measurement plus a draw of its noise.
    """
    grid, time, inputs = _arranged(draws.model, record, substeps)
    numbers = _held(draws.values), time, inputs, _starts(draws, record, rng)
    outputs = _runs(Key(draws.model), grid, tuple(channels), *numbers)
    return {name: np.asarray(value)[:, record.original] for name, value in outputs.items()}


def random_runs(
    draws: Draws, record: Record, channels: Sequence[str], substeps: int, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Measurements predicted by an "innovations" fit: ``(n, T)`` by channel with known noise.

    The innovations form is simulated forward: errors are drawn, and correct the states by the
    estimated gains, as the errors of a recorded log would. This reproduces random forces and
    lasting sensor errors as in the training logs (Ljung 1999, section 7.3).
    """
    model = draws.model
    grid, time, inputs = _arranged(model, record, substeps)
    measured = tuple(c for c in model.outputs if c in draws.noise)
    remembering = {port for effect in model.effects if effect.memory for port in effect.ports}
    observer = observer_of(model, record, measured, remembering)
    nuisance = {
        n: draws.nuisance.get(n, np.full(len(draws), p.value if is_memory(n) else 0.0))
        for n, p in observer.parameters(record.duration, record.step).items()
    }
    law = LOSSES[draws.loss].draws(rng, (len(draws), len(measured), time.size))
    sigma = np.stack([draws.noise[c] for c in measured], axis=1)
    clip, reach = (draws.fit.limits or {}, draws.fit.reach) if draws.fit else ({}, 1.0)
    noisy = _random(
        Key(model),
        grid,
        observer,
        _held({**draws.values, **nuisance}),
        time,
        inputs,
        _starts(draws, record, rng),
        jnp.asarray(sigma[:, :, None] * law),
        jnp.asarray(np.array([c in record.unsigned for c in measured], bool)),
        Limits(*_floats([clip.get(c, np.inf) for c in measured], reach)),
    )
    return {c: np.asarray(noisy[c])[:, record.original] for c in measured if c in channels}


def _floats(*values: Any) -> tuple[Any, ...]:
    return tuple(jnp.asarray(np.asarray(value, float)) for value in values)


def _held(values: Mapping[str, np.ndarray]) -> dict[str, Any]:
    return dict(zip(values, _floats(*values.values()), strict=True))


def _arranged(model: Model, record: Record, substeps: int) -> tuple[Grid, Any, dict[str, Any]]:
    series = record.inputs_for(model)
    grid = Grid(record.holds(series), substeps, uniform=record.even)
    return grid, jnp.asarray(record.time), {n: jnp.asarray(v) for n, v in series.items()}


def _starts(draws: Draws, record: Record, rng: np.random.Generator) -> dict[str, Any]:
    """First measurements with noise; none for an unsigned sensor, which may be at rest."""
    begin = {}
    for name, value in record.start.items():
        sigma = draws.noise.get(name, np.zeros(len(draws)))
        error = 0.0 if name in record.unsigned else sigma * rng.standard_normal(len(draws))
        begin[name] = jnp.asarray(np.full(len(draws), value) + error)
    return begin


@program(3)
def _runs(
    key: Key, grid: Grid, channels: tuple[str, ...], values: Any, time: Any, inputs: Any, start: Any
) -> Any:
    def run(each: Any) -> Any:
        model = key.model.bind(each[0])
        outputs, _ = trajectory(model, grid, time, inputs, each[1], {})
        return {c: outputs[c] for c in channels}

    return jax.lax.map(run, (values, start), batch_size=_BATCH)


class _Driven(Correction):
    """An observer run forward: the drawn errors are passed in place of measurements."""

    def error(self, channel: str, modelled: Any, measured: Any, colour: Any) -> Any:
        """The drawn error."""
        return jnp.where(jnp.isnan(measured), 0.0, measured)


@program(3)
def _random(
    key: Key,
    grid: Grid,
    observer: Observer,
    values: Any,
    time: Any,
    inputs: Any,
    start: Any,
    errors: Any,
    unsigned: Any,
    limits: Limits,
) -> Any:
    def run(each: Any) -> Any:
        values, begin, error = each
        model = key.model.bind(values)
        run = _Driven(observer, model, values, time, error, unsigned, limits)
        series, path = march(model, grid, time, inputs, begin, {}, run)
        signals = {**series, "time": time}
        ahead = read_out(model, Signals({**path, **signals}))
        corrected = run.correct(path, signals, run.rows)
        after = read_out(model, Signals({**corrected, **signals}))
        out = {}
        for i, c in enumerate(observer.channels):
            if c in observer.fed:
                out[c] = ahead[c] + path[f"colour.{c}"] + error[i]
                continue
            gain, kept = values[f"noise.{c}.colour"], run.rows[f"colour.{c}"]
            out[c] = after[c] + _coloured(error[i], gain, kept, run.limit[i])
        return out

    return jax.lax.map(run, (values, start, errors), batch_size=_BATCH)


def _coloured(errors: Any, gain: Any, kept: Any, limit: Any) -> Any:
    """A sensor's autocorrelated error, from its innovations."""

    def body(colour: Any, x: Any) -> tuple[Any, Any]:
        e, keep = x
        return keep * (colour + gain * limited(e, limit)), colour + e

    return jax.lax.scan(body, jnp.zeros(()), (errors, kept))[1]
