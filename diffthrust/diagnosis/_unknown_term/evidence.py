"""How likely one-step errors make a term of unknown form: linearised, coefficients integrated out.

Along the path of a trial the errors respond linearly to the coefficients of a curve at a port. The
coefficients have normal priors, whose widths are the size and the stiffness of the curve: the
widths are chosen that make the errors likeliest with the coefficients integrated out (for
smoothing splines: Wahba 1985; Wood 2011). The logarithm of that likelihood over the likelihood
without a curve is the evidence. What the estimated parameters of the model can do themselves counts
for nothing: it is projected out.

The response to a fine spline basis tells the gain of any shape, without another pass through the
logs. Closed forms are matched with it. A jump, which no spline follows, is tried by itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit, side_by_side
from diffthrust.diagnosis._learned import LearnedLaw
from diffthrust.diagnosis._linear_response import project_out
from diffthrust.diagnosis._unknown_term.terms import PortSeries, Regressors, Term, term_along
from diffthrust.effects._curve import Curve
from diffthrust.models._base.made_effect import ARRIVING
from diffthrust.models._base.model import Model

_BENDS = np.geomspace(0.01, 30.0, 15)
"""Numerics: stiffnesses that are tried: standard deviations of the bends, over the curve's size."""
_SIZES = np.geomspace(0.003, 1.0, 6)
"""Numerics: sizes of the curve that are tried, over the signal at the port (over 1 if it scales
that)."""
_REDUNDANT = 0.01
"""Numerics: a coefficient that keeps less of its information beside the model's parameters is fixed
at zero: these do its work already, and a fit of both would be ill-conditioned."""
_SLOPE_INDEX = 1
"""Numerics: index of the slope among the coefficients of a curve."""
_TUNING_RANGE = 5.0
"""Numerics: a time constant or width is tuned within this factor of its first guess: to the next
guess."""
_TUNING_OPTIONS = {"maxiter": 10, "xatol": 0.03}
"""Numerics: tuned to 3 %: the fit to whole runs estimates it further."""
_BATCH_TERMS, _BATCH_SAMPLES = 11, 1e5
"""Numerics: terms, and samples, that go through the logs together: eleven terms of eleven
coefficients fill the 128 columns of a wide pass (`LinearResponse`); more samples leave the
cache."""
_PLACES = 127
"""Numerics: places at which a jump is tried, with as many of the samples between any two; and as
many again about the likeliest. A jump placed wrongly by a fortieth of the range lost three quarters
of its evidence."""
_FINE_PIECES = 29
"""Numerics: pieces of the spline basis on which any shape is represented."""
_GRID_POINTS = 241
"""Numerics: values of the signal at which shapes are compared: eight for each fine piece."""
_ALIKE = 1e-6
"""Numerics: shapes are one shape where the least eigenvalue of their correlations is below this."""
_WAY_TO_BOUND = 0.9
"""Numerics: beside another shape a parameter moves at most this share of the way to its bound: a
fit that begins on a bound has no gradient there."""


class LikelyCurve(NamedTuple):
    """A curve that one-step errors support.

    Args:
        term: where it acts and on what.
        curve: with its coefficients at their linear estimates.
        evidence: logarithm of the likelihood ratio, with the coefficients integrated out.
    """

    term: Term
    curve: Curve
    evidence: float


def likely_curves(
    fitter: CandidateFitter, trial: TrialFit, terms: Iterable[Term]
) -> list[LikelyCurve]:
    """The terms for which there is evidence, with their curves, the likeliest first."""
    readings = fitter.readings(trial)
    batches = side_by_side(
        lambda batch: _evidence_of(trial, batch, [log[batch[0].port] for log in readings]),
        list(_batched(terms)),
    )
    likely = (curve for batch in batches for curve in batch if curve.evidence > 0)
    return sorted(likely, key=lambda curve: -curve.evidence)


def tune_memory(trial: TrialFit, regressors: Regressors, likely: LikelyCurve) -> LikelyCurve:
    """A term at the time constant, or the width, that makes one-step errors likeliest."""
    from scipy.optimize import minimize_scalar  # slow to import

    term, parameters = likely.term, likely.term.parameters
    if term.is_linear or len(parameters) != 1:
        return likely
    (name,), passing = parameters, [log[term.port] for log in regressors.current.ports]
    guess, (low, high) = parameters[name]["value"], parameters[name]["bounds"]
    tried = {guess: likely}

    def loss(exponent: float) -> float:
        value = float(np.exp(exponent))
        fields = {name: {**parameters[name], "value": value}}
        moved = term_along(regressors, term.port, term.signal, term.times, fields)
        curves = _evidence_of(trial, [moved], passing)
        tried.update((value, curve) for curve in curves)
        return -curves[0].evidence if curves else 0.0

    ends = max(low, guess / _TUNING_RANGE), min(high, guess * _TUNING_RANGE)
    minimize_scalar(loss, bounds=np.log(ends), method="bounded", options=_TUNING_OPTIONS)
    return max(tried.values(), key=lambda curve: curve.evidence)


def _flat_curve(term: Term) -> Curve:
    """The curve of a term with coefficients of zero, over the range of its signal."""
    pooled, parameters = term.pooled, dict[str, Any](term.parameters)
    ends = float(pooled.min()), float(pooled.max())
    return Curve(term.port, term.signal, *ends, times=term.times, **parameters)


def largest_size(term: Term, passing: Sequence[np.ndarray]) -> float:
    """The size of a term's curve that would add as much as passes the port; 1 if it scales that."""
    if term.times == ARRIVING:
        return 1.0
    factor = 1.0 if term.factor is None else _rms(term.factor.current)
    return _rms(passing) / max(factor, 1e-300)


def _batched(terms: Iterable[Term]) -> Iterator[list[Term]]:
    """Terms at one port, as many as are carried through the logs together."""
    by_port = sorted(terms, key=lambda term: term.port)
    for _, group in groupby(by_port, key=lambda term: term.port):
        at_port = list(group)
        samples = at_port[0].pooled.size
        size = int(np.clip(_BATCH_SAMPLES / samples, 1, _BATCH_TERMS))
        yield from (at_port[at : at + size] for at in range(0, len(at_port), size))


def _evidence_of(
    trial: TrialFit, terms: Sequence[Term], passing: Sequence[np.ndarray]
) -> list[LikelyCurve]:
    levels = [(term, largest_size(term, passing)) for term in terms]
    sized = [(term, _flat_curve(term), level) for term, level in levels if 0 < level < np.inf]
    if not sized:
        return []
    series = [term.basis(curve.basis) for term, curve, _ in sized]
    informed, curves = projected_information(trial, terms[0].port, series), []
    for (term, curve, level), projected in zip(sized, informed, strict=True):
        bends = term.is_linear & (np.arange(len(curve.coefficients)) != _SLOPE_INDEX)
        best = marginal_likelihood(*projected, level, bends)
        fixed = zip(curve.coefficients, best.shared, strict=True)
        arguments = {"size": best.size, "bend": best.bend, "shape": tuple(map(float, best.shape))}
        arguments["held"] = [name for name, is_fixed in fixed if is_fixed]
        estimated = Curve(**{**curve.arguments, **arguments})
        curves.append(LikelyCurve(term, estimated, best.evidence))
    return curves


def _rms(series: Sequence[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(series) ** 2)))


class _MarginalLikelihood(NamedTuple):
    """The likeliest widths of the priors, the coefficients, and which the parameters replace."""

    evidence: float
    size: float
    bend: float
    shape: np.ndarray
    shared: np.ndarray


def marginal_likelihood(
    information: np.ndarray,
    gradient: np.ndarray,
    unprojected: np.ndarray,
    level: float,
    fixed: np.ndarray | bool = False,
) -> _MarginalLikelihood:
    """The likelihood with the coefficients integrated out, largest over the widths of the priors.

    Args:
        information: of the coefficients, without what the model's parameters do.
        gradient: likewise.
        unprojected: information of each coefficient by itself.
        level: typical size of the signal that the curve adds to.
        fixed: coefficients that stay at zero.
    """
    shared = fixed | (np.diagonal(information) < _REDUNDANT * unprojected)
    information = np.where(shared | shared[:, None], 0.0, information)
    gradient = np.where(shared, 0.0, gradient)
    # integrals of a signal can overflow: no evidence, where NumPy would have raised in `slogdet`
    if not np.all(np.isfinite(information) & np.isfinite(gradient)):
        return _MarginalLikelihood(-np.inf, 1.0, 1.0, np.zeros(len(information)), shared)
    sizes, bends = (grid.ravel() for grid in np.meshgrid(_SIZES * level, _BENDS, indexing="ij"))
    widths = np.repeat(bends[:, None], len(information), axis=1)
    widths[:, :2] = 1.0, 2.0  # level and slope are not stiff
    widths *= sizes[:, None]
    # with coefficients w = widths * v, v ~ N(0, 1), the posterior precision of v is 1 + W' I W
    precision = np.eye(len(information)) + widths[:, :, None] * information * widths[:, None, :]
    slopes = widths * gradient
    steps = -np.linalg.solve(precision, slopes[..., None])[..., 0]
    evidence = -0.5 * np.sum(slopes * steps, axis=1) - 0.5 * np.linalg.slogdet(precision)[1]
    k = int(np.argmax(evidence))
    shape = widths[k] * steps[k]
    return _MarginalLikelihood(float(evidence[k]), float(sizes[k]), float(bends[k]), shape, shared)


def projected_information(
    trial: TrialFit, port: str, sets: Sequence[PortSeries]
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Information and gradient of series at a port, without what the model's parameters do.

    Args:
        trial: the current model.
        port: where the series are added.
        sets: sets of series, which go through the logs together.

    Returns:
        Of each set the projected information ``(K, K)``; the gradient ``(K,)``; the information of
        each series by itself.
    """
    count, scored = trial.scores(port, *zip(*sets, strict=True))
    out = []
    for information, scores in scored:
        projected, scores = project_out(information, scores, count)
        out.append((projected, scores.sum(axis=1), np.diagonal(information)[count:]))
    return out


# -- a jump, where its signal reaches a value ------------------------------------------------------


def with_jump(trial: TrialFit, regressors: Regressors, likely: LikelyCurve) -> LikelyCurve:
    """A likely curve, with the evidence of the likeliest jump of its signal if that is more.

    A curve of eight pieces turns slowly, and where a law jumps, curves of other slow signals do as
    well. Thrust lost below 14 V of a battery went for thrust that is lost as a motor warms up
    (evidence 122 against 110; of a jump of the voltage 187). A wave, which has its shape already,
    is returned as it is.
    """
    term = likely.term
    if term.is_linear:
        return likely
    pooled = term.pooled
    level = largest_size(term, [log[term.port] for log in regressors.current.ports])
    shares, spacing = np.linspace(0.0, 1.0, _PLACES + 2)[1:-1], 1.0 / (_PLACES + 1)
    best = 0.0
    for _ in range(2):
        places = np.unique(np.quantile(pooled, shares.clip(0.0, 1.0)))
        evidence = _evidence_of_jumps(trial, term, places, level)
        best = max(best, float(evidence.max()))
        likeliest = float(np.mean(pooled < places[evidence.argmax()]))
        shares = likeliest + spacing * np.linspace(-1.0, 1.0, _PLACES)
    # it may jump at any sample: one place among so many is paid for
    return likely._replace(evidence=max(likely.evidence, best - float(np.log(pooled.size))))


def _evidence_of_jumps(trial: TrialFit, term: Term, places: np.ndarray, level: float) -> np.ndarray:
    """The evidence of a jump at each place, beside a constant; ``(K,)``."""
    # a constant, and a step at each place
    series = term.basis(lambda x: np.vstack([np.ones_like(x), x > places[:, None]]))
    ((information, gradient, unprojected),) = projected_information(trial, term.port, [series])
    pairs = ([0, k] for k in range(1, len(places) + 1))
    return np.array(
        [
            marginal_likelihood(
                information[np.ix_(pair, pair)], gradient[pair], unprojected[pair], level
            ).evidence
            for pair in pairs
        ]
    )


# -- shapes ----------------------------------------------------------------------------------------


class LinearizedEvidence(NamedTuple):
    """What errors say of any shape of a term, to second order.

    Args:
        x: values of its signal, over its range in the logs.
        projection: gives the coefficients of the basis that best represent a shape over ``x``.
        information: on these coefficients, without what the model's parameters do.
        gradient: of the negative log-likelihood by them, likewise.
        readings: the distinct values that the signal takes in the logs, sorted.
        reference: root mean square of the signal.
    """

    x: Float[np.ndarray, " N"]
    projection: Float[np.ndarray, "K N"]
    information: Float[np.ndarray, "K K"]
    gradient: Float[np.ndarray, " K"]
    readings: Float[np.ndarray, " R"]
    reference: float

    @property
    def largest_wave_number(self) -> float:
        """The largest that the readings resolve: half a wave from one to the next (Nyquist).

        That of the gap to which the middle of the range belongs, if gaps are laid out by size.
        """
        gaps = np.sort(np.diff(self.readings))
        if not gaps.size:
            return 0.0
        return np.pi / float(gaps[np.searchsorted(np.cumsum(gaps), 0.5 * gaps.sum())])

    def gain(self, shape: Float[np.ndarray, " N"]) -> tuple[float, float]:
        """The likelihood ratio for a shape at its best amplitude, and that amplitude."""
        gain, (amplitude,) = self.gain_of(shape[None])
        return gain, float(amplitude)

    def gain_of(self, shapes: Float[np.ndarray, "S N"]) -> tuple[float, Float[np.ndarray, " S"]]:
        """The likelihood ratio for several shapes at their best amplitudes, and these."""
        nothing = 0.0, np.zeros(len(shapes))
        if not np.all(np.isfinite(shapes)):
            return nothing
        weights = shapes @ self.projection.T
        curvature, slope = weights @ self.information @ weights.T, weights @ self.gradient
        alone = np.diagonal(curvature)
        scale = np.sqrt(np.sum((weights @ self.information) ** 2, axis=1))
        # a shape that the parameters can do all of has no curvature but rounding errors
        if not np.all((alone > 1e-12 * scale) & (scale > 0.0)):
            return nothing
        unit = np.sqrt(alone)
        correlation = curvature / unit / unit[:, None]
        if np.linalg.eigvalsh(correlation)[0] < _ALIKE:  # two shapes that are one
            return nothing
        amplitudes = -np.linalg.solve(correlation, slope / unit) / unit
        return -float(slope @ amplitudes), amplitudes


def linearized_evidence(trial: TrialFit, term: Term) -> LinearizedEvidence:
    """What the one-step errors of a trial say of the shapes of a term."""
    pooled = term.pooled
    low, high = float(pooled.min()), float(pooled.max())
    fine = Curve(term.port, "speed", low, high, pieces=_FINE_PIECES)
    ((information, gradient, _),) = projected_information(
        trial, term.port, [term.basis(fine.basis)]
    )
    x = np.linspace(low, high, _GRID_POINTS)
    projection = np.linalg.pinv(fine.basis(x).T)
    reference = float(np.sqrt(np.mean(pooled**2)))
    return LinearizedEvidence(x, projection, information, gradient, np.unique(pooled), reference)


def evidence_of_fit(law: LearnedLaw) -> LinearizedEvidence:
    """What whole runs say of the shapes of a law, to which a curve has been fitted."""
    curve, (which, covariance) = law.curve, law.coefficients()
    x = np.linspace(curve.low, curve.high, _GRID_POINTS)
    information = np.linalg.pinv(covariance, hermitian=True)
    estimated = np.array([getattr(curve, curve.coefficients[i]) for i in which])
    projection = np.linalg.pinv(curve.basis(x).T)[which]
    reference, gradient = float(np.sqrt(np.mean(law.samples**2))), -information @ estimated
    return LinearizedEvidence(
        x, projection, information, gradient, np.unique(law.samples), reference
    )


def model_beside(law: LearnedLaw, shape: Float[np.ndarray, " K"]) -> Model:
    """A law's model without its curve, as whole runs would have it with another shape.

    A curve may replace a part of what other parameters do. These follow its coefficients to first
    order. They do not follow coefficients that are fixed because parameters can replace them.

    Args:
        law: the law; the covariance of the curve's coefficients must be finite.
        shape: the coefficients that are estimated, as `evidence_of_fit` represents a shape.
    """
    fit, curve, (which, _) = law.fit, law.curve, law.coefficients()
    parameters, prefix = fit.model.parameters, f"{law.curve.name}."
    targets = {prefix + curve.coefficients[i]: value for i, value in zip(which, shape, strict=True)}
    finite = np.isfinite(np.diagonal(fit.covariance))
    # parameters of the signal's memory are among the curve's: they stay where they are
    of_curve = [i for i, n in enumerate(fit.free) if n.startswith(prefix) and finite[i]]
    moved = [
        targets.get(n, parameters[n].value) - parameters[n].value
        for n in (fit.free[i] for i in of_curve)
    ]
    # regression of the other estimates on the curve's: E[b | a] = b + C_ba C_aa^-1 (a - a0)
    weights = np.linalg.pinv(fit.covariance[np.ix_(of_curve, of_curve)], hermitian=True) @ moved
    values = {}
    for i, name in enumerate(fit.free):
        if name in parameters and finite[i] and i not in of_curve:
            p = parameters[name]
            low, high = (p.value + _WAY_TO_BOUND * (end - p.value) for end in p.limits)
            conditional = p.value + float(fit.covariance[i, of_curve] @ weights)
            values[name] = float(np.clip(conditional, low, high))
    return fit.model.replace(values) - curve.name
