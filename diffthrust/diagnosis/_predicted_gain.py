"""The predicted gain of effects beside a trial, by the linear response of its errors, without fits.

Next to its null an effect acts through its derivatives along the path of the trial; elsewhere,
through what it adds at its ports. The linear response (`LinearResponse`) carries this to the
errors, and a Gauss-Newton step of the effect's and all other parameters estimates what a fit would
gain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.programs import program
from diffthrust.diagnosis._linear_response import LinearResponse, promised_gain
from diffthrust.diagnosis._step_slopes import StepSlopes
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.signals import Signals
from diffthrust.simulation._integrate import integrate

_APART = 1e-4
"""Numerics: derivatives by a parameter without a null are taken over this share of its value."""

Point = Mapping[str, float]
Shift = dict[str, tuple[list[np.ndarray], ...]]
"""By port, what is added at each sample and just before the next, by batch ``(B, T)``."""


class PredictedGain(NamedTuple):
    """The predicted gain of an effect from one point.

    Args:
        gain: gain of log-likelihood after a full step.
        point: the values of its parameters.
    """

    gain: float
    point: Point


def predicted_gains(
    response: LinearResponse, effect: Effect, near: Sequence[Point], far: Sequence[Point]
) -> list[PredictedGain]:
    """The predicted gains of an effect from some points.

    Args:
        response: linear response of the trial.
        effect: the effect.
        near: points next to its null, by full names; only parameters with a null move from there.
        far: points away from the null.
    """
    probes = [_probe_at(response, effect, point, True) for point in near]
    probes += [_probe_at(response, effect, point, False) for point in far]
    changes = error_changes(response, [shift for probe in probes for shift in probe.shifts])
    out = []
    for probe in probes:
        count = len(probe.shifts)
        probe_changes, changes = (
            [change[:, :count] for change in changes],
            [change[:, count:] for change in changes],
        )
        out.append(_gain_from(response, effect, probe, probe_changes))
    return out


class _Probe(NamedTuple):
    """A point, the parameters that move from there, and the shifts to be carried to the errors.

    Away from the null the first shift is that of the effect itself. The others are its derivatives.
    """

    point: Point
    near: bool
    moved: list[str]
    shifts: list[Shift]


def acts(response: LinearResponse, effect: Effect, point: Point) -> bool:
    """Whether an effect adds anything anywhere."""
    shift = shift_of(response, effect, {n.rpartition(".")[2]: v for n, v in point.items()})
    return any(np.any(values) for parts in shift.values() for values in parts[0])


def _probe_at(response: LinearResponse, effect: Effect, point: Point, near: bool) -> _Probe:
    named = effect._parameters
    values = {name.rpartition(".")[2]: value for name, value in point.items()}
    here = shift_of(response, effect, values)
    moved = [n for n in values if not named[n].fixed and not (near and named[n].null is None)]
    shifts = [] if near else [here]
    for name in moved:
        value, scale = values[name], named[name].scale
        step = value - (named[name].null or 0.0) if near else _APART * (abs(value) or scale)
        moved_values = {**values, name: value - step if near else value + step}
        step = -step if near else step
        shifts.append(_difference(shift_of(response, effect, moved_values), here, step / scale))
    return _Probe(point, near, moved, shifts)


def _difference(shift: Shift, baseline: Shift, per: float) -> Shift:
    with np.errstate(
        invalid="ignore", over="ignore"
    ):  # values that are not finite are rejected later
        return {
            place: tuple(
                [(a - b) / per for a, b in zip(*parts, strict=True)]
                for parts in zip(shift[place], baseline[place], strict=True)
            )
            for place in shift
        }


def _gain_from(
    response: LinearResponse, effect: Effect, probe: _Probe, changes: list[np.ndarray]
) -> PredictedGain:
    nothing = PredictedGain(0.0, probe.point)
    if not all(np.all(np.isfinite(change)) for change in changes):
        return nothing
    own_change = [] if probe.near else [change[:, 0] for change in changes]
    if own_change and not any(np.any(change != 0) for change in own_change):
        return nothing
    slopes = changes if probe.near else [change[:, 1:] for change in changes]
    q = response.quadratic(slopes, own_change)
    size, movable = response.problem.shared, ~response.at_bound(q.gradient)
    for i, name in enumerate(probe.moved):
        p = effect._parameters[name]
        if probe.near and p.null is not None:  # a bound at the null blocks one direction
            slope, (low, high) = q.gradient[size + i], p.limits
            outward = (p.null <= low and slope > 0) or (p.null >= high and slope < 0)
            movable[size + i] = not outward
    if probe.near:
        gain = promised_gain(q, movable)
    else:
        names = [(effect._parameters[n], probe.point[f"{effect.name}.{n}"]) for n in probe.moved]
        ends = np.array([[(end - v) / p.scale for end in p.limits] for p, v in names])
        low, high = ends.reshape(-1, 2).T
        # the slopes of the observer's parameters hold only near the values at which it was fitted
        problem = response.problem
        movable[: len(problem.free)] &= [n not in problem.nuisance for n in problem.free]
        gain = response.cost - response.after(q, movable, slopes, own_change, (low, high))
    return PredictedGain(gain, probe.point)


def error_changes(response: LinearResponse, shifts: Sequence[Shift]) -> list[np.ndarray]:
    """The changes of the errors under some shifts of one effect, by batch ``(B, K, C, T)``."""
    shape = [(e.shape[0], len(shifts), *e.shape[1:]) for e in response.errors]
    total = [np.zeros(batch_shape) for batch_shape in shape]
    for place in shifts[0] if shifts else ():
        ends = [
            [np.stack(parts, axis=1) for parts in zip(*(s[place][i] for s in shifts), strict=True)]
            for i in (0, 1)
        ]
        change = response.to(place, *ends)
        total = [a + b for a, b in zip(total, change, strict=True)]
    return total


def shift_of(response: LinearResponse, effect: Effect, values: Point) -> Shift:
    """What an effect adds at its ports along the path."""
    effect = effect._bound(dict(values))
    out: Shift = {}
    for place in effect.ports:
        if place in response.slopes[0].places:
            parts = [added(*_seen(place, effect, s)) for s in response.slopes]
            out[place] = tuple([np.asarray(p[i]) for p in parts] for i in (0, 1))
    return out


def _seen(place: str, effect: Effect, slopes: StepSlopes) -> tuple[Any, ...]:
    """What `added` takes: an effect on an actuator of a craft sees what that actuator has.

    It is the same for each of eight thrusters, and one program serves all of them.
    """
    passings = slopes.at_samples, slopes.at_next
    values, visible = zip(*(passing.places[place] for passing in passings), strict=True)
    acting = [
        effect.acting(place, Signals({**passing.series, **seen}))
        for passing, seen in zip(passings, visible, strict=True)
    ]
    ends = [(value, dict(a.signals)) for value, a in zip(values, acting, strict=True)]
    return acting[0].port, acting[0].effect, *ends


@program(1)
def added(place: str, effect: Effect, early: Any, late: Any) -> Any:
    """What an effect adds at a port, at each sample and just before the next, ``(B, T)`` each.

    Both ends are the signal that arrives there, and what the effect may read. Compiled once for
    each port and effect.
    """
    ends = early, late
    if effect.states:
        return jax.vmap(partial(_integrated, place, effect))(*ends)

    def difference(value: Any, signals: Mapping[str, Any]) -> Any:
        return effect.at(place, value, Signals(signals)) - value

    difference = jax.vmap(difference) if effect.memory else difference
    return tuple(jnp.broadcast_to(difference(*end), end[0].shape) for end in ends)


def _integrated(place: str, effect: Effect, early: Any, late: Any) -> Any:
    """The same for an effect with states, which are integrated; the mean over a sample is exact.

    The signals hold the value that arrives at the port as "value". The state "added" integrates
    what the effect adds.
    """
    rows = [{**signals, "value": value} for value, signals in (early, late)]
    inputs = {n: (v[:-1], rows[1][n][:-1]) for n, v in rows[0].items()}
    first = Signals({n: v[0] for n, v in rows[0].items()} | dict.fromkeys(effect.states, 0.0))
    initial = {n: effect.initial(first.value, first).get(n, 0.0) for n in effect.states}

    def rates(state: Mapping[str, Any], u: Mapping[str, Any]) -> dict[str, Any]:
        s = Signals({**u, **state})
        added = effect.at(place, s.value, s) - s.value
        return {**effect.rates(s.value, s), "added": added}

    steps = jnp.diff(rows[0]["time"])
    path = integrate(rates, {**initial, "added": 0.0}, inputs, steps, {})
    s = Signals({**rows[0], **{n: path[n] for n in effect.states}})
    at_sample = effect.at(place, s.value, s) - s.value
    still = steps > 0
    mean = jnp.where(still, jnp.diff(path["added"]) / jnp.where(still, steps, 1.0), 0.0)
    return at_sample, 2.0 * jnp.append(mean, 0.0) - at_sample
