"""Points from which an effect is tried: next to its null, at trial values, and near a limit's edge.

A limit does nothing until a signal reaches it: its probes climb from its lowest trial value, and
the largest values that still act are sought by bisection.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import product

import numpy as np

from diffthrust.diagnosis._predicted_gain import Point
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.parameter import Parameter, Relative

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
