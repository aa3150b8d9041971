"""Walks along a profile likelihood: of a parameter, or of a derived quantity."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from diffthrust._support._running.programs import program
from diffthrust.estimation._likelihood import Quadratic, evaluate, named_values
from diffthrust.estimation._numbers import ProblemNumbers
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._solver import MOST_STEPS, BoundedLevenbergMarquardt, solve

VANISHED = 23.0
"""A "log" parameter this many e-foldings (ten decades) below its start has vanished, as in the
fit's status."""
_STIFF = 0.1
"""A pull acts like a measurement of the quantity with this share of its standard error."""
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
Function = Callable[[Mapping[str, Any]], Mapping[str, Any]]


class ProfilePoint(NamedTuple):
    """The least cost at one position of a line, and the coordinates there."""

    x: float
    cost: float
    z: np.ndarray
    quadratic: Quadratic
    aim: float
    """The requested position, which a quantity reaches only approximately."""


def spread(problem: Problem, point: ProfilePoint) -> np.ndarray:
    """Inverse information of the free coordinates, zero for those at a bound, ``(N, N)``.

    Undetermined directions are left out: the result sets only step lengths, never intervals.
    """
    # a coordinate at its bound does not move with the others: it would widen steps that cannot be
    # taken
    inside = _inside(problem, point.z)
    information = np.asarray(point.quadratic.information) * np.outer(inside, inside)
    length = np.sqrt(np.maximum(np.diagonal(information), 0.0))
    length = np.where(length > 0, length, 1.0)
    scaled = np.linalg.pinv(information / np.outer(length, length), rcond=1e-10, hermitian=True)
    return scaled / np.outer(length, length)


def _inside(problem: Problem, z: np.ndarray) -> np.ndarray:
    low, high = problem.limits()
    return (z > low + 1e-9) & (z < high - 1e-9)


@dataclass(frozen=True)
class ParameterLine:
    """A free parameter, in its coordinate; equal limits fix it without another compilation."""

    problem: Problem
    name: str
    best: ProfilePoint

    @cached_property
    def place(self) -> int:
        """Its coordinate."""
        return self.problem.free.index(self.name)

    @cached_property
    def scale(self) -> float:
        """Standard error in the coordinate; at a bound, the distance to a cost higher by 1/2."""
        i, q = self.place, self.best.quadratic
        variance = spread(self.problem, self.best)[i, i]
        if variance > 1e-24:  # smaller values are rounding errors of a coordinate at its bound
            return float(min(np.sqrt(variance), 1.0))
        # at a bound the cost rises by its slope, not by its curvature: both bound the distance
        steep = np.sqrt(max(float(q.information[i, i]), 0.0)) + abs(float(q.gradient[i]))
        return float(np.clip(1.0 / max(steep, 1.0), 1e-12, 1.0))

    def ends(self) -> tuple[float, float]:
        """The bounds; for a logarithm without bounds, ten decades away."""
        low, high = (float(side[self.place]) for side in self.problem.limits())
        x, p = self.best.z[self.place], self.problem.named[self.name]
        if p.transform == "log":
            low = low if p.limits[0] > 0 else x - VANISHED
            high = high if np.isfinite(p.limits[1]) else x + VANISHED
        return low, high

    def start(self) -> ProfilePoint:
        """The optimum."""
        x = float(self.best.z[self.place])
        return self.best._replace(x=x, aim=x)

    def reach(self, x: float, near: ProfilePoint) -> ProfilePoint:
        """The least cost at ``x``, starting from a neighbour along the direction of the valley."""
        i, (low, high) = self.place, self.problem.limits()
        information = np.asarray(near.quadratic.information)
        inside = _inside(self.problem, near.z)
        inside[i] = False
        # the implicit function theorem: dz/dx = -H^-1 h along the valley, which saves most of the
        # refit
        gram = information[np.ix_(inside, inside)]
        length = np.sqrt(np.maximum(np.diagonal(gram), 1e-300))
        slope = np.linalg.lstsq(
            gram / np.outer(length, length), information[inside, i] / length, rcond=1e-10
        )[0]
        low[i] = high[i] = x
        straight = near.z.copy()
        straight[inside] -= slope / length * (x - near.x)
        tried = [solve(self.problem, straight, limits=(low, high))]
        if not (tried[0].done and np.isfinite(tried[0].quadratic.cost)):
            # a curved valley leaves its tangent: the neighbour itself is the safer start
            tried.append(solve(self.problem, near.z, limits=(low, high)))
        best = min(tried, key=lambda s: float(s.quadratic.cost))
        return ProfilePoint(x, float(best.quadratic.cost), best.z, best.quadratic, x)

    def value(self, x: float) -> float:
        """The value in the parameter's unit."""
        p = self.problem.named[self.name]
        return float(np.clip(float(p.from_coordinate(x)), *p.limits))


@dataclass(frozen=True)
class QuantityLine:
    """A function of the parameters, moved by the penalty ``((q(z) - target) / width)^2 / 2``.

    The minimiser has the least cost of all z with the same q, since they all pay the same: the cost
    without the penalty is on the profile, at the q that was reached. No equality constraint is
    needed, and all quantities of a function share a compilation.
    """

    problem: Problem
    name: str
    function: Function
    index: int
    best: ProfilePoint

    @cached_property
    def _slope(self) -> tuple[float, np.ndarray]:
        at = self.problem.numbers, self.best.z, self.index
        value, slope = _quantity(self.problem.layout, self.function, *at)
        return float(value), np.asarray(slope)

    @cached_property
    def scale(self) -> float:
        """Standard error to first order."""
        value, slope = self._slope
        variance = slope @ spread(self.problem, self.best) @ slope
        return float(np.sqrt(variance)) if variance > 0 else 0.1 * abs(value) or 0.1

    def ends(self) -> tuple[float, float]:
        """Only the parameters have bounds."""
        return -np.inf, np.inf

    def start(self) -> ProfilePoint:
        """The optimum."""
        x = self._slope[0]
        return self.best._replace(x=x, aim=x)

    def reach(self, x: float, near: ProfilePoint) -> ProfilePoint:
        """The least cost at a value close to ``x``."""
        # the second term compensates the pull of a quadratic cost towards the optimum
        target = x + _STIFF**2 * (x - self._slope[0])
        numbers = (near.z, *self.problem.limits(), self.index, target, _STIFF * self.scale)
        z, quadratic, value, pull = _solve_pulled(
            self.problem.layout,
            self.function,
            self.problem.numbers,
            tuple(map(jnp.asarray, numbers)),
        )
        quadratic = Quadratic(*(np.asarray(array) for array in quadratic))
        cost = float(quadratic.cost) - float(pull)
        return ProfilePoint(float(value), cost, np.asarray(z), quadratic, x)

    def value(self, x: float) -> float:
        """The position is the value itself."""
        return x


Line = ParameterLine | QuantityLine
"""A parameter or a quantity that is fixed while all else minimises the cost."""


def _of(layout: Any, function: Function, numbers: ProblemNumbers, z: Any, index: Any) -> Any:
    quantities = function(named_values(layout, numbers, z[: len(layout.free)]))
    return jnp.stack([jnp.asarray(v, float) for v in quantities.values()])[index]


@program(2)
def _quantity(layout: Any, function: Function, numbers: ProblemNumbers, z: Any, index: Any) -> Any:
    def of(y: Any) -> Any:
        return _of(layout, function, numbers, y, index)

    return of(z), jax.jacfwd(of)(z)


@program(2)
def _solve_pulled(layout: Any, function: Function, numbers: ProblemNumbers, pulled: Any) -> Any:
    z, low, high, index, target, width = pulled
    solver = BoundedLevenbergMarquardt(rtol=0.0, atol=1e-9, lower=low, upper=high)

    def of(y: Any, at: Any) -> Any:
        return (_of(layout, function, at, y, index) - target) / width

    def objective(y: Any, args: Any) -> tuple[Any, Quadratic]:
        q = evaluate(layout, args[0], y)
        residual, slope = of(y, args[0]), jax.jacfwd(of)(y, args[0])
        cost = q.cost + 0.5 * residual**2
        # a failed simulation is refused by the solver as infinitely costly; NaN would compare false
        cost = jnp.where(jnp.isfinite(cost), cost, jnp.inf)
        q = q._replace(
            cost=cost,
            gradient=q.gradient + residual * slope,
            information=q.information + slope[:, None] * slope[None, :],
        )
        return cost, q

    args = (numbers, jnp.asarray(MOST_STEPS - 1))
    options: Any = {"has_aux": True, "max_steps": MOST_STEPS, "throw": False}
    solution = optx.minimise(objective, solver, z, args, **options)
    residual = of(solution.value, numbers)
    return solution.value, solution.aux, residual * width + target, 0.5 * residual**2


class DeeperError(Exception):
    """A walk found a lower cost than that of the fit, at ``point``."""

    def __init__(self, point: ProfilePoint) -> None:
        self.point = point
        super().__init__(f"a lower cost than the fit's at {point.x}")


class Side(NamedTuple):
    """One half of a profile."""

    points: list[ProfilePoint]
    """From the optimum outwards."""
    end: float | None
    """Of the interval."""
    why: str | None
    """The reason if there is no end: "bound", "flat", "stuck" or "fails"."""


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
