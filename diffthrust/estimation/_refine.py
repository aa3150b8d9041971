"""The end of a search: steps of Newton's method where Gauss-Newton steps creep.

In curved valleys, on flat ridges and where the residuals are large, the Gauss-Newton curvature is a
poor guide. The true one is taken from differences of the gradient, along the principal axes of the
information, a small share of a standard error to either side: along these axes all curvatures are
near one, however ill the parameters' own coordinates are conditioned. Valleys run along the weakest
axes, of which as many are measured as the logs have parameters in common; along the others, mostly
initial states of single logs, the curvature is taken as one. Of nine runs of a boat all 36 axes
took 72 passes a step, and two thirds of a fit.
"""

from __future__ import annotations

import numpy as np

from diffthrust.estimation._estimate import Estimate
from diffthrust.estimation._multistart import Search
from diffthrust.estimation._observer import CLIP, REAL, WIDE
from diffthrust.estimation._one_step import with_clip
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._solver import EQUAL, Solved, solve
from diffthrust.estimation._status import GRADIENT_LIMIT, RANK_LIMIT, examine

_STEPS = 6
"""At most so many steps,"""
_ROUNDS = 3
"""so many times, with a search in between."""
_CREEPING = 0.1
"""Log-likelihood: Newton steps that gain less, and end on a slope, are in a valley without an end.
On an Otter, of whose sway the logs tell next to nothing, three rounds took half of a fit for 0.3;
an error bar takes notice of 0.5."""
_LINES = 3
_NEAR = 0.05
"""Rounding is looked at along so many lines, at points so many standard errors apart."""
_FACTOR = 3.0
"""A gradient up to so many standard deviations of what rounding makes is none,"""
_AWAY = 0.1
"""if it comes from so near the minimum, in standard errors."""
_SHARE = 1e-3
"""Gradients are compared so many standard errors to either side."""


def polished(search: Search) -> Search:
    """The search with its best optimum carried to the end, if it had not come there."""
    problem = search.problem
    if search.best.done and _is_flat(problem, search.best):
        return search
    best = search.finished().best
    for _ in range(_ROUNDS):
        begun, best = best, _by_newton(problem, best)
        if not np.isfinite(best.cost) or best.done or _steepness(problem, best) == 0:
            break
        if begun.cost - best.cost < _CREEPING:
            break
        best = solve(problem, best.z)  # from far away a trust region is the safer guide
    return search.with_best(best)


def rounding_of(problem: Problem, end: Solved) -> float:
    """Up to where the gradient at an optimum is not resolved, on the scale of `Checks.gradient`.

    From fourth differences along lines (Moré & Wild 2011, section 3), which are those of rounding,
    for all that is smooth falls out of them: a few times what rounding makes of the gradient, or
    the gradient itself where all that it promises is lost in the rounding of the cost. Zero where
    the minimum would be further away than a small share of a standard error.
    """
    q, (low, high) = end.quadratic, problem.limits()
    moves = _axes(end, low, high)
    away = float(np.linalg.norm(moves @ q.gradient))
    if not moves.size or away > _AWAY:
        return 0.0
    length = np.sqrt(np.diagonal(q.information))
    length = np.where(length > 0, length, np.inf) * np.sqrt(float(q.energy))
    noise = np.zeros(1 + end.z.size)
    for turn in np.random.default_rng(0).standard_normal((_LINES, len(moves))):
        step = _NEAR * turn / np.linalg.norm(turn) @ moves
        points = [np.clip(end.z + i * step, low, high) for i in range(-3, 4)]
        near = [solve(problem, z, budget=1).quadratic for z in points]
        table = np.array([[quadratic.cost, *(quadratic.gradient / length)] for quadratic in near])
        noise = np.maximum(noise, np.sqrt(np.mean(np.diff(table, 4, axis=0) ** 2, axis=0) / 70.0))
    if not np.all(np.isfinite(noise)):
        return 0.0
    lost = 0.5 * away**2 < _FACTOR * noise[0]
    return max(_FACTOR * float(noise[1:].max()), _steepness(problem, end) if lost else 0.0)


def _by_newton(problem: Problem, best: Solved) -> Solved:
    for _ in range(_STEPS):
        if not np.isfinite(best.cost) or (best.done and _steepness(problem, best) == 0):
            break
        further = _newton(problem, best)
        if further is None:
            break
        best = further
    return best


def _is_flat(problem: Problem, at: Solved) -> bool:
    """Whether the gradient is that of an optimum by itself, without a look at bounds and rank."""
    q, samples = at.quadratic, float(np.sum(problem.numbers.counts))
    length = np.sqrt(np.diagonal(q.information))
    slope = np.abs(q.gradient) / np.where(length > 0, length, 1.0)
    return bool(slope.max(initial=0.0) <= GRADIENT_LIMIT * np.sqrt(0.01 * samples))


def _steepness(problem: Problem, at: Solved) -> float:
    """The gradient, zero where it is as small as that of an optimum."""
    gradient = examine(problem, at.z, at.quadratic).gradient
    return gradient if gradient > GRADIENT_LIMIT else 0.0


def _newton(problem: Problem, at: Solved) -> Solved | None:
    """One step within the bounds; ``None`` where none falls further."""
    q, (low, high) = at.quadratic, problem.limits()
    moves = _axes(at, low, high)
    weak = min(len(moves), problem.shared)

    def slope(z: np.ndarray) -> np.ndarray:
        return moves @ solve(problem, z, budget=1).quadratic.gradient

    apart = [slope(at.z + _SHARE * d) - slope(at.z - _SHARE * d) for d in moves[:weak]]
    measured = np.array(apart) / (2 * _SHARE)
    if not measured.size or not np.all(np.isfinite(measured)):
        return None
    curvature = np.eye(len(moves))
    curvature[:weak], curvature[:, :weak] = measured, measured.T
    corner = measured[:, :weak]
    curvature[:weak, :weak] = 0.5 * (corner + corner.T)
    values, vectors = np.linalg.eigh(curvature)
    along = vectors.T @ (moves @ q.gradient)
    step = -(vectors @ (along / np.maximum(np.abs(values), 1e-9))) @ moves
    for share in (1.0, 0.25, 0.05):
        trial = solve(problem, np.clip(at.z + share * step, low, high), budget=1)
        if _better(problem, trial, at):
            return trial
    return None


def _axes(at: Solved, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Moves of one standard error along the principal axes of what is free, ``(axes, n)``.

    The weakest come first.
    """
    q = at.quadratic
    length = np.sqrt(np.diagonal(q.information))
    edge = ((at.z <= low + 1e-9) & (q.gradient > 0)) | ((at.z >= high - 1e-9) & (q.gradient < 0))
    free = np.flatnonzero(~edge & (length > 0))
    scaled = q.information[np.ix_(free, free)] / np.outer(length[free], length[free])
    values, vectors = np.linalg.eigh(scaled)
    values = np.maximum(values, RANK_LIMIT * values.max(initial=1.0))
    moves = np.zeros((free.size, at.z.size))
    moves[:, free] = (vectors / np.sqrt(values)).T / length[free]
    return moves


def _better(problem: Problem, trial: Solved, at: Solved) -> bool:
    """A lower cost; or one that is equal, and a smaller gradient."""
    gain = at.cost - trial.cost
    rounding = EQUAL * abs(at.cost)
    if not abs(gain) <= rounding:
        return gain > 0
    return _steepness(problem, trial) < _steepness(problem, at)


def refined(search: Search) -> Search:
    """A search continued with large errors limited that correct states, where the law forgives.

    A spike then moves the states no further than a large error does. Where large errors are no
    spikes but real motion, the wider limit is likelier and is taken.
    """
    likelihood = search.problem.layout.likelihood
    if not (likelihood.corrects and likelihood.law.forgiving):
        return search
    for _ in range(2):  # the limit follows the noise level, which falls once spikes are limited
        search = search.followed(with_clip(search.problem, CLIP * search.best.quadratic.sigma))
    freer = search.followed(with_clip(search.problem, search.problem.numbers.clip, reach=WIDE))
    return freer if freer.best.cost < search.best.cost - REAL else search


def disturbance_of(problem: Problem, z: np.ndarray) -> dict[str, Estimate]:
    """The observer's gains and memories, without standard errors."""
    values = problem.values(z)
    estimates = {}
    for name, p in problem.nuisance.items():
        touching = any(np.isclose(values[name], end, rtol=1e-9, atol=1e-9) for end in p.limits)
        estimates[name] = Estimate(values[name], None, p.unit, fixed=False, at_bound=touching)
    return estimates


def limits_of(problem: Problem) -> dict[str, float]:
    """By channel the size of a large error."""
    return dict(zip(problem.layout.channels, map(float, problem.numbers.clip), strict=True))
