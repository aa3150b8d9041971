"""Curves of unknown form, held against one-step errors: how stiff, and how likely each is.

Along the path of a trial the errors answer linearly to the coefficients of a curve at a port. These
have normal priors, whose widths say how large and how stiff the curve is: those are taken that make
the errors likeliest with the coefficients integrated out (of smoothing splines: Wahba 1985; Wood
2011). The logarithm of that likelihood over the one without a curve is its evidence; of a curve
that the estimated parameters could be themselves there is none.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from diffthrust.diagnosis._learning.ground import left_over
from diffthrust.diagnosis._learning.hypotheses import Hypothesis, hypothesis
from diffthrust.diagnosis._learning.sight import Added, Sight
from diffthrust.diagnosis._trials import TrialFit, Trials, side_by_side
from diffthrust.effects._curve import Curve
from diffthrust.models._base.made_effect import ARRIVING

_BENDS = np.geomspace(0.01, 30.0, 15)
"""Stiffnesses that are tried: standard deviations of the bends, over the curve's size."""
_SIZES = np.geomspace(0.003, 1.0, 6)
"""Sizes of the curve that are tried, over what passes the port (one, where it scales that)."""
_SHARED = 0.01
"""A coefficient of which the estimated parameters leave less than this does what they do already,
and is held at nothing."""

_APART = 5.0
"""A time or a width is sought within so many times its first guess,"""
_SEARCH = {"maxiter": 10, "xatol": 0.03}
"""to such a share of itself."""
_MOST, _SAMPLES = 11, 1e5
"""So many laws are carried through the logs at a time (of each the series are as many), or as have
no more samples together."""
_SLOPE = 1
"""Which of the coefficients of a curve is its slope."""


class LikelyCurve(NamedTuple):
    """A curve that one-step errors ask for.

    Args:
        law: where it acts and on what.
        curve: with its coefficients at their linear estimates.
        evidence: logarithm of the likelihood ratio, with the coefficients integrated out.
    """

    law: Hypothesis
    curve: Curve
    evidence: float


def likely_curves(trials: Trials, trial: TrialFit, laws: Iterable[Hypothesis]) -> list[LikelyCurve]:
    """The laws for which there is evidence, with their curves, the likeliest first."""
    passing = trials.readings(trial)
    found = side_by_side(
        lambda some: _judged(trials, trial, some, [log[some[0].port] for log in passing]),
        list(_together(laws)),
    )
    likely = (one for some in found for one in some if one.evidence > 0)
    return sorted(likely, key=lambda one: -one.evidence)


def sharpened(trials: Trials, trial: TrialFit, seen: Sight, likely: LikelyCurve) -> LikelyCurve:
    """A law that remembers over the time, or the width, that makes one-step errors likeliest."""
    from scipy.optimize import minimize_scalar  # slow to import

    law, own = likely.law, likely.law.parameters
    if law.straight or len(own) != 1:
        return likely
    (name,), passing = own, [one[law.port] for one in seen.now.ports]
    begun, (low, high) = own[name]["value"], own[name]["bounds"]
    tried = {begun: likely}

    def loss(exponent: float) -> float:
        value = float(np.exp(exponent))
        told = {name: {**own[name], "value": value}}
        at = hypothesis(seen, law.port, law.signal, law.times, told)
        found = _judged(trials, trial, [at], passing)
        tried.update((value, one) for one in found)
        return -found[0].evidence if found else 0.0

    ends = max(low, begun / _APART), min(high, begun * _APART)
    minimize_scalar(loss, bounds=np.log(ends), method="bounded", options=_SEARCH)
    return max(tried.values(), key=lambda one: one.evidence)


class _Drawn(NamedTuple):
    """A law with the curve that it begins with, and what its coefficients add, log by log."""

    law: Hypothesis
    plain: Curve
    level: float
    added: Added


def _drawn(law: Hypothesis, passing: Sequence[np.ndarray]) -> _Drawn | None:
    pooled = np.concatenate(law.over)
    ends = float(pooled.min()), float(pooled.max())
    level = _level(passing) if law.times != ARRIVING else 1.0
    if law.factor is not None and law.times != ARRIVING:
        level /= max(_level(law.factor), 1e-300)
    if not 0 < level < np.inf:
        return None
    parameters: dict[str, Any] = dict(law.parameters)
    plain = Curve(law.port, law.signal, *ends, times=law.times, **parameters)
    return _Drawn(law, plain, level, law.added(plain))


def _together(laws: Iterable[Hypothesis]) -> Iterator[list[Hypothesis]]:
    """Laws of one port, as many as are carried through the logs at a time."""
    by_port = sorted(laws, key=lambda law: law.port)
    for _, one_port in groupby(by_port, key=lambda law: law.port):
        same = list(one_port)
        samples = sum(over.size for over in same[0].over)
        most = int(np.clip(_SAMPLES / samples, 1, _MOST))
        yield from (same[at : at + most] for at in range(0, len(same), most))


def _judged(
    trials: Trials, trial: TrialFit, laws: Sequence[Hypothesis], passing: Sequence[np.ndarray]
) -> list[LikelyCurve]:
    drawn = [one for law in laws if (one := _drawn(law, passing))]
    if not drawn:
        return []
    known = left_over(trials, trial, laws[0].port, [one.added for one in drawn])
    found = []
    for (law, plain, level, _), known_of in zip(drawn, known, strict=True):
        held = law.straight & (np.arange(len(plain.coefficients)) != _SLOPE)
        best = _stiffness(*known_of, level, held)
        own = zip(plain.coefficients, best.shared, strict=True)
        told = {"size": best.size, "bend": best.bend, "shape": tuple(map(float, best.shape))}
        told["held"] = [n for n, out in own if out]
        found.append(LikelyCurve(law, Curve(**{**plain.arguments, **told}), best.evidence))
    return found


def _level(series: Sequence[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(series) ** 2)))


class _Stiffness(NamedTuple):
    """The likeliest widths of the priors, the coefficients, and which others do their work."""

    evidence: float
    size: float
    bend: float
    shape: np.ndarray
    shared: np.ndarray


def _stiffness(
    left: np.ndarray,
    clear: np.ndarray,
    alone: np.ndarray,
    level: float,
    held: np.ndarray | bool = False,
) -> _Stiffness:
    shared = held | (np.diagonal(left) < _SHARED * alone)
    left, clear = np.where(shared | shared[:, None], 0.0, left), np.where(shared, 0.0, clear)
    if not np.all(np.isfinite(left) & np.isfinite(clear)):  # answers that overflow are no evidence
        return _Stiffness(-np.inf, 1.0, 1.0, np.zeros(len(left)), shared)
    sizes, bends = (grid.ravel() for grid in np.meshgrid(_SIZES * level, _BENDS, indexing="ij"))
    widths = np.repeat(bends[:, None], len(left), axis=1)
    widths[:, :2] = 1.0, 2.0
    widths *= sizes[:, None]
    inner = np.eye(len(left)) + widths[:, :, None] * left * widths[:, None, :]
    slopes = widths * clear
    steps = -np.linalg.solve(inner, slopes[..., None])[..., 0]
    evidence = -0.5 * np.sum(slopes * steps, axis=1) - 0.5 * np.linalg.slogdet(inner)[1]
    k = int(np.argmax(evidence))
    shape = widths[k] * steps[k]
    return _Stiffness(float(evidence[k]), float(sizes[k]), float(bends[k]), shape, shared)
