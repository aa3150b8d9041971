"""Parameters that the logs of a fit say nothing about, or push to zero."""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain

import numpy as np

from diffthrust.estimation._multistart import FIRST_BUDGET, draw
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._solver import Solved, solve
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Parameter


def without_silent(
    problem: Problem, arrange: Callable[[Model], Problem], rng: np.random.Generator, begin: bool
) -> tuple[Problem, tuple[str, ...], Solved | None]:
    """Hold parameters that no measured channel depends on, at the guess or near it.

    Returns the problem to solve, the names of what is held, and with ``begin``, where the search
    will begin with this very problem, the first start of that search: mostly it depends on every
    parameter at its end, which leaves nothing to check.
    """
    points = draw(problem, 3, rng)
    first = solve(problem, points[0], FIRST_BUDGET) if begin else None
    sensitivity = np.zeros(points.shape[1])
    begun = [] if first is None else [first]
    for solved in chain(begun, (solve(problem, z, budget=1) for z in points)):
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
    held = {name: {"fixed": True, "per_log": False} for name in silent}
    return arrange(problem.model.replace(held)), silent, None


def _idle(problem: Problem, points: np.ndarray, i: int) -> bool:
    """Whether moving a coordinate changes nothing: a zero derivative may be that of a step."""
    moved = points.copy()
    moved[:, i] += 0.5
    pairs = zip(points, np.clip(moved, *problem.limits()), strict=True)
    costs = [[float(solve(problem, z, budget=1).quadratic.cost) for z in pair] for pair in pairs]
    return all(a == b or not np.isfinite([a, b]).all() for a, b in costs)


_FAR = 23.0
"""Logarithms so far below their start, ten decades, are zero to all ends."""
_NOTHING = 1e-12
"""A value below this share of the usual one was left behind by a fit in which it vanished,"""
_ALIVE = 1e-2
"""and the next begins at this share of the usual one."""


def vanished(problem: Problem, z: np.ndarray) -> np.ndarray:
    """Which coordinates are logarithms that ran off to zero, ``(n,)``.

    A logarithm has no zero: it runs to its limit, far below the start. Nothing depends on it there,
    so the next fit from that place could not move it, and would report it as insensitive.
    """
    away = np.zeros(z.size, bool)
    for i, name in enumerate(problem.free):
        p = problem.named[name]
        away[i] = _may_vanish(p) and z[i] < np.log(p.value) - _FAR
    return away


def alive(model: Model) -> Model:
    """The model with parameters that vanished in an earlier fit back where logs can move them."""
    usual = {f"{e.name}.{n}": p for e in model.effects for n, p in e.declared.items()}
    usual |= model.declared
    back = {
        name: _ALIVE * usual[name].value
        for name, p in model.parameters.items()
        if name in usual and _may_vanish(p) and p.value < _NOTHING * usual[name].value
    }
    return model.replace(back) if back else model


def vanished_notes(problem: Problem, z: np.ndarray) -> tuple[str, ...]:
    """A sentence for each parameter that vanished: what the model is without it."""
    away = vanished(problem, z)[: len(problem.own)]
    notes = []
    for name in (n for n, vanishes in zip(problem.own, away, strict=True) if vanishes):
        what = problem.named[name].doc
        term = f"the term of {name} ({what})" if what else f"the term of {name}"
        notes.append(
            f"{name} vanished: these logs push it to zero, where {term} is absent. "
            "The model fits them as well without that term."
        )
    return tuple(notes)


def _may_vanish(p: Parameter) -> bool:
    return p.transform == "log" and not p.fixed and p.limits[0] <= 0
