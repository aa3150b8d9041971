"""What one-step errors, or whole runs, say of any shape of a law over its signal.

The errors answer linearly to a law at a port, so those to a fine spline basis tell how much
likelier any shape makes them, with nothing to be carried through the logs again.

Curves of unknown form, held against one-step errors: how stiff, and how likely each is.

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
from jaxtyping import Float

from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit, side_by_side
from diffthrust.diagnosis._learned import LearnedLaw
from diffthrust.diagnosis._unknown_term.terms import PortSeries, Regressors, Term, term_along
from diffthrust.effects._curve import Curve
from diffthrust.models._base.made_effect import ARRIVING
from diffthrust.models._base.model import Model

_FINE_PIECES = 29
_GRID_POINTS = 241
_WAY_TO_BOUND = 0.9
"""Beside another shape a parameter goes no further than this share of the way to its bound."""


class LinearizedEvidence(NamedTuple):
    """What errors say of the shapes of a law.

    Args:
        x: values of its signal, all over the range of the logs.
        onto: gives the coefficients of the fine basis by which a shape over ``x`` is met.
        left: information on these, less what the model's own parameters do.
        clear: gradient of the negative logarithm of the likelihood by them, likewise.
        reference: root mean square of the signal.
    """

    x: Float[np.ndarray, " N"]
    onto: Float[np.ndarray, "K N"]
    left: Float[np.ndarray, "K K"]
    clear: Float[np.ndarray, " K"]
    reference: float

    def gain(self, shape: Float[np.ndarray, " N"]) -> tuple[float, float]:
        """The likelihood ratio for a shape at its best amplitude, and that amplitude."""
        weights = self.onto @ shape
        curvature = float(weights @ self.left @ weights)
        scale = float(np.sum((weights @ self.left) ** 2)) ** 0.5
        slope = float(weights @ self.clear)
        if not curvature > 1e-12 * scale > 0.0:
            return 0.0, 0.0
        return slope**2 / curvature, -slope / curvature


def linearized_evidence(trials: CandidateFitter, trial: TrialFit, law: Term) -> LinearizedEvidence:
    """What the one-step errors of a trial say of the shapes of a law."""
    pooled = np.concatenate(law.over)
    low, high = float(pooled.min()), float(pooled.max())
    fine = Curve(law.port, "speed", low, high, pieces=_FINE_PIECES)
    ((information, gradient, _),) = projected_information(
        trials, trial, law.port, [law.added(fine)]
    )
    x = np.linspace(low, high, _GRID_POINTS)
    onto = np.linalg.pinv(fine.basis(x).T)
    return LinearizedEvidence(x, onto, information, gradient, float(np.sqrt(np.mean(pooled**2))))


def evidence_of_fit(law: LearnedLaw) -> LinearizedEvidence:
    """What whole runs say of the shapes of a law, to which a curve has been fitted."""
    curve, (which, covariance) = law.curve, law.coefficients()
    x = np.linspace(curve.low, curve.high, _GRID_POINTS)
    information = np.linalg.pinv(covariance, hermitian=True)
    estimated = np.array([getattr(curve, curve.coefficients[i]) for i in which])
    onto = np.linalg.pinv(curve.basis(x).T)[which]
    return LinearizedEvidence(
        x, onto, information, -information @ estimated, float(np.sqrt(np.mean(law.samples**2)))
    )


def model_beside(law: LearnedLaw, shape: Float[np.ndarray, " K"]) -> Model:
    """A law's model without its curve, as whole runs would have it with another.

    The other parameters go with its coefficients to first order: a curve may do a part of their
    work. They stay for what coefficients do that are held, because parameters can do it all.

    Args:
        law: the law; the covariance of the curve's coefficients must be finite.
        shape: the coefficients that are estimated, as `evidence_of_fit` meets a shape.
    """
    fit, curve, (which, _) = law.fit, law.curve, law.coefficients()
    named = fit.model.parameters
    aim = {f"{curve.name}.{curve.coefficients[i]}": to for i, to in zip(which, shape, strict=True)}
    finite = np.isfinite(np.diagonal(fit.covariance))
    # what its signal remembers stays as it is
    curve_indices = [
        i for i, n in enumerate(fit.free) if n.startswith(f"{curve.name}.") and finite[i]
    ]
    apart = [
        aim.get(n, named[n].value) - named[n].value for n in (fit.free[i] for i in curve_indices)
    ]
    weights = (
        np.linalg.pinv(fit.covariance[np.ix_(curve_indices, curve_indices)], hermitian=True) @ apart
    )
    values = {}
    for i, name in enumerate(fit.free):
        if name in named and finite[i] and i not in curve_indices:
            p = named[name]
            low, high = (p.value + _WAY_TO_BOUND * (end - p.value) for end in p.limits)
            moved = p.value + float(fit.covariance[i, curve_indices] @ weights)
            values[name] = float(np.clip(moved, low, high))
    return fit.model.replace(values) - curve.name


def projected_information(
    trials: CandidateFitter, trial: TrialFit, port: str, several: Sequence[PortSeries]
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Information and gradient of series at a port, less what the model's own parameters do.

    Args:
        trials: the fits.
        trial: the present model.
        port: where the series are added.
        several: sets of series.

    Returns:
        Of each the information left ``(K, K)``; the gradient ``(K,)``; the information of each
        series by itself.
    """
    response = trial.response
    now, end = (
        response.batched([np.concatenate(rows) for rows in zip(*when, strict=True)])
        for when in zip(*several, strict=True)
    )
    answers = response.to(port, now, end)
    estimated = [i for i, name in enumerate(trial.names) if name not in trials.nuisance]
    edges = np.cumsum([len(added.now[0]) for added in several])[:-1]
    apart = zip(*(np.split(batch, edges, axis=1) for batch in answers), strict=True)
    return [
        project_out(*response.scores(estimated, of_added), len(estimated)) for of_added in apart
    ]


def project_out(
    information: np.ndarray, scores: np.ndarray, base: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Information and gradient of what comes after the first ``base`` coordinates, less these."""
    nuisance, cross = information[:base, :base], information[base:, :base]
    through = cross @ np.linalg.pinv(nuisance, rcond=1e-11, hermitian=True)
    remaining = information[base:, base:] - through @ cross.T
    gradient = (scores[base:] - through @ scores[:base]).sum(axis=1)
    return remaining, gradient, np.diagonal(information)[base:]


_BENDS = np.geomspace(0.01, 30.0, 15)
"""Stiffnesses that are tried: standard deviations of the bends, over the curve's size."""
_SIZES = np.geomspace(0.003, 1.0, 6)
"""Sizes of the curve that are tried, over what passes the port (one, where it scales that)."""
_REDUNDANT = 0.01
"""A coefficient of which the estimated parameters leave less than this does what they do already,
and is held at nothing."""

_TUNING_RANGE = 5.0
"""A time or a width is sought within so many times its first guess,"""
_TUNING_OPTIONS = {"maxiter": 10, "xatol": 0.03}
"""to such a share of itself."""
_BATCH_TERMS, _BATCH_SAMPLES = 11, 1e5
"""So many laws are carried through the logs at a time (of each the series are as many), or as have
no more samples together."""
_SLOPE_INDEX = 1
"""Which of the coefficients of a curve is its slope."""


class LikelyCurve(NamedTuple):
    """A curve that one-step errors ask for.

    Args:
        law: where it acts and on what.
        curve: with its coefficients at their linear estimates.
        evidence: logarithm of the likelihood ratio, with the coefficients integrated out.
    """

    law: Term
    curve: Curve
    evidence: float


def likely_curves(
    trials: CandidateFitter, trial: TrialFit, laws: Iterable[Term]
) -> list[LikelyCurve]:
    """The laws for which there is evidence, with their curves, the likeliest first."""
    passing = trials.readings(trial)
    chunks = side_by_side(
        lambda chunk: _evidence_of(trials, trial, chunk, [log[chunk[0].port] for log in passing]),
        list(_batched(laws)),
    )
    likely = (curve for chunk in chunks for curve in chunk if curve.evidence > 0)
    return sorted(likely, key=lambda curve: -curve.evidence)


def tune_memory(
    trials: CandidateFitter, trial: TrialFit, regressors: Regressors, likely: LikelyCurve
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
        at = term_along(regressors, law.port, law.signal, law.times, values)
        judged = _evidence_of(trials, trial, [at], passing)
        tried.update((value, port_log) for port_log in judged)
        return -judged[0].evidence if judged else 0.0

    ends = max(low, initial / _TUNING_RANGE), min(high, initial * _TUNING_RANGE)
    minimize_scalar(loss, bounds=np.log(ends), method="bounded", options=_TUNING_OPTIONS)
    return max(tried.values(), key=lambda port_log: port_log.evidence)


class _CurveBasis(NamedTuple):
    """A law with the curve that it begins with, and what its coefficients add, log by log."""

    law: Term
    plain: Curve
    level: float
    added: PortSeries


def _with_basis(law: Term, passing: Sequence[np.ndarray]) -> _CurveBasis | None:
    pooled = np.concatenate(law.over)
    ends = float(pooled.min()), float(pooled.max())
    level = _rms(passing) if law.times != ARRIVING else 1.0
    if law.factor is not None and law.times != ARRIVING:
        level /= max(_rms(law.factor), 1e-300)
    if not 0 < level < np.inf:
        return None
    parameters: dict[str, Any] = dict(law.parameters)
    plain = Curve(law.port, law.signal, *ends, times=law.times, **parameters)
    return _CurveBasis(law, plain, level, law.added(plain))


def _batched(laws: Iterable[Term]) -> Iterator[list[Term]]:
    """Laws of one port, as many as are carried through the logs at a time."""
    by_port = sorted(laws, key=lambda law: law.port)
    for _, one_port in groupby(by_port, key=lambda law: law.port):
        same = list(one_port)
        samples = sum(over.size for over in same[0].over)
        most = int(np.clip(_BATCH_SAMPLES / samples, 1, _BATCH_TERMS))
        yield from (same[at : at + most] for at in range(0, len(same), most))


def _evidence_of(
    trials: CandidateFitter,
    trial: TrialFit,
    laws: Sequence[Term],
    passing: Sequence[np.ndarray],
) -> list[LikelyCurve]:
    drawn = [drawing for law in laws if (drawing := _with_basis(law, passing))]
    if not drawn:
        return []
    evidence = projected_information(
        trials, trial, laws[0].port, [drawing.added for drawing in drawn]
    )
    curves = []
    for (law, plain, level, _), information in zip(drawn, evidence, strict=True):
        held = law.straight & (np.arange(len(plain.coefficients)) != _SLOPE_INDEX)
        best = _marginal_likelihood(*information, level, held)
        fixed = zip(plain.coefficients, best.shared, strict=True)
        arguments = {"size": best.size, "bend": best.bend, "shape": tuple(map(float, best.shape))}
        arguments["held"] = [n for n, out in fixed if out]
        curves.append(LikelyCurve(law, Curve(**{**plain.arguments, **arguments}), best.evidence))
    return curves


def _rms(series: Sequence[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(series) ** 2)))


class _MarginalLikelihood(NamedTuple):
    """The likeliest widths of the priors, the coefficients, and which others do their work."""

    evidence: float
    size: float
    bend: float
    shape: np.ndarray
    shared: np.ndarray


def _marginal_likelihood(
    information: np.ndarray,
    gradient: np.ndarray,
    prior_information: np.ndarray,
    level: float,
    held: np.ndarray | bool = False,
) -> _MarginalLikelihood:
    shared = held | (np.diagonal(information) < _REDUNDANT * prior_information)
    information, gradient = (
        np.where(shared | shared[:, None], 0.0, information),
        np.where(shared, 0.0, gradient),
    )
    if not np.all(
        np.isfinite(information) & np.isfinite(gradient)
    ):  # answers that overflow are no evidence
        return _MarginalLikelihood(-np.inf, 1.0, 1.0, np.zeros(len(information)), shared)
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
    return _MarginalLikelihood(float(evidence[k]), float(sizes[k]), float(bends[k]), shape, shared)
