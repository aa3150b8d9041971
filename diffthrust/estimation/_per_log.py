"""Numbers that differ by log: how wide they are spread, by the likelihood with them integrated out.

A value b_k in each log, of a Gaussian about the mean of all: ``b_k - mean`` over the width is one
more residual. The width itself cannot be read off the optimum, which would shrink it to zero; it
is that of the largest **restricted likelihood**, in which the values, the mean and all other
unknowns are integrated out (Patterson & Thompson 1971; Pinheiro & Bates 2000, section 7.2: the
nonlinear model is linearised about the optimum, and the widths are those of the linear one, in
turn). With H the information of the logs about the values, all else integrated out, and b their
linear term, the logarithm of that likelihood is, for widths in D = diag(w),

    0.5 (D b)' (1 + D H D)^-1 (D b) - 0.5 log det(1 + D H D)

Of few logs that is often largest at a width of zero, where each log would have the error of the
mean of all: far too small (Chung et al. 2013). So it is multiplied by w / sqrt(w^2 + v), with v the
variance of a value by its log alone: like their gamma prior it keeps the width from zero, and
unlike it leaves widths that the logs tell as they are. Whether the logs tell of a difference at
all, the plain likelihood ratio says, and the fit where they do not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import count
from typing import Any, NamedTuple

import numpy as np

from diffthrust._support.names import listing
from diffthrust._support.report import Rows, Section
from diffthrust._support.words import number, with_error
from diffthrust.estimation._estimate import Estimate
from diffthrust.estimation._likelihood import Quadratic
from diffthrust.estimation._multistart import Search
from diffthrust.estimation._problem import Problem

_ROUNDS = 12
"""Numerics: the optimum is followed to its widths, and the widths to the optimum, so many times."""
_SETTLED = 1e-3
"""Numerics: they agree where a round changes the widths by less than this share."""
_NARROW, _WIDE = 1e-2, 1e4
"""Numerics: widths are sought between so many standard errors of a value by its log alone."""
_TELLING = 2.71
"""Twice the logarithm of the likelihood ratio above which logs tell of a difference: the 5 % point
of a width that is zero or not, where chance gives zero half the time (Self & Liang 1987)."""
_NINETY = 2.71
"""The same for the ends of a 90 % interval."""


@dataclass(frozen=True)
class PerLog:
    """A parameter that differs by log, after a fit.

    Args:
        mean: of all logs.
        width: the standard deviation of the values about it, in their unit; of a "log" parameter
            that of the logarithm.
        width_range: the 90 % interval of the width, by its likelihood; from zero where the logs do
            not tell of a difference.
        values: the value of each training log, by its name. Its standard error takes the width as
            known.
        ratio: twice the logarithm of the likelihood ratio of that width and of none.
        relative: the width is that of the logarithm: a share of the value, without a unit.

    Example:
        >>> model = dft.Thruster().fix("alpha", "beta")
        >>> fit = dft.fit(model, [log, unseen], per_log=["ct"], starts=1)
        >>> ct = fit.per_log["ct"]
        >>> [*ct.values], ct.values["run1.csv"].std_error < 0.01
        (['run1.csv', 'run2.csv'], True)
        >>> ct.tells  # the runs have the same thruster
        False
        >>> ct.shown_width[2]
        '%'
        >>> list(ct.to_json())
        ['mean', 'width', 'width_range', 'width_unit', 'ratio', 'values']
    """

    mean: Estimate
    width: float
    width_range: tuple[float, float]
    values: Mapping[str, Estimate]
    ratio: float
    relative: bool = False

    @property
    def shown_width(self) -> tuple[float, tuple[float, float], str]:
        """The width, its interval and their unit for people."""
        per, unit = (100.0, "%") if self.relative else (self.mean.per, self.mean.shown[2])
        low, high = self.width_range
        return per * self.width, (per * low, per * high), unit

    @property
    def tells(self) -> bool:
        """Whether these logs tell that it differs, at a false-alarm rate of 5 %."""
        return self.ratio > _TELLING

    def to_json(self) -> dict[str, Any]:
        """Plain data, in the parameter's unit and in that for people."""
        return {
            "mean": self.mean.to_json(),
            "width": self.width,
            "width_range": list(self.width_range),
            "width_unit": "" if self.relative else self.mean.unit,
            "ratio": self.ratio,
            "values": {log: value.to_json() for log, value in self.values.items()},
        }


class _Spread(NamedTuple):
    """What the logs say of the coordinates of parameters that differ, all else integrated out."""

    information: np.ndarray  # of the logs, ``(k, k)``,
    linear: np.ndarray  # its linear term, ``(k,)``,
    groups: np.ndarray  # and the parameter of each coordinate, ``(k,)``

    def ratio(self, widths: np.ndarray) -> float:
        """Twice the logarithm of the likelihood ratio of some widths and of none."""
        d = widths[self.groups]
        inner = np.eye(d.size) + d[:, None] * self.information * d
        pulled = d * self.linear
        return float(pulled @ np.linalg.solve(inner, pulled) - np.linalg.slogdet(inner)[1])

    def errors(self, count: int) -> np.ndarray:
        """The standard error of a value by its log alone, about the mean of all, by parameter."""
        diagonal = np.diagonal(self.information)
        sums = np.array([diagonal[self.groups == i].sum() for i in range(count)])
        logs = np.bincount(self.groups, minlength=count)
        return np.sqrt(np.maximum(logs - 1, 1) / np.where(sums > 0, sums, 1.0))


def with_widths(search: Search) -> Search:
    """The search carried on until the widths of what differs by log are those of the optimum.

    The best alone finds the widths, a few steps at a time, and only then do its rivals follow: of a
    boat in another current in each log all optima crept to their ends at each of twelve widths,
    for three minutes of a refit.
    """
    names = [name for name, _ in search.problem.layout.per_log]
    ended = False
    for i in range(_ROUNDS if names else 0):
        if not np.isfinite(search.best.cost):
            break
        problem = search.problem
        old = _widths(problem)
        new = _likeliest(_spread(problem, search.best.z, search.best.quadratic), old)
        settled = bool(np.all(np.abs(np.log(new / old)) < _SETTLED))
        if settled and ended:
            break
        problem = _with(problem, dict(zip(names, new, strict=True)))
        ended = settled or i == _ROUNDS - 1
        search = search.followed(problem, with_guesses=False) if ended else search.moved(problem)
    return search


def _with(problem: Problem, widths: Mapping[str, float]) -> Problem:
    """The problem with other widths, in coordinates."""
    varying = dict(problem.numbers.varying)
    fields = {}
    for name, width in widths.items():
        varying[name] = replace(varying[name], width=np.asarray(width, float))
        fields[name] = {"width": float(width * varying[name].scale)}
    numbers = replace(problem.numbers, varying=varying)
    return replace(problem, model=problem.model.replace(fields), numbers=numbers)


def _widths(problem: Problem) -> np.ndarray:
    """The widths of what differs by log, in coordinates."""
    return np.array([float(problem.numbers.varying[n].width) for n, _ in problem.layout.per_log])


def _coordinates(problem: Problem) -> np.ndarray:
    """The places of the coordinates of what differs by log, ``(logs, parameters)``."""
    count = len(problem.layout.per_log)
    ends = np.array([problem.places[k] + problem.each for k in range(len(problem.records))])
    return ends[:, None] + np.arange(-count, 0)


def _spread(problem: Problem, z: np.ndarray, q: Quadratic) -> _Spread:
    places = _coordinates(problem)
    ours, groups = places.ravel(), np.tile(np.arange(places.shape[1]), places.shape[0])
    tight = _widths(problem)[groups] ** -2.0
    information, gradient = np.array(q.information), np.array(q.gradient)
    information[ours, ours] -= tight
    gradient[ours] -= tight * z[ours]
    if problem.turn is not None:  # a value at a bound does not move with the mean, nor tell of it
        held = problem.turn.at_bound(z)[ours]
        moved = np.eye(z.size)
        moved[ours[held]] = problem.turn.matrix[ours[held]]
        moved[ours[held], ours[held]] = 0.0
        information, gradient = moved.T @ information @ moved, moved.T @ gradient
        ours, groups = ours[~held], groups[~held]
    low, high = problem.limits()
    length = np.sqrt(np.maximum(np.diagonal(information), 0.0))
    free = (z > low + 1e-9) & (z < high - 1e-9) & (length > 0)
    free[ours] = False
    others = np.flatnonzero(free)
    cross = information[np.ix_(ours, others)] / length[others]
    block = information[np.ix_(others, others)] / np.outer(length[others], length[others])
    through = cross @ np.linalg.pinv(block, rcond=1e-12, hermitian=True)
    own = information[np.ix_(ours, ours)] - through @ cross.T
    linear = own @ z[ours] - gradient[ours] + through @ (gradient[others] / length[others])
    return _Spread(0.5 * (own + own.T), linear, groups)


def _likeliest(spread: _Spread, first: np.ndarray) -> np.ndarray:
    """The widths of the largest restricted likelihood, which is kept from zero; see above."""
    from scipy.optimize import minimize  # slow to import

    errors = spread.errors(first.size)

    def loss(logs: np.ndarray) -> float:
        widths = np.exp(logs) * errors
        return -0.5 * spread.ratio(widths) + 0.5 * float(np.sum(np.log1p((errors / widths) ** 2)))

    ends = np.log([_NARROW, _WIDE])
    begun = [np.clip(np.log(first / errors), *ends), *(np.full(first.size, s) for s in (0.0, 2.5))]
    ended = [minimize(loss, at, bounds=[tuple(ends)] * first.size, tol=1e-12) for at in begun]
    widths = np.exp(min(ended, key=lambda result: result.fun).x) * errors
    # one value alone, where all others are at a bound, tells of no width
    return np.where(np.bincount(spread.groups, minlength=first.size) < 2, first, widths)


def _width_range(spread: _Spread, widths: np.ndarray, i: int) -> tuple[float, float]:
    """The 90 % interval of one width, the others as they are, by the plain likelihood."""
    low, high = np.log([_NARROW, _WIDE])
    grid = np.exp(np.linspace(low, high, 400)) * spread.errors(widths.size)[i]
    others = np.arange(widths.size) != i
    ratios = [spread.ratio(np.where(others, widths, width)) for width in grid]
    inside = grid[np.array(ratios) >= max(ratios) - _NINETY]
    return 0.0 if inside[0] == grid[0] else float(inside[0]), float(inside[-1])


def per_log_of(
    problem: Problem,
    z: np.ndarray,
    q: Quadratic,
    covariance: np.ndarray,
    means: Mapping[str, Estimate],
) -> dict[str, PerLog]:
    """What a fit reports of its numbers by log, from its optimum and the likelihood there.

    ``covariance`` is of all coordinates, ``(n, n)``; NaN where there is none. ``means`` are the
    estimates of the parameters.
    """
    out: dict[str, PerLog] = {}
    if not problem.layout.per_log or not np.isfinite(q.cost):
        return out
    spread, numbers = _spread(problem, z, q), problem.numbers_by_log(z)
    places = _coordinates(problem)
    widths = _widths(problem)
    held = np.zeros(z.size, bool) if problem.turn is None else problem.turn.at_bound(z)
    for i, (name, transform) in enumerate(problem.layout.per_log):
        kind = problem.numbers.varying[name]
        without = widths.copy()
        without[i] = 0.0
        values = {}
        for k, label in enumerate(_labels(problem)):
            value = numbers[k][name]
            together = [places[k, i]]
            if problem.turn is None and name in problem.free:
                together.append(problem.free.index(name))
            slope = value if transform == "log" else float(kind.scale)
            variance = covariance[np.ix_(together, together)].sum() * slope**2
            error = float(np.sqrt(variance)) if variance > 0 else None
            values[label] = replace(
                means[name],
                value=value,
                std_error=error,
                fixed=False,
                at_bound=bool(held[places[k, i]]),
            )
        low, high = _width_range(spread, widths, i)
        out[name] = PerLog(
            mean=means[name],
            width=float(widths[i] * kind.scale),
            width_range=(low * float(kind.scale), high * float(kind.scale)),
            values=values,
            ratio=spread.ratio(widths) - spread.ratio(without),
            relative=transform == "log",
        )
    return out


def _labels(problem: Problem) -> list[str]:
    """The names of the logs; of logs of one name the later ones are numbered."""
    names = [record.name for record in problem.records]
    labels: list[str] = []
    for name in names:
        numbered = (f"{name} ({i})" for i in count(2))
        taken = {*labels, *names}
        labels.append(name if name not in labels else next(n for n in numbered if n not in taken))
    return labels


def per_log_notes(per_log: Mapping[str, PerLog]) -> tuple[str, ...]:
    """A sentence where the logs do not tell that something differs."""
    silent = [name for name, entry in per_log.items() if not entry.tells]
    ratios = ", ".join(number(max(0.0, per_log[name].ratio), 2) for name in silent)
    if not silent:
        return ()
    return (
        f"These logs do not tell that {listing(silent)} differs by log (likelihood ratio {ratios}, "
        f"{_TELLING} needed for 5 %): one value for all, without per_log, explains them as well. "
        "The width given is what may be hidden, not zero.",
    )


def per_log_section(per_log: Mapping[str, PerLog], title: str = "") -> Section:
    """The value of each log, after the mean and the width of all."""
    blocks = []
    for name, entry in per_log.items():
        size, spread, unit = entry.mean.shown
        width, ends, width_unit = entry.shown_width
        low, high = (number(end, 2) for end in ends)
        rows = [(name, "mean of all", *with_error(size, spread), unit)]
        rows.append((name, "width", number(width, 2), f"{low} to {high}", width_unit))
        for log, value in entry.values.items():
            rows.append((name, log, *with_error(*value.shown[:2]), unit))
        blocks.append(tuple(rows))
    headings = ("By log", "Log", "Value", "Std error", "Unit")
    return Section(title, Rows(headings, tuple(blocks), numbers=(2, 3)))
