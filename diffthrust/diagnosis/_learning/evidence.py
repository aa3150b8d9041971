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

from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit, side_by_side
from diffthrust.diagnosis._learning.ground import left_over
from diffthrust.diagnosis._learning.hypotheses import Hypothesis, hypothesis
from diffthrust.diagnosis._learning.sight import Added, Sight
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


def likely_curves(
    trials: CandidateFitter, trial: TrialFit, laws: Iterable[Hypothesis]
) -> list[LikelyCurve]:
    """The laws for which there is evidence, with their curves, the likeliest first."""
    passing = trials.readings(trial)
    chunks = side_by_side(
        lambda chunk: _judged(trials, trial, chunk, [log[chunk[0].port] for log in passing]),
        list(_together(laws)),
    )
    likely = (curve for chunk in chunks for curve in chunk if curve.evidence > 0)
    return sorted(likely, key=lambda curve: -curve.evidence)


def sharpened(
    trials: CandidateFitter, trial: TrialFit, regressors: Sight, likely: LikelyCurve
) -> LikelyCurve:
    """A law that remembers over the time, or the width, that makes one-step errors likeliest."""
    from scipy.optimize import minimize_scalar  # slow to import

    law, parameters = likely.law, likely.law.parameters
    if law.straight or len(parameters) != 1:
        return likely
    (name,), passing = parameters, [port_log[law.port] for port_log in regressors.now.ports]
    initial, (low, high) = parameters[name]["value"], parameters[name]["bounds"]
    tried = {initial: likely}

    def loss(exponent: float) -> float:
        value = float(np.exp(exponent))
        values = {name: {**parameters[name], "value": value}}
        at = hypothesis(regressors, law.port, law.signal, law.times, values)
        judged = _judged(trials, trial, [at], passing)
        tried.update((value, port_log) for port_log in judged)
        return -judged[0].evidence if judged else 0.0

    ends = max(low, initial / _APART), min(high, initial * _APART)
    minimize_scalar(loss, bounds=np.log(ends), method="bounded", options=_SEARCH)
    return max(tried.values(), key=lambda port_log: port_log.evidence)


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
    trials: CandidateFitter,
    trial: TrialFit,
    laws: Sequence[Hypothesis],
    passing: Sequence[np.ndarray],
) -> list[LikelyCurve]:
    drawn = [drawing for law in laws if (drawing := _drawn(law, passing))]
    if not drawn:
        return []
    evidence = left_over(trials, trial, laws[0].port, [drawing.added for drawing in drawn])
    curves = []
    for (law, plain, level, _), information in zip(drawn, evidence, strict=True):
        held = law.straight & (np.arange(len(plain.coefficients)) != _SLOPE)
        best = _stiffness(*information, level, held)
        fixed = zip(plain.coefficients, best.shared, strict=True)
        arguments = {"size": best.size, "bend": best.bend, "shape": tuple(map(float, best.shape))}
        arguments["held"] = [n for n, out in fixed if out]
        curves.append(LikelyCurve(law, Curve(**{**plain.arguments, **arguments}), best.evidence))
    return curves


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
    information: np.ndarray,
    gradient: np.ndarray,
    prior_information: np.ndarray,
    level: float,
    held: np.ndarray | bool = False,
) -> _Stiffness:
    shared = held | (np.diagonal(information) < _SHARED * prior_information)
    information, gradient = (
        np.where(shared | shared[:, None], 0.0, information),
        np.where(shared, 0.0, gradient),
    )
    if not np.all(
        np.isfinite(information) & np.isfinite(gradient)
    ):  # answers that overflow are no evidence
        return _Stiffness(-np.inf, 1.0, 1.0, np.zeros(len(information)), shared)
    sizes, bends = (grid.ravel() for grid in np.meshgrid(_SIZES * level, _BENDS, indexing="ij"))
    widths = np.repeat(bends[:, None], len(information), axis=1)
    widths[:, :2] = 1.0, 2.0
    widths *= sizes[:, None]
    inner = np.eye(len(information)) + widths[:, :, None] * information * widths[:, None, :]
    slopes = widths * gradient
    steps = -np.linalg.solve(inner, slopes[..., None])[..., 0]
    evidence = -0.5 * np.sum(slopes * steps, axis=1) - 0.5 * np.linalg.slogdet(inner)[1]
    k = int(np.argmax(evidence))
    shape = widths[k] * steps[k]
    return _Stiffness(float(evidence[k]), float(sizes[k]), float(bends[k]), shape, shared)
