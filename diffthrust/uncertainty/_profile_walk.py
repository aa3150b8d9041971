"""Walk along a profile likelihood to the end of the confidence interval."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from diffthrust.uncertainty._profile_lines import Line, ProfilePoint

_MOST = 60
"""Most points to one side."""
_FAR = 1e4
"""A walk without bounds stops after this many standard errors."""
_STEP = 1 / 3
"""A step aims at this share of the threshold's root."""
_NEAR = 1e-4
"""Relative tolerance of the root at the end of the interval."""
_GAIN = 1e-3
"""A cost lower than the fit's by this is another optimum, not rounding."""


class DeeperError(Exception):
    """A walk found a lower cost than that of the fit, at ``point``."""

    def __init__(self, point: ProfilePoint) -> None:
        self.point = point
        super().__init__(f"a lower cost than the fit's at {point.x}")


class Side(NamedTuple):
    """One half of a profile.

    Args:
        points: from the optimum outwards.
        end: end of the interval, or ``None``.
        why: the reason if there is no end: "bound", "flat", "stuck" or "fails".
    """

    points: list[ProfilePoint]
    end: float | None
    why: str | None


def walk(line: Line, sign: float, reach: float) -> Side:
    """Walk to one side (1 or -1) from the optimum, by steps adapted to the profile's steepness.

    The root of twice the drop of the log-likelihood is nearly linear in the distance (exactly so
    for a quadratic), unlike the drop itself. A step aims at a third of the threshold (``reach``) in
    that root, and the end is found by regula falsi on it (Illinois; Dowell & Jarratt 1971).

    Raises:
        DeeperError: a point has a lower cost than the optimum.
    """
    start = line.start()
    limit = line.ends()[0 if sign < 0 else 1]
    points, step, failures, stuck = [start], _STEP * reach * line.scale, 0, 0
    while len(points) < _MOST:
        last = points[-1]
        room = sign * (limit - last.x)
        if room <= 1e-9:
            return Side(points, None, "bound")
        if abs(last.x - start.x) > _FAR * line.scale:
            return Side(points, None, "flat")
        aim = limit if step >= 0.999 * room else last.x + sign * step
        point = line.reach(aim, last)
        if not np.isfinite(point.cost):
            failures, step = failures + 1, 0.25 * step
            if failures > 8:
                return Side(points, None, "fails")
            continue
        _check_deeper(point, start)
        moved = sign * (point.x - last.x)
        # bounds of the parameters keep the quantity from moving
        if moved < 0.05 * abs(aim - last.x):
            stuck, step = stuck + 1, 4 * step
            if stuck > 3:
                return Side(points, None, "stuck")
            continue
        points.append(point)
        if root(point, start) >= reach:
            points, end = _bracketed_end(line, points, start, reach)
            return Side(_point_outside(line, points, sign, limit, end), end, None)
        rise = root(point, start) - root(last, start)
        wanted = _STEP * reach * moved / rise if rise > 0 else np.inf
        # a flat stretch says little of what follows: steps grow fourfold at most
        step = float(np.clip(wanted, 0.25 * moved, 4 * moved))
    return Side(points, None, "flat")


def root(point: ProfilePoint, start: ProfilePoint) -> float:
    """Root of twice the drop of the log-likelihood."""
    return float(np.sqrt(2 * max(point.cost - start.cost, 0.0)))


def _check_deeper(point: ProfilePoint, start: ProfilePoint) -> None:
    if point.cost < start.cost - _GAIN:
        raise DeeperError(point)


def _bracketed_end(
    line: Line, points: list[ProfilePoint], start: ProfilePoint, reach: float
) -> tuple[list[ProfilePoint], float]:
    """Find the end of the interval between the last two points."""
    inner, outer = points[-2], points[-1]
    inside, outside = root(inner, start) - reach, root(outer, start) - reach
    tried, kept = [*points], 0
    nearest = outer if outside < -inside else inner
    for _ in range(40):
        if abs(root(nearest, start) - reach) < _NEAR * reach:
            break
        x = inner.aim - inside * (outer.aim - inner.aim) / (outside - inside)
        if not min(inner.aim, outer.aim) < x < max(inner.aim, outer.aim):
            break  # no number lies between
        point = line.reach(x, inner)
        if not np.isfinite(point.cost):
            # from inside the refit may run into values at which the simulation fails: from the
            # other end
            point = line.reach(x, outer)
        _check_deeper(point, start)
        tried.append(point)
        nearest, miss = point, root(point, start) - reach
        # Illinois: halve the value of an end kept twice, or it would be kept for ever
        if miss >= 0:
            outer, outside, inside = point, miss, inside * (0.5 if kept == 1 else 1.0)
        else:
            inner, inside, outside = point, miss, outside * (0.5 if kept == -1 else 1.0)
        kept = 1 if miss >= 0 else -1
    return sorted(tried, key=lambda p: abs(p.x - start.x)), nearest.x


def _point_outside(
    line: Line, points: list[ProfilePoint], sign: float, limit: float, end: float
) -> list[ProfilePoint]:
    """Add a point slightly outside, so that a figure shows the crossing."""
    start, last = points[0], points[-1]
    x = end + 0.2 * (end - start.x)
    if sign * (last.x - x) >= 0 or sign * (limit - x) <= 0:
        return points
    point = line.reach(x, last)
    fine = np.isfinite(point.cost) and sign * (point.x - last.x) > 0
    return [*points, point] if fine else points
