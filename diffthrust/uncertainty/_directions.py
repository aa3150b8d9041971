"""Identifiability: combinations of parameters that the logs determine well, or hardly."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from diffthrust._support.files import plain
from diffthrust._support.report import Report, Section
from diffthrust._support.results import Result
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._rebuild import problem_of
from diffthrust.estimation._result import Fit
from diffthrust.estimation._solver import solve
from diffthrust.estimation._status import RANK_LIMIT, inflation, marginal_spread
from diffthrust.logs._log import Log
from diffthrust.uncertainty._sandwich import converged, pressed
from diffthrust.uncertainty._tables import direction_rows

_WELL, _FAIRLY = 0.01, 0.1
"""A direction is well known to one in a hundred, known to one in ten, and hardly known beyond."""
_PART = 0.25
"""A parameter is named in a direction where its share is at least this of the largest."""


@dataclass(frozen=True)
class Direction:
    """One combination of parameters that varies independently of the others.

    Args:
        std_error: standard error as a relative change; infinite if not determined.
        changes: change of each parameter per standard error along the direction, in the
            parameter's unit, by name; if not determined, per change of one per cent.
        relative: the same as relative changes.
    """

    std_error: float
    changes: Mapping[str, float]
    relative: Mapping[str, float]

    @property
    def grade(self) -> str:
        """How well it is determined, in words."""
        if not math.isfinite(self.std_error):
            return "not known at all"
        if self.std_error < _WELL:
            return "well known"
        return "known" if self.std_error < _FAIRLY else "hardly known"

    @property
    def members(self) -> dict[str, float]:
        """Relative changes of the main parameters, the largest first."""
        largest = max(map(abs, self.relative.values()))
        kept = {n: c for n, c in self.relative.items() if abs(c) >= _PART * largest}
        return dict(sorted(kept.items(), key=lambda item: -abs(item[1])))

    @property
    def sentence(self) -> str:
        """Such as ``hardly known (12 %): alpha up with beta up``."""
        members = self.members
        if len(members) == 1:
            words = next(iter(members))
        else:
            words = " with ".join(f"{n} {'up' if c > 0 else 'down'}" for n, c in members.items())
        size = f" ({100 * self.std_error:.2g} %)" if math.isfinite(self.std_error) else ""
        return f"{self.grade}{size}: {words}"


@dataclass(frozen=True, repr=False)
class Directions(Result):
    """The directions of a fit, the best known first.

    Args:
        directions: in the order of their standard errors.
        held: parameters at a bound, which are left out.

    Example:
        >>> result = dft.uncertainty.directions(fit, log)
        >>> len(result.directions), len(result.sentences)
        (3, 3)
        >>> len(result.to_json())
        3
    """

    directions: tuple[Direction, ...]
    held: tuple[str, ...] = ()

    def __iter__(self) -> Iterator[Direction]:
        return iter(self.directions)

    def __len__(self) -> int:
        return len(self.directions)

    def __getitem__(self, index: int) -> Direction:
        return self.directions[index]

    @property
    def sentences(self) -> list[str]:
        """One for each direction, and one on held parameters."""
        sentences = [d.sentence for d in self.directions]
        return sentences + ([f"held at a bound: {', '.join(self.held)}"] if self.held else [])

    def _report(self) -> Report:
        rows = direction_rows((d.std_error, d.grade, d.members) for d in self.directions)
        return Report(Section("", rows))

    def _line(self) -> str:
        return "; ".join(self.sentences)

    def to_json(self) -> list[dict[str, Any]]:
        """Plain data; ``std_error`` is ``None`` if not determined."""
        names = ("std_error", "changes", "relative", "sentence")
        return [plain({name: getattr(d, name) for name in names}) for d in self.directions]


def directions(fit: Fit, logs: Log | Sequence[Log]) -> Directions:
    """Eigenvectors of the information that the logs hold about the parameters.

    Changes are relative to the values (or to the standard error if a value is smaller). Initial
    states and noise parameters are profiled out. The information is that of the fit's likelihood:
    if residuals are correlated but assumed white, all directions are less well known than stated.

    Args:
        fit: a fit that converged.
        logs: its training logs, in their order.

    Raises:
        InputError: the fit failed or did not converge, or the logs are not its own.

    Source: Brown & Sethna 2003, Physical Review E 68, 021904 (stiff and sloppy directions).

    Example:
        >>> len(dft.uncertainty.directions(fit, log).directions)
        3
    """
    converged(fit, "directions")
    return directions_of(*problem_of(fit, logs))


def directions_of(problem: Problem, z: np.ndarray) -> Directions:
    """The directions at the optimum of a problem."""
    quadratic = solve(problem, z, budget=1).quadratic
    gradient, information = np.asarray(quadratic.gradient), np.asarray(quadratic.information)
    held = pressed(problem, z, gradient)
    k = len(problem.own)
    inside = np.flatnonzero(~held[:k])
    beside = k + np.flatnonzero(~held[k:])
    length = np.sqrt(np.diagonal(information))
    length = np.where(length > 0, length, 1.0)
    scaled = information / np.outer(length, length)
    # rank must not depend on units: it is judged with all coordinates scaled to unit information
    _, projected = marginal_spread(gradient / length, scaled, inside, beside)
    nothing = RANK_LIMIT * max(np.linalg.eigvalsh(projected).max(initial=0.0), 1e-300)
    names, slopes = [problem.own[i] for i in inside], problem.slopes(z)[inside]
    length, values = length[inside], problem.values(z)
    spread = np.linalg.pinv(projected, RANK_LIMIT, hermitian=True)
    error = np.sqrt(np.diagonal(spread)) * slopes / length
    # a value near zero has no relative change: the standard error then is the unit
    size = np.maximum(np.abs([values[n] for n in names]), error)
    size = np.where(size > 0, size, slopes)
    unit = size / slopes  # coordinates in a relative change of one
    length = length * unit
    values, vectors = np.linalg.eigh(projected * np.outer(length, length))
    samples = float(np.sum(problem.numbers.counts))
    wide = inflation(problem, samples, inside.size + beside.size)
    ranked = []
    for value, vector in zip(values[::-1], vectors.T[::-1], strict=True):
        # the same limit of rank, transformed to the scaled direction
        determined = value > nothing * float(np.sum((vector * length) ** 2))
        error = math.sqrt(wide / value) if determined else math.inf
        # an eigenvector has no sign of its own: the largest part goes up, on every machine
        sign = 1.0 if vector[np.argmax(np.abs(vector))] > 0 else -1.0
        step = sign * vector * (error if determined else 0.01)
        changes, relative = (
            dict(zip(names, map(float, sizes), strict=True))
            for sizes in (step * unit * slopes, step)
        )
        ranked.append(Direction(error, changes, relative))
    return Directions(tuple(ranked), tuple(problem.own[i] for i in np.flatnonzero(held[:k])))
