"""Parameters that the logs of a fit say nothing about."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from diffthrust.estimation._multistart import FIRST_BUDGET, draw
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._solver import Solved, solve
from diffthrust.models._base.model import Model


def without_silent(
    problem: Problem, arrange: Callable[[Model], Problem], rng: np.random.Generator, begin: bool
) -> tuple[Problem, tuple[str, ...], Solved | None]:
    """Hold parameters that no measured channel depends on, at the guess or near it.

    Args:
        problem: with all parameters that may be estimated.
        arrange: makes the same problem of another model.
        rng: draws the points beside the guess.
        begin: the search will begin with this very problem.

    Returns:
        The problem to solve, the names of what is held, and with ``begin`` the first start of its
        search: mostly it depends on every parameter at its end, which leaves nothing to check.
    """
    points = draw(problem, 3, rng)
    first = solve(problem, points[0], FIRST_BUDGET) if begin else None
    sensitivity = np.zeros(points.shape[1])
    for solved in _looks(problem, points, first):
        sensitivity += np.nan_to_num(np.diagonal(solved.quadratic.information), nan=1.0, posinf=1.0)
        if np.all(sensitivity[: len(problem.own)] > 0):
            return problem, (), first
    silent = tuple(
        name
        for i, name in enumerate(problem.own)
        if sensitivity[i] == 0 and _idle(problem, points, i)
    )
    if not silent or len(silent) == len(problem.own):
        return problem, (), first
    return arrange(problem.model.fix(*silent)), silent, None


def _looks(problem: Problem, points: np.ndarray, first: Solved | None) -> Iterator[Solved]:
    if first is not None:
        yield first
    for z in points:
        yield solve(problem, z, budget=1)


def _idle(problem: Problem, points: np.ndarray, i: int) -> bool:
    """Whether moving a coordinate changes nothing: a zero derivative may be that of a step."""
    moved = points.copy()
    moved[:, i] += 0.5
    pairs = zip(points, np.clip(moved, *problem.limits()), strict=True)
    costs = [[float(solve(problem, z, budget=1).quadratic.cost) for z in pair] for pair in pairs]
    return all(a == b or not np.isfinite([a, b]).all() for a, b in costs)
