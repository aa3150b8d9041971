"""What one-step errors, or whole runs, say of any shape of a law over its signal.

The errors answer linearly to a law at a port, so those to a fine spline basis tell how much
likelier any shape makes them, with nothing to be carried through the logs again.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit
from diffthrust.diagnosis._learned import LearnedLaw
from diffthrust.diagnosis._learning.hypotheses import Hypothesis
from diffthrust.diagnosis._learning.sight import Added
from diffthrust.effects._curve import Curve
from diffthrust.models._base.model import Model

_PIECES = 29
_POINTS = 241
_WAY = 0.9
"""Beside another shape a parameter goes no further than this share of the way to its bound."""


class Ground(NamedTuple):
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


def ground_of(trials: CandidateFitter, trial: TrialFit, law: Hypothesis) -> Ground:
    """What the one-step errors of a trial say of the shapes of a law."""
    pooled = np.concatenate(law.over)
    low, high = float(pooled.min()), float(pooled.max())
    fine = Curve(law.port, "speed", low, high, pieces=_PIECES)
    ((information, gradient, _),) = left_over(trials, trial, law.port, [law.added(fine)])
    x = np.linspace(low, high, _POINTS)
    onto = np.linalg.pinv(fine.basis(x).T)
    return Ground(x, onto, information, gradient, float(np.sqrt(np.mean(pooled**2))))


def ground_of_fit(law: LearnedLaw) -> Ground:
    """What whole runs say of the shapes of a law, to which a curve has been fitted."""
    curve, (which, covariance) = law.curve, law.coefficients()
    x = np.linspace(curve.low, curve.high, _POINTS)
    information = np.linalg.pinv(covariance, hermitian=True)
    estimated = np.array([getattr(curve, curve.coefficients[i]) for i in which])
    onto = np.linalg.pinv(curve.basis(x).T)[which]
    return Ground(
        x, onto, information, -information @ estimated, float(np.sqrt(np.mean(law.samples**2)))
    )


def model_beside(law: LearnedLaw, shape: Float[np.ndarray, " K"]) -> Model:
    """A law's model without its curve, as whole runs would have it with another.

    The other parameters go with its coefficients to first order: a curve may do a part of their
    work. They stay for what coefficients do that are held, because parameters can do it all.

    Args:
        law: the law; the covariance of the curve's coefficients must be finite.
        shape: the coefficients that are estimated, as `ground_of_fit` meets a shape.
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
            low, high = (p.value + _WAY * (end - p.value) for end in p.limits)
            moved = p.value + float(fit.covariance[i, curve_indices] @ weights)
            values[name] = float(np.clip(moved, low, high))
    return fit.model.replace(values) - curve.name


def left_over(
    trials: CandidateFitter, trial: TrialFit, port: str, several: Sequence[Added]
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
        beside_known(*response.scores(estimated, of_added), len(estimated)) for of_added in apart
    ]


def beside_known(
    information: np.ndarray, scores: np.ndarray, base: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Information and gradient of what comes after the first ``base`` coordinates, less these."""
    nuisance, cross = information[:base, :base], information[base:, :base]
    through = cross @ np.linalg.pinv(nuisance, rcond=1e-11, hermitian=True)
    remaining = information[base:, base:] - through @ cross.T
    gradient = (scores[base:] - through @ scores[:base]).sum(axis=1)
    return remaining, gradient, np.diagonal(information)[base:]
