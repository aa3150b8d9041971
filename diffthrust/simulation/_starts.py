"""Where states begin that no sensor tells of.

An initial state that is not measured is one of three. It **follows** from the parameters where the
model's `initial` says so by a free one, which all logs then share. It is **unknown** where a
measured output feels it: a fit estimates it for each of its logs, and over an unseen run it is
estimated from that run, by least squares, as `compare` of System Identification does. Any other is
of no account, and begins where the model says. The states of effects begin as the effects say:
settled at the beginning of the log.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import jax
import numpy as np

from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Signals
from diffthrust.simulation._dependence import dependence, states_behind
from diffthrust.simulation._errors import wrapped
from diffthrust.simulation._fixed_step import simulated_from, starting_states
from diffthrust.simulation._inputs import inputs_of, measured_start
from diffthrust.simulation._remembered import remembered
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


def following(model: Model, logs: Sequence[Log]) -> tuple[str, ...]:
    """The states, measured in none of the logs, that begin as free parameters say."""
    free = tuple(name for name, p in model.parameters.items() if not p.fixed)
    if type(model).initial is Model.initial or not free:
        return ()
    inputs = tuple(sorted(inputs_of(model, logs[0])))
    said = _said(Key(model), free, inputs)
    return tuple(n for n in said if not any(n in log.measured or n in log.inputs for log in logs))


@lru_cache(256)
def _said(key: Key, free: tuple[str, ...], inputs: tuple[str, ...]) -> tuple[str, ...]:
    """The states whose initial values depend on some parameters."""
    first = Signals({**dict.fromkeys(inputs, 0.5), "time": 0.0})

    def initial(values: Mapping[str, Any]) -> dict[str, Any]:
        return dict(key.model.bind(values).initial(first))

    numbers = {name: key.model.parameters[name].value for name in free}
    names = sorted(jax.eval_shape(initial, numbers))
    reached = dependence(jax.make_jaxpr(initial)(numbers).jaxpr)
    return tuple(name for name, by in zip(names, reached, strict=True) if by)


def felt(model: Model, logs: Sequence[Log]) -> tuple[str, ...]:
    """The model's own states that any measured output feels, in their order."""
    found = set()
    for log in logs:
        inputs = tuple(sorted(inputs_of(model, log)))
        outputs = tuple(n for n in model.outputs if n in log.measured)
        found |= _behind(Key(model), inputs, outputs)
    return tuple(n for n in model.states if n in found)


@lru_cache(256)
def _behind(key: Key, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> frozenset[str]:
    states = tuple(n for n in key.model.all_states if n not in inputs)
    signals = {**dict.fromkeys(inputs, 0.5), "time": 0.0}
    return frozenset(n for o in outputs for n in states_behind(key.model, o, states, signals))


def unknown_starts(model: Model, log: Log, given: Mapping[str, float]) -> tuple[str, ...]:
    """The states that begin nobody knows where, and that a measured output feels."""
    known = {*log.inputs, *given, *measured_start(model, log)}
    if known >= {*model.states}:
        return ()
    known |= {*following(model, [log])}
    return tuple(n for n in felt(model, [log]) if n not in known)


def estimated_start(
    model: Model, log: Log, given: Mapping[str, float], names: Sequence[str], substeps: int
) -> dict[str, float]:
    """The initial values of some states with which a whole run errs least.

    Args:
        model: the model at its present values.
        log: the run.
        given: initial values of other states.
        names: the states that are sought.
        substeps: integrator steps per sample.

    Returns:
        The values: least squares of the errors of all measured channels, each over its spread.
    """
    key, values = Key(model), {name: p.value for name, p in model.parameters.items()}
    fixed = {**measured_start(model, log), **given}

    def ran(x: np.ndarray) -> dict[str, np.ndarray]:
        start = {**fixed, **dict(zip(names, map(float, x), strict=True))}
        return simulated_from(key, values, log, start, substeps)

    def search() -> dict[str, np.ndarray]:
        begin = starting_states(model, log)
        x = _least(ran, lambda path: _errors(model, log, path), {n: begin[n] for n in names})
        return {name: np.asarray(value) for name, value in zip(names, x, strict=True)}

    asked = ("start", key, *values.values(), id(log), *sorted(given.items()), *names, substeps)
    return {name: float(value) for name, value in remembered(asked, log, search).items()}


@np.errstate(over="ignore", invalid="ignore")  # numbers of wrong units are told
def _errors(model: Model, log: Log, path: Mapping[str, np.ndarray]) -> np.ndarray:
    """Measured minus modelled of every channel, over its spread."""
    rests = []
    for name, unit in model.outputs.items():
        if name in log.measured:
            theirs, ours = log.values(name, unit), path[name]
            seen = np.isfinite(theirs)
            rest = (theirs - (np.abs(ours) if name in log.unsigned else ours))[seen]
            rest = wrapped(rest) if name in model.angles else rest
            rests.append(np.asarray(rest) / (float(np.std(theirs[seen])) or 1.0))
    return np.concatenate(rests)


def _least(ran: Any, errors: Any, begin: Mapping[str, float]) -> np.ndarray:
    """Levenberg-Marquardt over a few numbers, by differences, from where the model begins."""
    first = np.array([*begin.values()], float)
    sizes = [np.max(np.abs(ran(first)[n])) for n in begin]
    size = np.array([s if np.isfinite(s) and s > 0 else 1.0 for s in sizes])

    def rests(y: np.ndarray) -> np.ndarray:
        return np.append(errors(ran(first + size * y)), y / _FAR)

    y, damping = np.zeros(first.size), 1e-3
    rest = rests(y)
    for _ in range(_ROUNDS):
        slopes = np.array([(rests(y + d) - rest) / _NUDGE for d in _NUDGE * np.eye(y.size)])
        square, against, fell = slopes @ slopes.T, slopes @ rest, 0.0
        while not fell and damping < _STUCK and np.isfinite(square).all():
            step = np.linalg.solve(square + damping * np.diag(np.diag(square)), against)
            tried = rests(y - step)
            fell = max(0.0, 1.0 - float(tried @ tried) / float(rest @ rest))
            damping *= 0.1 if fell > 0 else 10.0
            if fell > 0:
                y, rest = y - step, tried
        if not fell > _ENOUGH:
            break
    return first + size * y
