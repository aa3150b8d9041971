"""Where states begin that no sensor tells of.

An initial state that is not measured is one of three. It **follows** from the parameters where the
model's `initial` says so by a free one, which all logs then share. It is **unknown** where a
measured output feels it: a fit estimates it for each of its logs, and over an unseen run it is
estimated from that run, by least squares, as `compare` of System Identification does. Any other is
of no account, and begins where the model says. The states of effects begin as the effects say:
settled at the beginning of the log; but those that an effect calls its `free_starts` (the phase of
a wave) are unknown, too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import jax
import numpy as np

from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Signals
from diffthrust.simulation._dependence import dependence, states_behind
from diffthrust.simulation._errors import wrapped
from diffthrust.simulation._fixed_step import simulated_from, starting_states
from diffthrust.simulation._record import Record
from diffthrust.simulation._trajectory import Key

_ROUNDS = 20
"""Most steps of Levenberg-Marquardt."""
_ENOUGH = 1e-6
"""They end where a step lowers the squared error by less than this share."""
_STUCK = 1e6
"""With more damping there is no way down."""
_NUDGE = 1e-4
"""Derivatives are taken by differences over this share of a state's size."""
_FAR = 10.0
"""So far from the model's own start, in sizes of the state, counts like one sample that errs by the
spread of its channel: a start that the run hardly feels stays near."""


def following(model: Model, records: Sequence[Record]) -> tuple[str, ...]:
    """The states, measured in none of the records, that begin as free parameters say."""
    free = tuple(name for name, p in model.parameters.items() if not p.fixed)
    if type(model).initial is Model.initial or not free:
        return ()
    inputs = tuple(sorted(records[0].inputs_for(model)))
    dependent = _dependent(Key(model), free, inputs)
    recorded = {n for record in records for n in (*record.measured_states, *record.inputs)}
    return tuple(n for n in dependent if n not in recorded)


@lru_cache(256)
def _dependent(key: Key, free: tuple[str, ...], inputs: tuple[str, ...]) -> tuple[str, ...]:
    """The states whose initial values depend on some parameters."""
    first = Signals({**dict.fromkeys(inputs, 0.5), "time": 0.0})

    def initial(values: Mapping[str, Any]) -> dict[str, Any]:
        return dict(key.model.bind(values).initial(first))

    numbers = {name: key.model.parameters[name].value for name in free}
    names = sorted(jax.eval_shape(initial, numbers))
    sources = dependence(jax.make_jaxpr(initial)(numbers).jaxpr)
    return tuple(name for name, by in zip(names, sources, strict=True) if by)


def felt(model: Model, records: Sequence[Record]) -> tuple[str, ...]:
    """The states with starts of their own that any measured output depends on, in their order."""
    names: set[str] = set()
    for record in records:
        inputs = tuple(sorted(record.inputs_for(model)))
        names |= _upstream(Key(model), inputs, tuple(record.measured))
    return tuple(n for n in (*model.states, *model.free_starts) if n in names)


@lru_cache(256)
def _upstream(key: Key, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> frozenset[str]:
    """The states that some outputs depend on, directly or through others."""
    states = tuple(n for n in key.model.all_states if n not in inputs)
    signals = {**dict.fromkeys(inputs, 0.5), "time": 0.0}
    return frozenset(n for o in outputs for n in states_behind(key.model, o, states, signals))


def unknown_starts(model: Model, record: Record, start: Mapping[str, float]) -> tuple[str, ...]:
    """The states whose beginning is unknown and that a measured output depends on."""
    settled = {*record.inputs, *start, *record.start}
    if settled >= {*model.states, *model.free_starts}:
        return ()
    settled |= {*following(model, [record])}
    return tuple(n for n in felt(model, [record]) if n not in settled)


def estimated_start(
    model: Model,
    record: Record,
    given_start: Mapping[str, float],
    names: Sequence[str],
    substeps: int,
) -> dict[str, float]:
    """The initial values of some states with which a whole run errs least.

    Args:
        model: the model at its present values.
        record: the run.
        given_start: initial values of other states.
        names: the states that are sought.
        substeps: integrator steps per sample.

    Returns:
        The values: least squares of the errors of all measured channels, each over its spread.
    """
    key, values = Key(model), {name: p.value for name, p in model.parameters.items()}
    fixed = {**record.start, **given_start}

    def simulate(x: np.ndarray) -> dict[str, np.ndarray]:
        start = {**fixed, **dict(zip(names, map(float, x), strict=True))}
        return simulated_from(key, values, record, start, substeps)

    begin = starting_states(model, record)
    x = _least_squares(
        simulate, lambda path: _errors(model, record, path), {n: begin[n] for n in names}
    )
    return dict(zip(names, map(float, x), strict=True))


@np.errstate(over="ignore", invalid="ignore")  # numbers of wrong units are reported elsewhere
def _errors(model: Model, record: Record, path: Mapping[str, np.ndarray]) -> np.ndarray:
    """Measured minus modelled of every channel, over its spread."""
    errors = []
    for name, measured in record.observed.items():
        valid = np.isfinite(measured)
        modelled = np.abs(path[name]) if name in record.unsigned else path[name]
        residual = (measured - modelled)[valid]
        residual = wrapped(residual) if name in model.angles else residual
        errors.append(np.asarray(residual) / (float(np.std(measured[valid])) or 1.0))
    return np.concatenate(errors)


@np.errstate(over="ignore", invalid="ignore")  # of starts and steps at which the run diverges
def _least_squares(simulate: Any, errors: Any, begin: Mapping[str, float]) -> np.ndarray:
    """Levenberg-Marquardt over a few numbers, by differences, from where the model begins.

    By differences, for a derivative of the simulation would be another program to compile.
    """
    first = np.array([*begin.values()], float)
    # The size of a state is what it reaches in the run: its initial value is often zero.
    sizes = [np.max(np.abs(simulate(first)[n])) for n in begin]
    size = np.array([s if np.isfinite(s) and s > 0 else 1.0 for s in sizes])

    def residuals(y: np.ndarray) -> np.ndarray:
        return np.append(errors(simulate(first + size * y)), y / _FAR)

    y, damping = np.zeros(first.size), 1e-3
    current = residuals(y)
    for _ in range(_ROUNDS):
        slopes = np.array([(residuals(y + d) - current) / _NUDGE for d in _NUDGE * np.eye(y.size)])
        square, gradient, fell = slopes @ slopes.T, slopes @ current, 0.0
        while not fell and damping < _STUCK and np.isfinite(square).all():
            # Damped in proportion to the curvature (Marquardt): states in different units need no
            # scaling.
            step = np.linalg.solve(square + damping * np.diag(np.diag(square)), gradient)
            trial = residuals(y - step)
            fell = max(0.0, 1.0 - float(trial @ trial) / float(current @ current))
            damping *= 0.1 if fell > 0 else 10.0
            if fell > 0:
                y, current = y - step, trial
        if not fell > _ENOUGH:
            break
    return first + size * y
