"""Which candidates are worth a fit beside the current model, and their first fits.

Each effect has probes: points next to its null, and points at trial values (`probes`). The linear
response of the current trial predicts at almost no cost what the effect gains from each of them
(`shortlist`). The candidates with the largest predicted gains are fitted for a few steps from their
best probes (`screened`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit, side_by_side
from diffthrust.diagnosis._linear_response import LinearResponse, promised_gain
from diffthrust.diagnosis._predicted_gain import (
    IDLE_CHANGE,
    Point,
    PredictedGain,
    acts,
    predicted_gains,
)
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.estimation._one_step import batch_passes
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.parameter import Parameter, Relative
from diffthrust.simulation._levels import levels_over

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
_DIFFERENCE_STEP = 1e-4
"""Numerics: step of the differences by a fixed parameter, as a share of its scale."""
_FIRST_STEPS = 6
"""Numerics: steps from each of the best probes, before it is known which effects matter."""
_THRESHOLD_STEPS = 20
"""Numerics: steps across a threshold, where a search creeps."""
_AT_NULL = 1e-6
"""Numerics: an effect closer to its null than this, in units of its scale, does nothing."""
_LARGEST_RISE = 0.25
"""Numerics: a probe that raises the cost by more than this times the number of samples is no start
of a search."""

# -- the fits of the most promising candidates -----------------------------------------------------


def screened(
    fitter: CandidateFitter,
    names: Sequence[str],
    present: TrialFit,
    levels: Mapping[str, float],
    fallback: Mapping[str, float] | None = None,
    least: float = 0.0,
) -> dict[str, TrialFit]:
    """The current model with each of some candidates, fitted for a few steps from its best probes.

    Args:
        fitter: the fits.
        names: the candidates.
        present: the current model.
        levels: `levels_of` the signals.
        fallback: values of the model's parameters from which probes are tried as well.
        least: likelihood ratio that a candidate must promise.

    Returns:
        Trials by name, without the candidates that gain too little.
    """
    effects = [name for name in names if name not in fitter.constants]
    points = {name: probes(fitter.candidates[name], levels) for name in effects}
    constants = [name for name in names if name in fitter.constants]
    promised, later = shortlist(fitter, present, points, constants, least)
    names = list(promised)
    if names:
        fitter.ready(present.effects, names, later)

    def fitted(name: str) -> TrialFit | None:
        if name in fitter.constants:
            effects = (*present.effects, name)
            best = fitter.solve(
                effects, present.values, present.initial_states, present.clip, _FIRST_STEPS
            )
        else:
            best = _effect_fit(fitter, name, present, promised[name], points[name][1], fallback)
        early = SETTINGS.screening.least_early_gain
        return best if best and 2 * (present.cost - best.expected) > early else None

    ends = zip(names, side_by_side(fitted, names), strict=True)
    return {name: trial for name, trial in ends if trial is not None}


def _effect_fit(
    fitter: CandidateFitter,
    name: str,
    present: TrialFit,
    near: Sequence[PredictedGain],
    far: Sequence[Point],
    fallback: Point | None,
) -> TrialFit | None:
    """The best fit of an effect from the two best of all its probes."""
    effects = (*present.effects, name)

    def followed(point: Point, budget: int) -> TrialFit:
        values = {**present.values, **point}
        return fitter.solve(effects, values, present.initial_states, present.clip, budget)

    # next to the null the errors do not depend on a place or a direction: these parameters wait
    # until the effect has a size
    waiting = {
        f"{name}.{n}"
        for n, p in fitter.candidates[name]._parameters.items()
        if p.null is None and not p.fixed
    }

    def risen(point: Point, budget: int) -> TrialFit:
        if not waiting:
            return followed(point, budget)
        values, start = {**present.values, **point}, present.initial_states
        sized = fitter.solve(effects, values, start, present.clip, _FIRST_STEPS, still=waiting)
        return fitter.solve(effects, sized.values, sized.initial_states, sized.clip, budget)

    def gain(expected: float) -> float:
        return 2 * (present.cost - expected)

    least = SETTINGS.screening.least_promise
    starts = [(present.cost - promise.gain, promise.point) for promise in near]
    distant = _best_distant(fitter, name, present, far, followed)
    silent = all(gain(expected) < SETTINGS.screening.threshold_promise for expected, _ in starts)
    if distant and silent:
        distant[0] = (min(distant[0][0], present.cost - least), distant[0][1])
    starts = [pair for pair in starts + distant if gain(pair[0]) >= least]
    starts = sorted(starts, key=lambda pair: pair[0])[:2]
    budget = _THRESHOLD_STEPS if silent else _FIRST_STEPS
    ends = [risen(point, budget) for _, point in starts]
    if fallback is not None:
        ends += fitted_from_fallback(fitter, name, present, far, fallback)
    return min(ends, key=lambda trial: trial.expected, default=None)


def _best_distant(
    fitter: CandidateFitter,
    name: str,
    present: TrialFit,
    points: Sequence[Point],
    followed: Callable[[Point, int], TrialFit],
) -> list[tuple[float, Point]]:
    """The two points of least cost far from the null, each with the cost that one step predicts."""
    effects = (*present.effects, name)

    def cost(point: Point) -> float:
        values = {**present.values, **point}
        return fitter.cost(effects, values, present.initial_states, present.clip)

    def moves(cost: float) -> bool:
        return abs(cost - present.cost) > IDLE_CHANGE

    tried = [(cost(point), point) for point in points]
    more = limits_near_edge(fitter.candidates[name], points, lambda point: moves(cost(point)))
    tried += [(cost(point), point) for point in more]
    highest = present.cost + _LARGEST_RISE * fitter.samples  # NaN and infinite costs fail the test
    tried = [(at, point) for at, point in tried if moves(at) and at < highest]
    chosen = sorted(tried, key=lambda pair: pair[0])[:2]
    return [(followed(point, 1).expected, point) for _, point in chosen]


def fitted_from_fallback(
    fitter: CandidateFitter,
    name: str,
    present: TrialFit,
    points: Sequence[Point],
    fallback: Point,
) -> list[TrialFit]:
    """A fit from the best point far from the null, with the model's parameters at ``fallback``.

    The fit of a model that lacks a large effect may have ended at values that hide this effect.
    """
    effects, values = (*present.effects, name), {**present.values, **fallback}
    limit = present.clip
    tried = [(fitter.cost(effects, {**values, **point}, None, limit), point) for point in points]
    tried = [pair for pair in tried if np.isfinite(pair[0])]
    cost, point = min(tried, key=lambda pair: pair[0], default=(np.inf, {}))
    without = fitter.cost(effects, values, None, limit)
    if 2 * (without - cost) < SETTINGS.screening.least_promise or not tried:
        return []
    return [fitter.solve(effects, {**values, **point}, None, limit, _THRESHOLD_STEPS)]


# -- what the linear response predicts -------------------------------------------------------------


def shortlist(
    fitter: CandidateFitter,
    present: TrialFit,
    points: Mapping[str, tuple[Sequence[Point], Sequence[Point]]],
    constants: Sequence[str] = (),
    least: float = 0.0,
) -> tuple[dict[str, list[PredictedGain]], list[str]]:
    """The candidates that are worth a fit, and the remaining effects, by falling predicted gain.

    The first come with their predictions at the points next to the null.

    Args:
        fitter: the fits.
        present: the current model.
        points: of each effect, next to the null and far from it.
        constants: fixed parameters, each freed at its value.
        least: likelihood ratio that a candidate must promise.
    """
    response, nearby = present.response, {}
    gains = {name: 2 * _gain_of_constant(fitter, response, name) for name in constants}
    for name, (near, far) in points.items():
        effect = fitter.candidates[name]
        acting = partial(acts, response, effect)
        far = [*far, *limits_near_edge(effect, far, acting)]
        promised = predicted_gains(response, effect, near, far)
        nearby[name] = promised[: len(near)]
        gains[name] = max((2 * promise.gain for promise in promised), default=0.0)
    of_best = SETTINGS.screening.least_share_of_best * max(gains.values(), default=0.0)
    least = max(least, _worth(fitter), of_best)
    ranked = sorted(gains, key=lambda n: -gains[n])
    short = [n for n in ranked if gains[n] >= least][: SETTINGS.screening.most_fitted]
    later = [name for name in ranked[len(short) :] if name in points]
    return {name: nearby.get(name, []) for name in short}, later


def _worth(fitter: CandidateFitter) -> float:
    """The least predicted likelihood ratio that is worth a fit."""
    return SETTINGS.screening.least_share_of_price * (
        math.log(fitter.samples) + SETTINGS.admission.least_bic_gain
    )


def _gain_of_constant(fitter: CandidateFitter, response: LinearResponse, name: str) -> float:
    """What a fixed parameter promises in log-likelihood, freed at its value."""
    problem, p = response.problem, fitter.model.parameters[name]
    step = _DIFFERENCE_STEP * p.scale
    step = -step if p.value + step > p.limits[1] else step
    values = {**problem.numbers.values, name: np.asarray(p.value + step)}
    moved = batch_passes(replace(problem, numbers=replace(problem.numbers, values=values)))
    pairs = zip(moved, response.errors, strict=True)
    slopes = [(np.asarray(a) - b)[:, None] * (p.scale / step) for (a, _), b in pairs]
    if not all(np.all(np.isfinite(slope)) for slope in slopes):
        return 0.0
    q = response.quadratic(slopes)
    return promised_gain(q, ~response.at_bound(q.gradient))


# -- the probes ------------------------------------------------------------------------------------


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


def levels_of(fitter: CandidateFitter, trial: TrialFit) -> dict[str, float]:
    """The 90th percentile of the absolute value of every signal, and the longest duration."""
    pairs = zip(trial.path, fitter.readings(trial), strict=True)
    series = [{**path, **ports} for path, ports in pairs]
    return levels_over(series, fitter.records)


def is_at_null(fitter: CandidateFitter, trial: TrialFit) -> bool:
    """Whether the fit has returned the last effect of a trial to its null."""
    if trial.effects[-1] in fitter.constants:
        return False
    effect = fitter.candidates[trial.effects[-1]]
    return does_nothing(effect, trial.values)


def does_nothing(effect: Effect, values: Mapping[str, float]) -> bool:
    """Whether an effect is absent at the values of a model's parameters."""
    away = [
        abs(values[f"{effect.name}.{name}"] - p.null) / p.scale
        for name, p in effect._parameters.items()
        if p.null is not None
    ]
    return bool(away) and all(distance < _AT_NULL for distance in away)


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
