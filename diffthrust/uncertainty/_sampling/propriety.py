"""Detect improper posteriors: flat priors without bounds where the logs exclude no value."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from diffthrust._support.words import number, percent
from diffthrust.models._base.parameter import Parameter
from diffthrust.uncertainty._profile import optimum_at
from diffthrust.uncertainty._profile_walk import DeeperError, ParameterLine, walk
from diffthrust.uncertainty._sampling.posterior import Posterior

_REACH = math.sqrt(2.0 * 20.0)
"""A profile that falls by 20 in log-likelihood has ended: e^-20 over the 35 e-foldings of a
logarithm is 1e-4 of a peak as narrow as a thousandth."""
_SHARE = 1e-4
"""A side is open if this share of the density lies in the outer half of its range."""


class OpenEnd(NamedTuple):
    """One side of a parameter on which its posterior is not integrable."""

    name: str
    upper: bool
    fall: float
    """Of the log-likelihood from its maximum to the far end."""
    far: float
    """The value halfway (in the coordinate) to the numerical end."""
    drawn: float
    """Share of the draws beyond that."""

    def __str__(self) -> str:
        side = "above" if self.upper else "below"
        drawn = f" {percent(self.drawn)} of the draws lie beyond." if self.drawn else ""
        return (
            f"'{self.name}' has a flat prior without a bound {side}, and its log-likelihood falls "
            f"by {self.fall:.2g} on that side, then no more: {number(self.far)} is as good a value "
            f"as one beyond it.{drawn}"
        )


def open_ends(posterior: Posterior, points: np.ndarray) -> tuple[OpenEnd, ...]:
    """Sides on which a flat prior is unbounded and the likelihood does not fall off.

    The density is integrated along the profile of the parameter up to the numerical end of the
    coordinate. If the likelihood levels off at a finite value, this integral grows without limit:
    the posterior is improper, however well the chains agree. For example, chains agreed on a mean
    mass of 1e14 kg. If it levels off so low that no draw would ever notice, that does not matter;
    the limit is 1 in 10 000 in the outer half of the range. ``points`` are draws, ``(..., d)``.

    Source: Gelman et al. 2013, Bayesian Data Analysis, section 2.8 (improper priors); Raue et al.
    2009, Bioinformatics 25, 1923 (profiles that flatten out).
    """
    problem = posterior.problem
    best = optimum_at(problem, posterior.base)
    ends = []
    for column, place in enumerate(posterior.moved):
        if place >= len(problem.own):
            break
        name = problem.free[place]
        drawn = points[..., column].ravel()
        for upper in _endless(problem.named[name]):
            limit = float((posterior.high if upper else posterior.low)[column])
            end = _far_out(ParameterLine(problem, name, best), upper, limit, drawn)
            if end is not None:
                ends.append(end)
    return tuple(ends)


def _endless(p: Parameter) -> Iterator[bool]:
    """The sides without bound or prior: lower (False) and upper (True)."""
    if p.prior is None:
        low, high = p.limits
        if low == -math.inf or (p.transform == "log" and low <= 0.0):
            yield False
        if high == math.inf:
            yield True


def _far_out(line: ParameterLine, upper: bool, limit: float, drawn: np.ndarray) -> OpenEnd | None:
    """The open end on one side, if it is open."""
    sign = 1.0 if upper else -1.0
    try:
        side = walk(line, sign, _REACH)
    except DeeperError:  # a better optimum, which the fit missed: not a matter of propriety
        return None
    # only a walk that ends without a fall of 20 leaves the side open
    if side.why not in ("bound", "flat"):
        return None
    x = np.array([point.x for point in side.points])
    fall = np.array([point.cost for point in side.points]) - side.points[0].cost
    span = sign * ((limit if math.isfinite(limit) else x[-1]) - x[0])
    grid = np.linspace(0.0, span, 20_001)
    # the root of the fall is interpolated, since it is nearly linear between points
    density = np.exp(-(np.interp(grid, sign * (x - x[0]), np.sqrt(np.maximum(fall, 0.0))) ** 2))
    share = float(np.sum(density[grid > 0.5 * span]) / np.sum(density))
    beyond = float(np.mean(sign * (drawn - x[0]) > 0.5 * span))
    if max(share, beyond) < _SHARE:
        return None
    far = line.value(x[0] + sign * 0.5 * span)
    return OpenEnd(line.name, upper, float(fall[-1]), far, beyond)


def improper_message(posterior: Posterior, points: np.ndarray) -> str:
    """The result of `open_ends` in words, with lines that add priors; empty if proper."""
    ends = open_ends(posterior, points)
    if not ends:
        return ""
    names = list(dict.fromkeys(end.name for end in ends))
    return "\n".join(["There is no posterior.", *map(str, ends), _mend(posterior, names)])


def _mend(posterior: Posterior, names: list[str]) -> str:
    """Lines that add weakly informative priors: the first guess with its magnitude as deviation."""
    problem, priors, lines = posterior.problem, [], []
    for name in names:
        value = problem.values(posterior.base)[name]
        mean = posterior.fit.guess.get(name, value)
        std = max(abs(mean), abs(value - mean)) or problem.named[name].scale
        numbers = f"mean={mean:.3g}, std={std:.3g}"
        priors.append(f'"{name}": {{"prior": dft.Normal({numbers})}}')
        key = f'"{name}"' if "." in name else name
        lines.append(f"{key} = {{ prior = {{ {numbers.replace('=', ' = ')} }} }}")
    return (
        "Give a prior of what you know. A weak one is the first guess, as uncertain as itself:\n"
        f"fit = dft.fit(fit.model.replace({{{', '.join(priors)}}}), logs)\n"
        "or, below [parameters] of the spec:\n" + "\n".join(lines)
    )
