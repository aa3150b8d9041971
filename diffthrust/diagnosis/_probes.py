"""From which values a diagnosis tries an effect."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import product

import numpy as np

from diffthrust.models._base.effect import Effect
from diffthrust.models._base.parameter import Parameter, Relative

_MOST_PROBES = 6
"""Numerics: points from which an effect is tried at most."""
_NEAR = 2e-5
"""Numerics: the first probe of an effect, as a share of its trial value: near enough to be
linear."""
_PLACES = 24
"""Numerics: places or directions of an effect that are tried next to its null."""
_APART = 1.2
"""Numerics: a limit acts on nothing until it acts on much: its probes stand this close to each
other."""
_LIMITS = 12
"""Numerics: probes of a limit, upward from its lowest trial value."""


def probes(
    effect: Effect, levels: Mapping[str, float]
) -> tuple[list[dict[str, float]], list[dict[str, float]]]:
    """Points from which an effect is tried: next to its null, and at trial values.

    Args:
        effect: the effect.
        levels: the level of each signal of the logs, in which trial values are given.

    Returns:
        Points next to the null, spread over the range of parameters without one (none where a null
        is infinite), and points in the logs' scale.
    """
    named = effect._parameters
    tried = {}
    for name, p in named.items():
        if p.fixed:
            if p.probes:  # a form that is not estimated: each that it may have is tried
                tried[name] = list(_trial_values(p.probes, levels))
            continue
        values = _trial_values(p.probes, levels) or ((p.value,) if p.null != p.value else ())
        low, high = p.limits
        limit = np.isinf(p.null or 0.0)
        inside = [v for v in values if low <= v <= high and np.isfinite(v) and (v > 0 or not limit)]
        tried[name] = inside or [float(np.clip(p.scale, low, high))]
        if limit:
            values = tried[name]
            reach = max(_APART**_LIMITS, 2.5 * max(values) / min(values))
            tried[name] = list(min(values) * np.geomspace(1.0, reach, _LIMITS + 1))
    points = list(product(*tried.values()))
    if not is_limit(effect):
        points = points[:: max(1, len(points) // _MOST_PROBES)][:_MOST_PROBES]
    near: list[tuple[float, ...]] = []
    forms = [n for n in tried if named[n].fixed]  # all alike next to the null
    nulls = {n: named[n].null for n in tried if n not in forms}
    if all(null is None or np.isfinite(null) for null in nulls.values()):  # from there, the score
        many = max(1, round(_PLACES ** (1.0 / max(1, list(nulls.values()).count(None)))))
        axes = [
            _spread(tried[n], many, named[n].transform == "log")
            if null is None
            else [null + _NEAR * abs(tried[n][0] - null)]
            for n, null in nulls.items()
        ]
        near = [tuple(map(float, np.clip(p, *_ends(named, nulls)))) for p in product(*axes)]

    def by_name(names: Iterable[str], values: Iterable[Sequence[float]]) -> list[dict[str, float]]:
        full = [f"{effect.name}.{n}" for n in names]
        return [dict(zip(full, point, strict=True)) for point in values]

    return by_name(nulls, near), by_name(tried, points)


def _spread(values: Sequence[float], many: int, positive: bool) -> list[float]:
    """So many places over the range of the trial values and half a gap beyond its ends."""
    if len(values) == 1:
        return list(values)
    at = np.log(values) if positive else np.array(values)
    gap = np.ptp(at) / (len(at) - 1)
    places = np.linspace(at.min() - gap / 2, at.max() + gap / 2, many)
    return list(np.exp(places) if positive else places)


def is_limit(effect: Effect) -> bool:
    """Whether the effect does nothing where a parameter of it is infinite."""
    return any(np.isinf(p.null or 0.0) for p in effect._parameters.values())


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
