"""Which candidates are worth a fit beside the current model, and their first fits.

Each effect has probes: points next to its null, and points at trial values. The linear response of
the current trial predicts at almost no cost what the effect gains from each of them, and what a
fixed parameter does (`shortlist`). The candidates with the largest predicted gains are fitted for a
few steps from their best probes (`screened`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit, side_by_side
from diffthrust.diagnosis._linear_response import LinearResponse, promised_gain
from diffthrust.diagnosis._predicted_gain import (
    Point,
    PredictedGain,
    acts,
    limits_near_edge,
    predicted_gains,
    probes,
)
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.estimation._one_step import batch_passes
from diffthrust.models._base.effect import Effect
from diffthrust.simulation._levels import levels_over

_DIFFERENCE_STEP = 1e-4
"""Numerics: step of the differences by a fixed parameter, as a share of its scale."""
_FIRST_STEPS = 6
"""Numerics: steps from each of the best probes, before it is known which effects matter."""
_THRESHOLD_STEPS = 20
"""Numerics: steps across a threshold, where a search creeps."""
_AT_NULL = 1e-6
"""Numerics: an effect closer to its null than this, in units of its scale, does nothing."""
_IDLE_CHANGE = 1e-6
"""Numerics: a point that changes the cost by less does nothing: rounding of a pass is below it."""
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

    Without the candidates that promise less than the likelihood ratio ``least``, or gain too
    little. Probes are given by ``levels`` of the signals (`levels_of`), and are also tried from the
    values ``fallback`` of the model's parameters.
    """
    effects = [name for name in names if name not in fitter.constants]
    points = {name: probes(fitter.candidates[name], levels) for name in effects}
    promised, later = shortlist(fitter, present, points, least)
    constants = [name for name in names if name in fitter.constants]
    names = [*promised, *promising_constants(fitter, present, constants, least)]
    if names:
        fitter.ready(present.effects, names, later)

    def fitted(name: str) -> TrialFit | None:
        if name in fitter.constants:
            return _begun_at(fitter, name, present, {})
        return _effect_fit(fitter, name, present, promised[name], points[name][1], fallback)

    return _gaining(present, names, fitted)


def continued_beside(
    fitter: CandidateFitter, present: TrialFit, sizes: Mapping[str, Point]
) -> dict[str, TrialFit]:
    """As `screened`, of candidates that were fitted before, from their sizes there alone."""
    if sizes:
        fitter.ready(present.effects, [*sizes])
    return _gaining(present, [*sizes], lambda name: _begun_at(fitter, name, present, sizes[name]))


def _begun_at(
    fitter: CandidateFitter,
    name: str,
    present: TrialFit,
    point: Point,
    budget: int = _FIRST_STEPS,
    still: Collection[str] = (),
) -> TrialFit:
    """The current model with a candidate, fitted from a point for some steps."""
    effects, values = (*present.effects, name), {**present.values, **point}
    start, clip = present.initial_states, present.clip
    return fitter.solve(effects, values, start, clip, budget, still)


def _gaining(
    present: TrialFit, names: Sequence[str], fitted: Callable[[str], TrialFit | None]
) -> dict[str, TrialFit]:
    """The fits of some candidates, without those that gain too little in a few steps."""
    ends = zip(names, side_by_side(fitted, names), strict=True)
    least = SETTINGS.screening.least_early_gain
    return {n: end for n, end in ends if end and 2 * (present.cost - end.expected) > least}


def _effect_fit(
    fitter: CandidateFitter,
    name: str,
    present: TrialFit,
    near: Sequence[PredictedGain],
    far: Sequence[Point],
    fallback: Point | None,
) -> TrialFit | None:
    """The best fit of an effect from the two best of all its probes."""
    followed = partial(_begun_at, fitter, name, present)
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
        return fitter.further(followed(point, still=waiting), budget)

    def gain(expected: float) -> float:
        return 2 * (present.cost - expected)

    least = SETTINGS.screening.least_promise
    starts = [(present.cost - promise.gain, promise.point) for promise in near]
    distant = _best_distant(fitter, name, present, far)
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
) -> list[tuple[float, Point]]:
    """The two points of least cost far from the null, each with the cost that one step predicts."""
    effects = (*present.effects, name)

    def cost(point: Point) -> float:
        values = {**present.values, **point}
        return fitter.cost(effects, values, present.initial_states, present.clip)

    def moves(cost: float) -> bool:
        return abs(cost - present.cost) > _IDLE_CHANGE

    tried = [(cost(point), point) for point in points]
    more = limits_near_edge(fitter.candidates[name], points, lambda point: moves(cost(point)))
    tried += [(cost(point), point) for point in more]
    highest = present.cost + _LARGEST_RISE * fitter.samples  # NaN and infinite costs fail the test
    tried = [(at, point) for at, point in tried if moves(at) and at < highest]
    chosen = sorted(tried, key=lambda pair: pair[0])[:2]
    return [(_begun_at(fitter, name, present, p, 1).expected, p) for _, p in chosen]


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
    least: float = 0.0,
) -> tuple[dict[str, list[PredictedGain]], list[str]]:
    """The effects that are worth a fit, and the remaining ones, each by falling predicted gain.

    The first come with their predictions at the points next to the null.
    """
    response, gains, nearby = present.response, {}, {}
    for name, (near, far) in points.items():
        effect = fitter.candidates[name]
        acting = partial(acts, response, effect)
        far = [*far, *limits_near_edge(effect, far, acting)]
        promised = predicted_gains(response, effect, near, far)
        nearby[name] = promised[: len(near)]
        gains[name] = max((2 * promise.gain for promise in promised), default=0.0)
    short = _most_promising(fitter, gains, least)
    later = sorted(gains.keys() - short, key=lambda n: -gains[n])
    return {name: nearby[name] for name in short}, later


def promising_constants(
    fitter: CandidateFitter, present: TrialFit, names: Sequence[str], least: float = 0.0
) -> list[str]:
    """The fixed parameters that are worth a fit, each freed at its value.

    A craft of eight thrusters holds 30, whose fits took a quarter of each screen.
    """
    gains = {name: 2 * _gain_of_constant(fitter, present.response, name) for name in names}
    return _most_promising(fitter, gains, least)


def _most_promising(fitter: CandidateFitter, gains: Mapping[str, float], least: float) -> list[str]:
    """Those whose predicted gain, a likelihood ratio, is worth a fit, the largest first."""
    of_best = SETTINGS.screening.least_share_of_best * max(gains.values(), default=0.0)
    # an effect costs so much likelihood ratio at least
    price = math.log(fitter.samples) + SETTINGS.admission.least_bic_gain
    enough = max(least, SETTINGS.screening.least_share_of_price * price, of_best)
    ranked = sorted(gains, key=lambda n: -gains[n])
    return [n for n in ranked if gains[n] >= enough][: SETTINGS.screening.most_fitted]


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
