"""Which effects are worth a fit: what they promise next to their nulls, and at several sizes.

First by the linear response of the present trial, which costs next to nothing (`shortlist`); then
those that promise most are fitted from their best probes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit, side_by_side
from diffthrust.diagnosis._probes import probes
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._shortlist import constants, inside, shortlist
from diffthrust.simulation._levels import levels_over

_FEW = 6
"""Numerics: steps from each of the best probes, before it is known which effects matter."""
_MANY = 20
"""Numerics: steps across a threshold, where a search creeps."""
_AT_NULL = 1e-6
"""Numerics: an effect does nothing that is nearer to its null than this, in units of its scale."""
_IDLE = 1e-6
"""Numerics: a probe that changes the cost by less does nothing: rounding of a pass is below it."""
_FAR = 0.25
"""Numerics: a probe whose cost rises by more than this times the samples is no start of a
search."""

_Point = Mapping[str, float]


def screened(
    fitter: CandidateFitter,
    names: Sequence[str],
    present: TrialFit,
    levels: Mapping[str, float],
    say: Callable[[str], None] = lambda name: None,
    fallback: Mapping[str, float] | None = None,
) -> dict[str, TrialFit]:
    """The present model with each of some effects, carried a few steps from its best probes.

    Args:
        fitter: the fits.
        names: the candidates.
        present: the model as it is so far.
        levels: `levels_of` the signals.
        say: told each name as its turn comes.
        fallback: values of the model's parameters from which far probes are tried as well.

    Returns:
        CandidateFitter by name; candidates of which nothing is to be hoped are left out.
    """
    effects = [name for name in names if name not in fitter.constants]
    points = {name: probes(fitter.candidates[name], levels) for name in effects}
    for name in names:
        say(name)
    promised, later = shortlist(fitter, present, points)
    names = [*promised, *constants(fitter, present, [n for n in names if n in fitter.constants])]
    if names:
        fitter.ready((*present.effects, *names), later)

    def one(name: str) -> TrialFit | None:
        effects = (*present.effects, name)
        if name in fitter.constants:
            trial = fitter.solve(effects, present.values, present.begin, present.clip, _FEW)
            return (
                trial
                if 2 * (present.cost - trial.expected) > SETTINGS.screening.least_early_gain
                else None
            )

        def followed(point: _Point, budget: int) -> TrialFit:
            values = {**present.values, **point}
            return fitter.solve(effects, values, present.begin, present.clip, budget)

        # next to the null nothing tells where a place or a direction should move: it waits until
        # the effect has a size
        waiting = {
            f"{name}.{n}"
            for n, p in fitter.candidates[name]._parameters.items()
            if p.null is None and not p.fixed
        }

        def risen(point: _Point, budget: int) -> TrialFit:
            if not waiting:
                return followed(point, budget)
            values = {**present.values, **point}
            sized = fitter.solve(effects, values, present.begin, present.clip, _FEW, still=waiting)
            return fitter.solve(effects, sized.values, sized.begin, sized.clip, budget)

        def gain(expected: float) -> float:
            return 2 * (present.cost - expected)

        starts = [(present.cost - near.gain, near.point) for near in promised[name]]
        far = _far(fitter, name, present, points[name][1], followed)
        silent = all(
            gain(expected) < SETTINGS.screening.threshold_promise for expected, _ in starts
        )
        if far and silent:
            far[0] = (min(far[0][0], present.cost - SETTINGS.screening.least_promise), far[0][1])
        starts = [
            pair for pair in starts + far if gain(pair[0]) >= SETTINGS.screening.least_promise
        ]
        starts = sorted(starts, key=lambda pair: pair[0])[:2]
        ends = [risen(point, _MANY if silent else _FEW) for _, point in starts]
        if fallback is not None:
            ends += anew(fitter, name, present, points[name][1], fallback)
        best = min(ends, key=lambda trial: trial.expected, default=None)
        return (
            best
            if best is not None and gain(best.expected) > SETTINGS.screening.least_early_gain
            else None
        )

    ends = zip(names, side_by_side(one, names), strict=True)
    return {name: trial for name, trial in ends if trial is not None}


def levels_of(fitter: CandidateFitter, trial: TrialFit) -> dict[str, float]:
    """The 90th percentile of the absolute value of every signal, and the longest duration."""
    pairs = zip(trial.path, fitter.readings(trial), strict=True)
    series = [{**path, **ports} for path, ports in pairs]
    return levels_over(series, fitter.records)


def is_at_null(fitter: CandidateFitter, trial: TrialFit) -> bool:
    """Whether the last effect of a trial has gone back to its null."""
    if trial.effects[-1] in fitter.constants:
        return False
    effect = fitter.candidates[trial.effects[-1]]
    return all(
        abs(trial.values[f"{effect.name}.{name}"] - p.null) < _AT_NULL * p.scale
        for name, p in effect._parameters.items()
        if p.null is not None
    )


def _far(
    fitter: CandidateFitter,
    name: str,
    present: TrialFit,
    points: Sequence[_Point],
    followed: Callable[[_Point, int], TrialFit],
) -> list[tuple[float, _Point]]:
    """Of points far from the null the two with the least cost, with the cost that they promise."""
    effects = (*present.effects, name)

    def cost(point: _Point) -> float:
        values = {**present.values, **point}
        return fitter.cost(effects, values, present.begin, present.clip)

    def moves(cost: float) -> bool:
        return abs(cost - present.cost) > _IDLE

    tried = [(cost(point), point) for point in points]
    more = inside(fitter.candidates[name], points, lambda point: moves(cost(point)))
    tried += [(cost(point), point) for point in more]
    worth = present.cost + _FAR * fitter.samples  # NaN and infinite costs are worth nothing
    tried = [(at, point) for at, point in tried if moves(at) and at < worth]
    chosen = sorted(tried, key=lambda pair: pair[0])[:2]
    return [(followed(point, 1).expected, point) for _, point in chosen]


def anew(
    fitter: CandidateFitter,
    name: str,
    present: TrialFit,
    points: Sequence[_Point],
    fallback: _Point,
) -> list[TrialFit]:
    """The best of points far from the null, with the model's parameters as they were given.

    The fit of a model that is wrong at heart may have run to where its effect shows no more.
    """
    effects, values = (*present.effects, name), {**present.values, **fallback}
    limit = present.clip
    tried = [(fitter.cost(effects, {**values, **point}, None, limit), point) for point in points]
    tried = [pair for pair in tried if np.isfinite(pair[0])]
    cost, point = min(tried, key=lambda pair: pair[0], default=(np.inf, {}))
    without = fitter.cost(effects, values, None, limit)
    if 2 * (without - cost) < SETTINGS.screening.least_promise or not tried:
        return []
    return [fitter.solve(effects, {**values, **point}, None, limit, _MANY)]
