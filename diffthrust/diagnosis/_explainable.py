"""How much of an error a flexible correction could explain on fresh records, and how surely.

Corrections are a ladder of regressions from signals to the error. Signals enter as they are and
through first-order filters with time constants from fast to slow, which show the past; curves come
from random features, tanh(w x + b) of the standardized signals, before the filters and behind them,
summed by ridge regression. Rung and ridge are chosen by leaving out one record at a time.

A correction explains less of errors it has not seen than its form could with records without end:
it has learned from few. To first order the shortfall goes with one over the number of samples
(Amari, Fujita & Shinomoto 1992, Four types of learning curves), so corrections learned from halves
of the records show how large it is. The interval holds the explainable share in nine of ten cases:
it counts the scatter of the errors, which last and so are fewer than they seem, half of the
shortfall, and all forms that may as well be the right one.

Source: Rahimi & Recht 2008, Weighted sums of random kitchen sinks; Hastie, Tibshirani & Friedman
2009, The Elements of Statistical Learning, sections 3.4 and 7.10.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import NamedTuple

import numpy as np

from diffthrust._support.correlation import autocorrelation, integral
from diffthrust._support.lag import lagged
from diffthrust.diagnosis._settings import SETTINGS

_RANDOM_CURVES = 100
"""Numerics: random features of the curved forms. Ridge regression takes care of too many."""
_FILTERS = 5
"""Numerics: first-order lags of each signal, spaced evenly in logarithm."""
_RIDGES = 10.0 ** np.arange(-6.0, 3.0)
"""Numerics: ridge, as a share of the samples."""
_CLIPPED_AT = 4.0
"""Numerics: standard deviations beyond which a signal counts as this far: no extrapolation."""


class Rung(StrEnum):
    """The forms of a correction, from none at all to the most flexible one."""

    NOTHING = "nothing"
    STATIC_LINEAR = "static, linear"
    STATIC_CURVED = "static, curved"
    DYNAMIC_LINEAR = "dynamic, linear"
    DYNAMIC_CURVED = "dynamic, curved"

    @property
    def dynamic(self) -> bool:
        """Whether it depends on the past."""
        return self in (Rung.DYNAMIC_LINEAR, Rung.DYNAMIC_CURVED)

    @property
    def curved(self) -> bool:
        """Whether it is nonlinear."""
        return self in (Rung.STATIC_CURVED, Rung.DYNAMIC_CURVED)


class ErrorRecord(NamedTuple):
    """One record: signals and the error to be explained.

    Args:
        time: [s], ``(n,)``.
        signals: by name, ``(n,)`` each.
        error: ``(n,)``; NaN where nothing was measured.
        static: it is of a static table, whose points have no past.
    """

    time: np.ndarray
    signals: Mapping[str, np.ndarray]
    error: np.ndarray
    static: bool = False

    def columns(self, names: Sequence[str]) -> np.ndarray:
        """Some signals side by side, ``(n, d)``."""
        return np.stack([self.signals[name] for name in names], axis=1)


@dataclass(frozen=True)
class Features:
    """Regressors from the signals of a record, scaled as in the records that they were made for.

    Args:
        names: signals that are used.
        lags: time constants of the filters [s]; none where the records have no past.
        centre: of each signal and filtered signal, ``(d (1 + filters),)``.
        scale: likewise.
        seed: of the random features.
    """

    names: tuple[str, ...]
    lags: tuple[float, ...]
    centre: np.ndarray
    scale: np.ndarray
    seed: int

    def of(self, record: ErrorRecord, rung: Rung) -> np.ndarray:
        """``(n, p)`` regressors of a rung, with a column of ones in front."""
        wide = through_filters(record.time, record.columns(self.names), self.lags) - self.centre
        wide = np.clip(wide / self.scale, -_CLIPPED_AT, _CLIPPED_AT)
        present = wide[:, : len(self.names)]
        columns = [np.ones((record.time.size, 1)), wide if rung.dynamic else present]
        if rung.curved:
            columns.append(_random_curves(present, *self._curves[True]))
        if rung.curved and rung.dynamic:
            columns.append(_random_curves(wide, *self._curves[False]))
            columns[-2] = through_filters(record.time, columns[-2], self.lags)
        return np.concatenate(columns, axis=1)

    @cached_property
    def _curves(self) -> dict[bool, tuple[np.ndarray, np.ndarray]]:
        rng, curves = np.random.default_rng(self.seed), {}
        for static, inputs in ((True, len(self.names)), (False, self.centre.size)):
            slopes = rng.standard_normal((inputs, _RANDOM_CURVES)) * (1.5 / np.sqrt(inputs))
            curves[static] = slopes, rng.uniform(-1.5, 1.5, _RANDOM_CURVES)
        return curves


def through_filters(time: np.ndarray, columns: np.ndarray, lags: Sequence[float]) -> np.ndarray:
    """Series, and each through first-order lags that begin settled, ``(n, d (1 + lags))``."""
    steps = np.diff(time)
    filtered = [lagged(columns[0], columns[1:], np.exp(-steps / lag)) for lag in lags]
    return np.concatenate([columns, *filtered], axis=1)


def _random_curves(columns: np.ndarray, slopes: np.ndarray, shifts: np.ndarray) -> np.ndarray:
    return np.tanh(columns @ slopes + shifts)


def features_for(records: Sequence[ErrorRecord], seed: int) -> Features:
    """Features scaled to these records; signals that never move are left out."""
    step = float(np.median(np.concatenate([np.diff(r.time) for r in records])))
    longest = max(float(r.time[-1] - r.time[0]) for r in records)
    lags = tuple(np.geomspace(2.0 * step, max(4.0 * step, longest / 10.0), _FILTERS))
    lags = () if all(record.static for record in records) else lags
    moving = [
        name
        for name in records[0].signals
        if all(name in r.signals for r in records)
        and np.ptp(np.concatenate([r.signals[name] for r in records])) > 0
    ]
    wide = np.concatenate([through_filters(r.time, r.columns(moving), lags) for r in records])
    scale = np.std(wide, axis=0)
    return Features(
        tuple(moving), lags, np.mean(wide, axis=0), np.where(scale > 0, scale, 1.0), seed
    )


@dataclass(frozen=True)
class Learner:
    """A rung with the ridge that predicts left-out records best, ready to learn from any of them.

    Args:
        rung: its form.
        ridge: as a share of the samples.
        loss: squared error of what was left out, as a share of that of no correction.
        features: what turns a record into regressors.
        blocks: what it needs of each record.
        basis: what turns a solution into weights.
    """

    rung: Rung
    ridge: float
    loss: float
    features: Features
    blocks: Sequence[_Sums]
    basis: np.ndarray

    def weights(self, of: Sequence[int]) -> np.ndarray:
        """What some of the records teach, ``(p,)``."""
        return self.basis @ ridge_solution(pooled_sums([self.blocks[i] for i in of]), self.ridge)


def learners_for(records: Sequence[ErrorRecord], features: Features) -> list[Learner]:
    """A learner for each rung above none, where its equations have a solution."""
    learners = []
    for rung in list(Rung)[1:]:
        if rung.dynamic and not features.lags:
            continue
        blocks, basis = regression(records, features, rung)
        losses = _left_out(blocks)
        if np.all(np.isfinite(losses)):
            least = int(np.argmin(losses))
            ridge, loss = float(_RIDGES[least]), float(losses[least])
            learners.append(Learner(rung, ridge, loss, features, blocks, basis))
    return learners


def chosen(learners: Sequence[Learner]) -> Learner | None:
    """The learner that predicts left-out records best; none if no correction does as well.

    A higher rung must be clearly better than the last good one: a tie goes to the simpler model.
    """
    best, taken = 1.0, None
    for learner in learners:
        if learner.loss < best - SETTINGS.headroom.least_rung_gain:
            best, taken = learner.loss, learner
    return taken


class _Sums(NamedTuple):
    """What ridge regression needs of one record, or of several."""

    squares: np.ndarray
    products: np.ndarray
    total: float
    samples: int


def regression(
    records: Sequence[ErrorRecord], features: Features, rung: Rung
) -> tuple[list[_Sums], np.ndarray]:
    """The sums of each record, and the basis that turns a solution into weights of the regressors.

    If there are more regressors than samples, weights are sought in the span of the samples: ridge
    regression finds none outside it, and the systems are smaller.
    """
    from scipy.linalg import block_diag, qr  # slow to import

    finite = [np.isfinite(r.error) for r in records]
    rows = [features.of(r, rung)[s] for r, s in zip(records, finite, strict=True)]
    samples, basis = sum(map(len, rows)), np.eye(rows[0].shape[1])
    if samples < len(basis):
        span = qr(np.concatenate(rows)[:, 1:].T, mode="economic", check_finite=False)[0]
        basis = np.asarray(block_diag(1.0, span))  # the mean has no ridge, and stays as it is
        rows = [x @ basis for x in rows]
    errors = [r.error[s] for r, s in zip(records, finite, strict=True)]
    return [
        _Sums(x.T @ x, x.T @ y, float(y @ y), y.size) for x, y in zip(rows, errors, strict=True)
    ], basis


def pooled_sums(blocks: Sequence[_Sums]) -> _Sums:
    squares, products = blocks[0].squares.copy(), blocks[0].products.copy()
    for block in blocks[1:]:  # in place: they are large
        squares += block.squares
        products += block.products
    total, samples = sum(b.total for b in blocks), sum(b.samples for b in blocks)
    return _Sums(squares, products, total, samples)


def ridge_solution(sums: _Sums, ridge: float) -> np.ndarray:
    from scipy.linalg import LinAlgError, cho_factor, cho_solve  # slow to import

    squares = sums.squares.copy()
    squares.flat[len(squares) + 1 :: len(squares) + 1] += ridge * sums.samples
    squares[0, 0] += 1e-12 * sums.samples  # the mean has no ridge
    try:
        factor = cho_factor(squares, overwrite_a=True, check_finite=False)
    except LinAlgError:  # a simulation that has run away: nothing can be learned from it
        return np.full(len(squares), np.nan)
    return cho_solve(factor, sums.products, check_finite=False)


def _left_out(blocks: Sequence[_Sums]) -> np.ndarray:
    """For each ridge the squared error on left-out records, as a share of that of no correction.

    Each record is predicted by the weights that the others teach.
    """
    losses = np.zeros(_RIDGES.size)
    for k, left_out in enumerate(blocks):
        training = pooled_sums([b for i, b in enumerate(blocks) if i != k])
        for i, ridge in enumerate(_RIDGES):
            w = ridge_solution(training, float(ridge))
            losses[i] += (
                left_out.total
                - 2.0 * float(w @ left_out.products)
                + float(w @ left_out.squares @ w)
            )
    return losses / max(sum(b.total for b in blocks), 1e-300)


_SPLITS = 4
"""Numerics: random halvings of the records, over which the shortfall is averaged."""


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


def explainable(
    train: Sequence[ErrorRecord], test: Sequence[ErrorRecord], seed: int
) -> Explainable:
    """The share of the error of unseen records that a correction explains, and could explain.

    Args:
        train: two records or more to learn from.
        test: unseen records to judge by; if there are none, each of ``train`` by the others.
        seed: of the random features and of the halves.
    """
    features = features_for(train, seed)
    nothing = Explainable(0.0, 0.0, 0.0, Rung.NOTHING, features.names)
    if not any(np.nansum(record.error**2) > 0 for record in test or train):
        return nothing
    learners = learners_for(train, features)
    if not learners:  # nothing could be learned: the explainable share may be anything
        return nothing._replace(high=1.0)
    best = chosen(learners)
    least = min(learner.loss for learner in learners)
    near = [
        candidate
        for candidate in learners
        if candidate.loss <= least + SETTINGS.headroom.tie_loss or candidate is best
    ]
    estimates = {candidate.rung: _estimate(candidate, train, test, seed) for candidate in near}
    high = max(estimate.high for estimate in estimates.values())
    if best is None:  # no form is good enough to be used, but the best bounds the share
        first = estimates[min(near, key=lambda candidate: candidate.loss).rung]
        return nothing._replace(low=min(first.low, 0.0), high=high)
    return estimates[best.rung]._replace(high=high)


def independent_samples(records: Sequence[ErrorRecord]) -> float:
    """The number of independent samples that tell as much as the errors of some records."""
    errors = [record.error[np.isfinite(record.error)] for record in records]
    samples = sum(error.size for error in errors)
    lags = max(1, min(error.size for error in errors) // 2)
    return samples / max(integral(autocorrelation(errors, lags)), 1.0)


def _estimate(
    learner: Learner, train: Sequence[ErrorRecord], test: Sequence[ErrorRecord], seed: int
) -> Explainable:
    """What one form explains, and how much it could."""
    rng, everyone = np.random.default_rng(seed), list(range(len(train)))
    corrected, halves, reaches = [], [], []
    shared = _teach(learner, everyone, rng) if test else None
    for k, record in enumerate(test or train):
        taught = shared or _teach(learner, [i for i in everyone if i != k], rng)
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
    scores = [score[np.isfinite(score)] for score in scores]  # a held sensor's readings one by one
    lags = max(1, min(score.size for score in scores) // 2)
    lasting = integral(autocorrelation(scores, lags))
    scatter = float(np.std(np.concatenate(scores))) * np.sqrt(lasting / samples)
    wide = SETTINGS.headroom.interval_width * float(np.hypot(scatter, 0.5 * short))
    low = min(share + short - wide, share - SETTINGS.headroom.interval_width * scatter)
    high = min(max(share, share + short, 0.0) + wide, 1.0)
    return Explainable(share, float(low), high, learner.rung, learner.features.names)


class _Taught(NamedTuple):
    """Weights learned from all of some records, then from halves, ``(p, 1 + 2 splits)``.

    ``reach`` is the shortfall of all over what halves fall short of all.
    """

    weights: np.ndarray
    reach: float


def _teach(learner: Learner, records: list[int], rng: np.random.Generator) -> _Taught:
    halves = []
    for split in range(_SPLITS):
        order, middle = rng.permutation(records), (len(records) + split % 2) // 2
        halves += [list(order[:middle]), list(order[middle:])]
    *lost, all_of_them = (
        1.0 / max(sum(learner.blocks[i].samples for i in some), 1) for some in (*halves, records)
    )
    weights = [learner.weights(some) for some in (records, *halves)]
    return _Taught(np.stack(weights, axis=1), all_of_them / (float(np.mean(lost)) - all_of_them))


def _sum(parts: Sequence[np.ndarray]) -> float:
    return float(np.nansum(np.concatenate(parts)))
