"""Which effects are worth a fit at all, by what they promise beside the present trial."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit
from diffthrust.diagnosis._predicted_gain import Promise, acts, promises
from diffthrust.diagnosis._probes import is_limit
from diffthrust.diagnosis._score_test import promised_gain
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.estimation._one_step import batch_passes
from diffthrust.models._base.effect import Effect

_APART = 1e-4
"""Numerics: derivatives by a constant are differences over this share of its scale."""
_HALVINGS = 10
"""Numerics: halvings of the gap between a limit that acts and one that nothing reaches."""
_INSIDE = (0.999, 0.997, 0.99, 0.97)
"""Numerics: shares of the least limit that nothing reaches at which it is tried: faint ones lie
there."""
_BETWEEN = 8
"""Numerics: further places between these and the probes that act."""
_FURTHEST = 1e4
"""Numerics: multiple of the probes that act beyond which a limit is not sought."""

_Point = Mapping[str, float]


def shortlist(
    fitter: CandidateFitter,
    present: TrialFit,
    points: Mapping[str, tuple[Sequence[_Point], Sequence[_Point]]],
) -> tuple[dict[str, list[Promise]], list[str]]:
    """The effects that are worth a fit, the one that promises most first; and all others so.

    With what each promises from its points next to the null.
    """
    response, gains, worth, nearby = present.response, {}, _worth(fitter), {}
    for name, (near, far) in points.items():
        effect = fitter.candidates[name]
        acting = partial(acts, response, effect)
        far = [*far, *inside(effect, far, acting)]
        promised = promises(response, effect, near, far)
        nearby[name] = promised[: len(near)]
        gains[name] = max((2 * promise.gain for promise in promised), default=0.0)
    least = max(worth, SETTINGS.screening.least_share_of_best * max(gains.values(), default=0.0))
    ranked = sorted(gains, key=lambda n: -gains[n])
    short = [n for n in ranked if gains[n] >= least][: SETTINGS.screening.most_fitted]
    return {name: nearby[name] for name in short}, ranked[len(short) :]


def _worth(fitter: CandidateFitter) -> float:
    """The likelihood ratio from which on a fit is worth it."""
    return SETTINGS.screening.least_share_of_price * (
        math.log(fitter.samples) + SETTINGS.admission.least_bic_gain
    )


def constants(fitter: CandidateFitter, present: TrialFit, names: Sequence[str]) -> list[str]:
    """Those of some held parameters that are worth a fit, each freed at its value."""
    response, worth, promising = present.response, _worth(fitter), []
    problem = response.problem
    for name in names:
        p = fitter.model.parameters[name]
        step = _APART * p.scale * (-1.0 if p.value + _APART * p.scale > p.limits[1] else 1.0)
        values = {**problem.numbers.values, name: np.asarray(p.value + step)}
        moved = batch_passes(replace(problem, numbers=replace(problem.numbers, values=values)))
        pairs = zip(moved, response.errors, strict=True)
        slopes = [(np.asarray(a) - b)[:, None] * (p.scale / step) for (a, _), b in pairs]
        if not all(np.all(np.isfinite(slope)) for slope in slopes):
            continue
        q = response.quadratic(slopes)
        if 2 * promised_gain(q, ~response.held(q.gradient)) >= worth:
            promising.append(name)
    return promising


def inside(
    effect: Effect, points: Sequence[_Point], acting: Callable[[_Point], bool]
) -> list[_Point]:
    """For a limit points between those that act and the least that nothing reaches."""
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
    between = np.geomspace(below, _INSIDE[-1] * edge, _BETWEEN)[1:-1]
    return [{key: float(value)} for value in (*between, *(edge * share for share in _INSIDE))]


def edge_of(low: float, high: float, acts: Callable[[float], bool]) -> float:
    """The largest value, about, at which a limit still acts, between one that does and one not.

    Example:
        >>> round(edge_of(1.0, 2.0, lambda value: value < 1.5), 2)
        1.5
    """
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if acts(middle) else (low, middle)
    return low
