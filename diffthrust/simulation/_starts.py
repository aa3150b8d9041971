"""What is each log's own: where states begin that no sensor tells of, parameters that differ.

An initial state that is not measured is one of three. It **follows** from the parameters where the
model's `initial` says so by a free one, which all logs then share. It is **unknown** where a
measured output feels it: a fit estimates it for each of its logs, and over an unseen run it is
estimated from that run, by least squares, as `compare` of System Identification does. Any other is
of no account, and begins where the model says. The states of effects begin as the effects say:
settled at the beginning of the log; but those that an effect calls its `free_starts` (the phase of
a wave) are unknown, too.

A **parameter that differs by log** (a current, a tare) is one more unknown: a fit estimates it for
each of its logs about a mean that all share. In an unseen run it is estimated from the first part
of the run alone, so that the remainder is a prediction; where that part tells little, it stays near
the mean, by the width that the fit has found.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import jax
import numpy as np

from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Parameter
from diffthrust.models._base.signals import Signals
from diffthrust.simulation._errors import wrapped
from diffthrust.simulation._linearise import dependence, states_behind
from diffthrust.simulation._record import Record
from diffthrust.simulation._trajectory import Key, simulated_from, starting_states

_ROUNDS = 20
"""Most steps of Levenberg-Marquardt."""
_ENOUGH = 1e-6
"""They end where a step lowers the squared error by less than this share."""
_STUCK = 1e6
"""With more damping there is no way down."""
_NUDGE = 1e-4
"""Derivatives are taken by differences over this share of a state's size."""
FIRST_PART = 0.25
"""The share of an unseen run from which its own numbers are estimated: three quarters are left to
be predicted. A manoeuvre has turned through all headings in it that tell a current from a wind."""
_UNUSUAL = 3.0
"""So many widths from the mean a value by log is said to be unusual: by chance one of 370 is."""
_FAR = 10.0
"""So far from the model's own start, in sizes of the state, counts like one sample that errs by the
spread of its channel: a start that the run hardly feels stays near."""
_CLEARLY = 0.9
"""Numerics: a start beyond that is taken where it leaves less than this share of the squared error.
With masses of 1e10 kg a Kingfisher reached no more than 4e-5 rad/s, and starts of 0.1 rad/s that
halve its errors were held at nought; one that the run hardly feels lowers nothing."""


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


def told_by(model: Model, channels: Collection[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The channels that tell of states which they are not, and these: angles of a quaternion."""
    telling = model._telling(channels)
    return telling, tuple(model.start_from(dict.fromkeys(telling, 0.0))) if telling else ()


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
    """What is unknown of a run and a measured output depends on.

    Where states begin, and parameters that differ by log.
    """
    differing = tuple(n for n in model.per_log if n not in start)
    settled = {*record.inputs, *start, *record.start}
    if settled >= {*model.states, *model.free_starts}:
        return differing
    settled |= {*following(model, [record])}
    return (*(n for n in felt(model, [record]) if n not in settled), *differing)


def estimated_start(
    model: Model,
    record: Record,
    given_start: Mapping[str, float],
    names: Sequence[str],
    substeps: int,
    noise: Mapping[str, float] | None = None,
) -> dict[str, float]:
    """The numbers of its own with which a run errs least.

    Args:
        model: the model at its present values.
        record: the run.
        given_start: initial values of other states.
        names: the states that are sought, and the parameters that differ by log.
        substeps: integrator steps per sample.
        noise: standard deviation of each channel, as the fit of the model has found it.

    Returns:
        The values: least squares of the errors of all measured channels, each over its spread. With
        a parameter among them those of the first part of the run, and each parameter within its
        width about its mean: errors then count by the noise that the run states or the fit has
        found, else by what the least squares alone leave of them.
    """
    differing = [n for n in names if n in model.per_log]
    record = first_part(record) if differing else record
    key, values = Key(model), {name: p.value for name, p in model.parameters.items()}
    fixed, described = {**record.start, **given_start}, [model.parameters[n] for n in differing]
    first = len(names) - len(differing)

    def named(x: np.ndarray) -> dict[str, float]:
        own = [p.limited(p.from_coordinate(z)) for p, z in zip(described, x[first:], strict=True)]
        return dict(zip(names, map(float, [*x[:first], *own]), strict=True))

    def errors(x: np.ndarray) -> dict[str, np.ndarray]:
        path = simulated_from(key, values, record, {**fixed, **named(x)}, substeps)
        return _errors(model, record, path)

    def stacked(x: np.ndarray) -> np.ndarray:
        return _stacked(errors(x))

    begin = starting_states(model, record)
    means = [p.to_coordinate(p.value) for p in described]
    x = np.array([*(begin[n] for n in names[:first]), *means], float)
    # The size of a state is what it reaches in the run: its initial value is often zero.
    reached = simulated_from(key, values, record, {**fixed, **named(x)}, substeps)
    sizes = np.array([*(np.max(np.abs(reached[n])) for n in names[:first]), *(1.0 for _ in means)])
    size = np.where(np.isfinite(sizes) & (sizes > 0), sizes, 1.0)
    ends = np.array([*((-np.inf, np.inf) for _ in names[:first]),
                     *(p.coordinate_limits() for p in described)]).T  # fmt: skip
    x = _least_squares(stacked, x, size, _FAR * size, ends)
    # sizes of no less than one of its unit: a model that has run away moves nothing
    wide = np.where(np.arange(x.size) < first, np.maximum(size, 1.0), size)
    if np.any(wide > size):
        far = _least_squares(stacked, x, wide, _FAR * wide, ends)
        near, less = (np.sum(stacked(z) ** 2) for z in (x, far))
        x, size = (far, wide) if less < _CLEARLY * near else (x, size)
    widths = [_width(p) for p in described]
    stated = {**(noise or {}), **{n: level for n, level in record.noise.items() if level}}
    if differing and None not in widths:
        # a first part that tells nothing of a current would else give it any value
        levels = _levels(errors(x), x.size)
        levels |= {n: stated[n] / _spread(record, n) for n in levels if n in stated}
        x = _least_squares(
            lambda x: _stacked({n: e / levels[n] for n, e in errors(x).items()}),
            np.array([*x[:first], *means]),
            size,
            np.array([*_FAR * size[:first], *widths]),
            ends,
        )
    return named(x)


def first_part(record: Record) -> Record:
    """The record with the measurements of its first part alone."""
    end = record.time[0] + FIRST_PART * (record.time[-1] - record.time[0])
    measured = {
        name: np.where(record.time <= end, values, np.nan)
        for name, values in record.measured.items()
    }
    return replace(record, measured=measured)


def _width(parameter: Parameter) -> float | None:
    """The standard deviation of a parameter about its mean, in its coordinate; None before fits."""
    if parameter.width is None or parameter.transform == "log":
        return parameter.width
    return parameter.width / parameter.scale


def unusual(model: Model, name: str, value: float) -> str:
    """What is unusual about the value of a parameter in an unseen run; mostly nothing."""
    p = model.parameters[name]
    width, (low, high) = _width(p), p.coordinate_limits()
    away = p.to_coordinate(value) - p.to_coordinate(p.value)
    if min(abs(p.to_coordinate(value) - low), abs(p.to_coordinate(value) - high)) < 1e-9:
        return f"at its bound ({p.range_text()})"
    if width is not None and abs(away) > _UNUSUAL * width:
        return f"{abs(away) / width:.3g} widths from the mean {p.value:.4g}"
    return ""


@np.errstate(over="ignore", invalid="ignore")  # numbers of wrong units are reported elsewhere
def _errors(model: Model, record: Record, path: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Measured minus modelled of every channel that has measurements, over its spread."""
    errors = {}
    for name, measured in record.observed.items():
        valid = np.isfinite(measured)
        modelled = np.abs(path[name]) if name in record.unsigned else path[name]
        residual = (measured - modelled)[valid]
        residual = wrapped(residual) if name in model.angles else residual
        if residual.size:
            errors[name] = np.asarray(residual) / _spread(record, name)
    return errors


def _spread(record: Record, name: str) -> float:
    """Standard deviation of what was measured of a channel; 1 for a constant."""
    measured = record.observed[name]
    return float(np.std(measured[np.isfinite(measured)])) or 1.0


def _levels(errors: Mapping[str, np.ndarray], unknowns: int) -> dict[str, float]:
    """The noise of each channel, by the errors that so many unknowns leave; 1 where none are."""
    samples = sum(e.size for e in errors.values())
    share = max(samples - unknowns, 0) / max(samples, 1)
    return {
        n: float(np.sqrt(np.mean(e**2) / share)) or 1.0 if share else 1.0 for n, e in errors.items()
    }


def _stacked(errors: Mapping[str, np.ndarray]) -> np.ndarray:
    return np.concatenate([np.array([]), *errors.values()])


@np.errstate(over="ignore", invalid="ignore")  # of starts and steps at which the run diverges
def _least_squares(
    errors: Callable[[np.ndarray], np.ndarray],
    first: np.ndarray,
    size: np.ndarray,
    far: np.ndarray,
    ends: np.ndarray,
) -> np.ndarray:
    """Levenberg-Marquardt over a few numbers within ``ends``, by differences, from ``first``.

    By differences, for a derivative of the simulation would be another program to compile. So
    ``far`` from where it begins, a number counts like one error of one.
    """

    def residuals(y: np.ndarray) -> np.ndarray:
        return np.append(errors(first + size * y), size * y / far)

    y, damping = np.zeros(first.size), 1e-3
    low, high = (ends - first) / size
    current = residuals(y)
    for _ in range(_ROUNDS):
        nudges = np.where(y + _NUDGE > high, -_NUDGE, _NUDGE)
        slopes = np.array([(residuals(y + d) - current) / d.sum() for d in np.diag(nudges)])
        # what stands at an end and would go beyond is held
        gradient = slopes @ current
        slopes[((y <= low) & (gradient > 0)) | ((y >= high) & (gradient < 0))] = 0.0
        square, gradient, fell = slopes @ slopes.T, slopes @ current, 0.0
        square += np.diag(np.diag(square) == 0)
        while not fell and damping < _STUCK and np.isfinite(square).all():
            # Damped in proportion to the curvature (Marquardt): states in different units need no
            # scaling.
            step = np.linalg.solve(square + damping * np.diag(np.diag(square)), gradient)
            moved = np.clip(y - step, low, high)
            trial = residuals(moved)
            fell = max(0.0, 1.0 - float(trial @ trial) / (float(current @ current) or 1.0))
            damping *= 0.1 if fell > 0 else 10.0
            if fell > 0:
                y, current = moved, trial
        if not fell > _ENOUGH:
            break
    return np.clip(first + size * y, *ends)
