"""Points from which an effect is tried, and its predicted gain there, without fits.

Points lie next to its null, at trial values, and near a limit's edge. A limit does nothing until a
signal reaches it: its probes climb from its lowest trial value, and the largest values that still
act are sought by bisection.

Next to its null an effect acts through its derivatives along the path of the trial; elsewhere,
through what it adds at its ports. The linear response (`LinearResponse`) carries this to the
errors, and a Gauss-Newton step of the effect's and all other parameters estimates what a fit would
gain.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.programs import program
from diffthrust.diagnosis._linear_response import LinearResponse, promised_gain
from diffthrust.diagnosis._step_slopes import StepSlopes
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.parameter import Parameter, Relative
from diffthrust.models._base.signals import Signals
from diffthrust.simulation._integrate import integrate

_MOST_PROBES = 6
"""Numerics: the largest number of probes of an effect at trial values."""
_NULL_STEP = 2e-5
"""Numerics: distance of a probe next to the null, as a share of the trial value: small enough for
the response to be linear."""
_NULL_PROBES = 24
"""Numerics: the approximate number of probes next to the null, spread over the parameters without
one."""
_LIMIT_RATIO = 1.2
"""Numerics: ratio of neighbouring probes of a limit, whose influence sets in suddenly."""
_LIMIT_PROBES = 12
"""Numerics: probes of a limit, upward from its lowest trial value."""
_BISECTIONS = 10
"""Numerics: bisections between a limit that acts and one that no signal reaches."""
_EDGE_SHARES = (0.999, 0.997, 0.99, 0.97)
"""Numerics: a limit is also tried at these shares of the lowest value that no signal reaches:
limits that cut only the peaks lie there."""
_LIMIT_POINTS = 8
"""Numerics: points between the highest probe that acts and these shares, both ends included."""
_FURTHEST = 1e4
"""Numerics: the search for a limit that no signal reaches ends at this multiple of the highest
probe that acts."""

_APART = 1e-4
"""Numerics: derivatives by a parameter without a null are taken over this share of its value."""

Point = Mapping[str, float]
Shift = dict[str, tuple[list[np.ndarray], ...]]
"""By port, what is added at each sample and just before the next, by batch ``(B, T)``."""


# -- points ----------------------------------------------------------------------------------------


def probes(
    effect: Effect, levels: Mapping[str, float]
) -> tuple[list[dict[str, float]], list[dict[str, float]]]:
    """Points from which an effect is tried: next to its null, and at trial values.

    Args:
        effect: the effect.
        levels: the level of each signal of the logs, in which trial values are given.

    Returns:
        Points next to the null, spread over the range of parameters without a null (no points where
        a null is infinite), and points at trial values.
    """
    named = effect._parameters
    tried = {}
    for name, p in named.items():
        if p.fixed:
            if p.probes:  # a form that is not estimated: all of its forms are tried
                tried[name] = list(_trial_values(p.probes, levels))
            continue
        values = _trial_values(p.probes, levels) or ((p.value,) if p.null != p.value else ())
        low, high = p.limits
        limit = np.isinf(p.null or 0.0)
        inside = [v for v in values if low <= v <= high and np.isfinite(v) and (v > 0 or not limit)]
        tried[name] = inside or [float(np.clip(p.scale, low, high))]
        if limit:
            values = tried[name]
            reach = max(_LIMIT_RATIO**_LIMIT_PROBES, 2.5 * max(values) / min(values))
            tried[name] = list(min(values) * np.geomspace(1.0, reach, _LIMIT_PROBES + 1))
    points = list(product(*tried.values()))
    if not is_limit(effect):
        points = points[:: max(1, len(points) // _MOST_PROBES)][:_MOST_PROBES]
    near: list[tuple[float, ...]] = []
    forms = [n for n in tried if named[n].fixed]  # indistinguishable next to the null
    nulls = {n: named[n].null for n in tried if n not in forms}
    if all(null is None or np.isfinite(null) for null in nulls.values()):
        count = max(1, round(_NULL_PROBES ** (1.0 / max(1, list(nulls.values()).count(None)))))
        axes = [
            _spread(tried[n], count, named[n].transform == "log")
            if null is None
            else [null + _NULL_STEP * abs(tried[n][0] - null)]
            for n, null in nulls.items()
        ]
        near = [tuple(map(float, np.clip(p, *_ends(named, nulls)))) for p in product(*axes)]

    def by_name(names: Iterable[str], values: Iterable[Sequence[float]]) -> list[dict[str, float]]:
        full = [f"{effect.name}.{n}" for n in names]
        return [dict(zip(full, point, strict=True)) for point in values]

    return by_name(nulls, near), by_name(tried, points)


def _spread(values: Sequence[float], count: int, positive: bool) -> list[float]:
    """Values over the range of the trial values and half a gap beyond each end."""
    if len(values) == 1:
        return list(values)
    at = np.log(values) if positive else np.array(values)
    gap = np.ptp(at) / (len(at) - 1)
    places = np.linspace(at.min() - gap / 2, at.max() + gap / 2, count)
    return list(np.exp(places) if positive else places)


def _ends(named: Mapping[str, Parameter], names: Iterable[str]) -> tuple[list[float], list[float]]:
    limits = [named[n].limits for n in names]
    return [low for low, _ in limits], [high for _, high in limits]


def _trial_values(
    probes: Sequence[float] | Relative, levels: Mapping[str, float]
) -> tuple[float, ...]:
    if isinstance(probes, Relative):
        level = levels.get(probes.signal, 0.0)
        return tuple(f * level**probes.power for f in probes.factors) if level > 0 else ()
    return tuple(probes)


# -- limits, which do nothing until a signal reaches them ------------------------------------------


def is_limit(effect: Effect) -> bool:
    """Whether the effect does nothing where one of its parameters is infinite."""
    return any(np.isinf(p.null or 0.0) for p in effect._parameters.values())


def limits_near_edge(
    effect: Effect, points: Sequence[Point], acting: Callable[[Point], bool]
) -> list[Point]:
    """Further probes of a limit, from the highest that acts up to the largest value that acts."""
    if not is_limit(effect) or len(points[0]) != 1:
        return []
    (key,) = points[0]
    below = max((point[key] for point in points if acting(point)), default=np.inf)
    above = below
    while above < _FURTHEST * below and acting({key: above}):
        above *= 2.0
    if not np.isfinite(below) or acting({key: above}):
        return []
    edge = edge_of(below, above, lambda value: acting({key: value}))
    between = np.geomspace(below, _EDGE_SHARES[-1] * edge, _LIMIT_POINTS)[1:-1]
    return [{key: float(value)} for value in (*between, *(edge * share for share in _EDGE_SHARES))]


def edge_of(low: float, high: float, acts: Callable[[float], bool]) -> float:
    """The largest value, about, at which a limit still acts; ``low`` acts and ``high`` does not.

    Example:
        >>> round(edge_of(1.0, 2.0, lambda value: value < 1.5), 2)
        1.5
    """
    for _ in range(_BISECTIONS):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if acts(middle) else (low, middle)
    return low


# -- the predicted gain ----------------------------------------------------------------------------


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
