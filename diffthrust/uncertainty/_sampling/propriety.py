"""Whether a posterior has an end: flat priors without bounds, where the logs exclude no value."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from diffthrust._support.words import number, percent
from diffthrust.models._base.parameter import Parameter
from diffthrust.uncertainty._profile import optimum_at
from diffthrust.uncertainty._profile_lines import ParameterLine
from diffthrust.uncertainty._profile_walk import DeeperError, walk
from diffthrust.uncertainty._sampling.posterior import Posterior

_REACH = math.sqrt(2.0 * 20.0)
"""A profile that falls by 20 in log-likelihood has ended: e^-20 over all of the 35 that a logarithm
may go is 1e-4 of a peak as narrow as a thousandth."""
_SHARE = 1e-4
"""Share of the density far out from which an end counts as open."""


class OpenEnd(NamedTuple):
    """One side of a parameter on which nothing ends its posterior.

    Args:
        name: of the parameter.
        upper: whether the side is that of larger values.
        fall: what the log-likelihood falls by from its highest value to the far end.
        far: the value half of the way (in the coordinate) to where the numbers end.
        drawn: share of the draws beyond it.
    """

    name: str
    upper: bool
    fall: float
    far: float
    drawn: float

    def __str__(self) -> str:
        side = "above" if self.upper else "below"
        drawn = f" {percent(self.drawn)} of the draws lie beyond." if self.drawn else ""
        return (
            f"'{self.name}' has a flat prior without a bound {side}, and its log-likelihood falls "
            f"by {self.fall:.2g} on that side, then no more: {number(self.far)} is as good a value "
            f"as one beyond it.{drawn}"
        )


def open_ends(posterior: Posterior, points: np.ndarray) -> tuple[OpenEnd, ...]:
    """The sides on which a flat prior has no end and the likelihood does not make one.

    Along the profile of the parameter (all others at their best) the density is integrated up to
    the numerical end of the coordinate. A likelihood that comes to rest at a finite value makes
    this integral grow without end with the range: no posterior exists, whatever the chains say of
    each other. Where it comes to rest so low that no draw will ever find out, that is no matter;
    the line is drawn at 1 in 10 000 in the outer half of the range.

    Args:
        posterior: whose coordinates are asked.
        points: draws of them, ``(..., d)``.

    Source: Gelman et al. 2013, Bayesian Data Analysis, section 2.8 (improper priors); Raue et al.
    2009, Bioinformatics 25, 1923 (profiles that flatten out).

    Example:
        >>> for end in open_ends(posterior_of(fit, logs), chains.points):
        ...     print(end)
    """
    problem = posterior.problem
    best = optimum_at(problem, posterior.base)
    found = []
    for column, place in enumerate(posterior.moved):
        if place >= len(problem.own):
            break
        name = problem.free[place]
        drawn = points[..., column].ravel()
        for upper in _endless(problem.named[name]):
            limit = float((posterior.high if upper else posterior.low)[column])
            end = _far_out(ParameterLine(problem, name, best), upper, limit, drawn)
            if end is not None:
                found.append(end)
    return tuple(found)


def _endless(p: Parameter) -> Iterator[bool]:
    """The sides without bound or prior, the lower (False) and the upper (True)."""
    if p.prior is None:
        low, high = p.limits
        if low == -math.inf or (p.transform == "log" and low <= 0.0):
            yield False
        if high == math.inf:
            yield True


def _far_out(line: ParameterLine, upper: bool, limit: float, drawn: np.ndarray) -> OpenEnd | None:
    """The open end on one side, up to the coordinate at which the sampler stops, if it is open."""
    sign = 1.0 if upper else -1.0
    try:
        side = walk(line, sign, _REACH)
    except DeeperError:  # an optimum that the fit missed: this side is not where it matters
        return None
    if side.why not in ("bound", "flat"):
        return None
    x = np.array([point.x for point in side.points])
    fall = np.array([point.cost for point in side.points]) - side.points[0].cost
    span = sign * ((limit if math.isfinite(limit) else x[-1]) - x[0])
    grid = np.linspace(0.0, span, 20_001)
    # the root of the fall is nearly straight between the points, as the walk has it
    density = np.exp(-(np.interp(grid, sign * (x - x[0]), np.sqrt(np.maximum(fall, 0.0))) ** 2))
    share = float(np.sum(density[grid > 0.5 * span]) / np.sum(density))
    beyond = float(np.mean(sign * (drawn - x[0]) > 0.5 * span))
    if max(share, beyond) < _SHARE:
        return None
    far = line.value(x[0] + sign * 0.5 * span)
    return OpenEnd(line.name, upper, float(fall[-1]), far, beyond)


def told_improper(posterior: Posterior, points: np.ndarray) -> str:
    """What `open_ends` finds, in words, with the lines that mend it; empty where all is well."""
    ends = open_ends(posterior, points)
    if not ends:
        return ""
    names = list(dict.fromkeys(end.name for end in ends))
    return "\n".join(["There is no posterior.", *map(str, ends), _mend(posterior, names)])


def _mend(posterior: Posterior, names: list[str]) -> str:
    """The lines that give weakly informative priors: the first guess, as uncertain as itself."""
    problem, priors, lines = posterior.problem, [], []
    for name in names:
        value = problem.values(posterior.base)[name]
        mean = posterior.fit.guess.get(name, value)
        std = max(abs(mean), abs(value - mean)) or problem.named[name].scale
        told = f"mean={mean:.3g}, std={std:.3g}"
        priors.append(f'"{name}": {{"prior": dft.Normal({told})}}')
        key = f'"{name}"' if "." in name else name
        lines.append(f"{key} = {{ prior = {{ {told.replace('=', ' = ')} }} }}")
    return (
        "Give a prior of what you know. A weak one is the first guess, as uncertain as itself:\n"
        f"fit = dft.fit(fit.model.replace({{{', '.join(priors)}}}), logs)\n"
        "or, below [parameters] of the spec:\n" + "\n".join(lines)
    )
