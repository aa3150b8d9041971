"""Curves of unknown form, held against one-step errors: how stiff, and how likely each is.

Along the path of a trial the errors answer linearly to the coefficients of a curve at a port. These
have normal priors, whose width says how stiff the curve is: the width is taken that makes the errors
likeliest with the coefficients integrated out (empirical Bayes: MacKay 1992; of smoothing splines,
Wahba 1985, Wood 2011). The logarithm of that likelihood over the one without a curve is its
evidence; a curve that the estimated parameters could be themselves has none.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from diffthrust.diagnosis._findings import SignalForm
from diffthrust.diagnosis._structure import Suspect, observed, suspects
from diffthrust.diagnosis._trials import TrialFit, Trials, side_by_side
from diffthrust.effects._curve import Curve

_BENDS = np.geomspace(0.01, 30.0, 15)
"""Stiffnesses that are tried: standard deviations of the bends, over the curve's size."""
_SIZES = np.geomspace(0.003, 1.0, 6)
"""Sizes of the curve that are tried, over the level of what passes the port."""
_SHARED = 0.01
"""A coefficient of which the estimated parameters leave less than this does what they do already,
and is held at nothing."""


class LearnedCurve(NamedTuple):
    """A curve that one-step errors ask for.

    Args:
        suspect: where it acts and on what.
        curve: with its coefficients at their linear estimates.
        evidence: logarithm of the likelihood ratio, with the coefficients integrated out.
    """

    suspect: Suspect
    curve: Curve
    evidence: float


def likely_curves(trials: Trials, trial: TrialFit) -> list[LearnedCurve]:
    """The curves for which there is evidence, the most first."""
    seen = observed(trials, trial)
    ports = seen.ports

    def judged(suspect: Suspect) -> LearnedCurve | None:
        return _judged(trials, trial, suspect, [one[suspect.port] for one in ports])

    wanted = [one for one in suspects(trials, trial) if _signal_of(one) is not None]
    found = [one for one in side_by_side(judged, wanted) if one is not None and one.evidence > 0]
    return sorted(found, key=lambda one: -one.evidence)


def _signal_of(suspect: Suspect) -> str | None:
    """The signal as a curve reads it; ``None`` where an effect cannot read it."""
    form: SignalForm = suspect.signal
    if form.rate:
        own = suspect.place.state == form.name and suspect.port == suspect.place.port
        return "value" if own else None
    return form.name


def _judged(
    trials: Trials, trial: TrialFit, suspect: Suspect, passing: Sequence[np.ndarray]
) -> LearnedCurve | None:
    pooled = np.concatenate(suspect.over)
    low, high = float(pooled.min()), float(pooled.max())
    signal = _signal_of(suspect)
    assert signal is not None
    adds = suspect.manner == "adds"
    level = float(np.sqrt(np.mean(np.concatenate(passing) ** 2))) if adds else 1.0
    if not level > 0:
        return None
    past = suspect.signal.past or 0.0
    plain = Curve(suspect.port, signal, low, high, manner=suspect.manner, past=past)
    rows = [plain.basis(over) for over in suspect.over]
    if not adds:
        rows = [row * value for row, value in zip(rows, passing, strict=True)]
    response = trial.response
    answers = response.to(suspect.port, response.batched(rows))
    known = [i for i, name in enumerate(trial.names) if name not in trials.nuisance]
    information, scores = response.scores(known, answers)
    best = _stiffness(information, scores, len(known), level)
    if best is None:
        return None
    evidence, size, bend, values, shared = best
    coefficients = dict(zip(plain.coefficients, map(float, values), strict=True))
    curve = Curve(
        suspect.port, signal, low, high, manner=suspect.manner, past=past, size=size, bend=bend,
        **coefficients, held=tuple(n for n, own in zip(plain.coefficients, shared) if own),
    )  # fmt: skip
    return LearnedCurve(suspect, curve, evidence)


def _stiffness(
    information: np.ndarray, scores: np.ndarray, base: int, level: float
) -> tuple[float, float, float, np.ndarray, np.ndarray] | None:
    """The likeliest size and stiffness: evidence, size, bend, coefficients, and which are shared."""
    nuisance, cross = information[:base, :base], information[base:, :base]
    through = cross @ np.linalg.pinv(nuisance, rcond=1e-11, hermitian=True)
    left = information[base:, base:] - through @ cross.T
    clear = (scores[base:] - through @ scores[:base]).sum(axis=1)
    own = np.diagonal(information)[base:]
    shared = np.diagonal(left) < _SHARED * own
    left, clear = np.where(shared | shared[:, None], 0.0, left), np.where(shared, 0.0, clear)
    best = None
    for size in _SIZES * level:
        for bend in _BENDS:
            widths = size * np.array([1.0, 2.0, *[bend] * (len(left) - 2)])
            # in units of the priors: I + W L W
            inner = np.eye(len(left)) + widths[:, None] * left * widths
            slope = widths * clear
            steps = -np.linalg.solve(inner, slope)
            evidence = -0.5 * float(slope @ steps) - 0.5 * float(np.linalg.slogdet(inner)[1])
            if best is None or evidence > best[0]:
                best = evidence, float(size), float(bend), widths * steps, shared
    return best
