"""How much of an error a flexible correction could explain on fresh records, and how surely.

The share that a correction explains of errors it has not seen falls short of what its form could
explain with records without end: it has learned from few. To first order the shortfall goes with
one over the number of samples (Amari, Fujita & Shinomoto 1992, Four types of learning curves), so
corrections learned from halves of the records tell how much it is. The interval holds the
explainable share in nine of ten cases: it counts the scatter of the errors, which last and so are
fewer than they seem, half of the shortfall, and all forms that may as well be the right one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from diffthrust._support.correlation import autocorrelation, integral
from diffthrust.diagnosis._regressions import (
    ErrorRecord,
    Learner,
    Rung,
    chosen,
    features_for,
    learners_for,
)

_SPLITS = 4
"""So often the records to learn from are split in halves."""
_NEAR = 0.02
"""Forms whose squared errors on left-out records are this near to the best may be the right one."""
_WIDTH = 1.895
"""Standard deviations on either side of an interval of 90 %: Student's t of seven degrees, for the
scatter is known from a few stretches of errors that last."""


class Explainable(NamedTuple):
    """What a correction explains of an error, and what its form could.

    Args:
        share: of the squared error that the correction explains on records it has not seen.
        low: lower end of the 90 % interval of the explainable share.
        high: upper end.
        rung: the form of the correction.
        signals: what it was given.
    """

    share: float
    low: float
    high: float
    rung: Rung
    signals: tuple[str, ...]


class _Estimate(NamedTuple):
    """The share that one form explains, and 90 % limits of what it could."""

    share: float
    low: float
    high: float


def explainable(
    train: Sequence[ErrorRecord], test: Sequence[ErrorRecord], seed: int
) -> Explainable:
    """The share of the error of ``test`` that what ``train`` teaches explains.

    Args:
        train: two records or more to learn from.
        test: others to judge by; each of ``train`` by the rest of them where empty.
        seed: of the random features and of the halves.
    """
    features = features_for(train, seed)
    if not any(np.nansum(record.error**2) > 0 for record in test or train):
        return Explainable(0.0, 0.0, 0.0, Rung.NOTHING, features.names)
    learners = learners_for(train, features)
    if not learners:  # nothing could be learned: anything may be there
        return Explainable(0.0, 0.0, 1.0, Rung.NOTHING, features.names)
    best = chosen(learners)
    least = min(learner.loss for learner in learners)
    near = [
        candidate for candidate in learners if candidate.loss <= least + _NEAR or candidate is best
    ]
    estimates = {candidate.rung: _estimate(candidate, train, test, seed) for candidate in near}
    high = max(candidate.high for candidate in estimates.values())
    if best is None:  # what the best form would explain is the most that may be there
        first = estimates[min(near, key=lambda candidate: candidate.loss).rung]
        return Explainable(0.0, min(first.low, 0.0), high, Rung.NOTHING, features.names)
    estimate = estimates[best.rung]
    return Explainable(estimate.share, estimate.low, high, best.rung, features.names)


def _estimate(
    learner: Learner, train: Sequence[ErrorRecord], test: Sequence[ErrorRecord], seed: int
) -> _Estimate:
    """What one form explains, and how much it could."""
    rng, everyone = np.random.default_rng(seed), list(range(len(train)))
    corrected, halves, reaches = [], [], []
    shared = _taught(learner, everyone, rng) if test else None
    for k, record in enumerate(test or train):
        taught = shared or _taught(learner, [i for i in everyone if i != k], rng)
        regressors = learner.features.of(record, learner.rung)
        rests = record.error[:, None] - regressors @ taught.weights
        corrected.append(rests[:, 0] ** 2)
        halves.append(np.mean(rests[:, 1:] ** 2, axis=1))
        reaches.append(taught.reach)
    squares = [record.error**2 for record in test or train]
    total = _sum(squares)
    share, half = 1.0 - _sum(corrected) / total, 1.0 - _sum(halves) / total
    reach = float(np.mean(reaches))
    short = reach * (share - half)
    samples = int(np.isfinite(np.concatenate(squares)).sum())
    scores = [
        ((1.0 - share - short) * b - (1.0 + reach) * a + reach * h) * samples / total
        for b, a, h in zip(squares, corrected, halves, strict=True)
    ]
    scores = [score[np.isfinite(score)] for score in scores]  # of a held sensor one by one
    lags = max(1, min(score.size for score in scores) // 2)
    lasting = integral(autocorrelation(scores, lags))
    scatter = float(np.std(np.concatenate(scores))) * np.sqrt(lasting / samples)
    wide = _WIDTH * float(np.hypot(scatter, 0.5 * short))
    low = min(share + short - wide, share - _WIDTH * scatter)
    return _Estimate(share, float(low), min(max(share, share + short, 0.0) + wide, 1.0))


class _Taught(NamedTuple):
    """Weights learned from all of some records, then from halves, ``(p, 1 + 2 splits)``.

    ``reach`` is the shortfall of all over what halves fall short of all.
    """

    weights: np.ndarray
    reach: float


def _taught(learner: Learner, records: list[int], rng: np.random.Generator) -> _Taught:
    halves = []
    for split in range(_SPLITS):
        order, middle = rng.permutation(records), (len(records) + split % 2) // 2
        halves += [list(order[:middle]), list(order[middle:])]
    lost = float(np.mean([1.0 / max(learner.samples(half), 1) for half in halves]))
    all_of_them = 1.0 / max(learner.samples(records), 1)
    weights = [learner.weights(some) for some in (records, *halves)]
    return _Taught(np.stack(weights, axis=1), all_of_them / (lost - all_of_them))


def _sum(parts: Sequence[np.ndarray]) -> float:
    return float(np.nansum(np.concatenate(parts)))
