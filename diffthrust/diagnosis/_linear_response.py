"""The response of one-step errors to anything that is added at a port or to a channel.

Along the path of a trial the innovations form is linearised sample by sample: how the states after
a sample, and its errors, depend on the states before it, on the parameters, and on a push at each
port and channel. All samples are linearised side by side, in one small program for each model.
Whatever is then added anywhere is propagated through these matrices by a program that knows no
model: every candidate and every signal of unknown form is tried without compiling anything for it.
(The whole catalogue compiled into one program, at its null, took minutes for a vessel.)

The quadratic of the cost that results says what a step promises, and whether an effect is
redundant. By the same information and the scores a test tells whether coordinates at zero differ
from it by more than chance (`score_test`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.programs import program
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._step_slopes import StepSlopes, step_slopes
from diffthrust.estimation._likelihood import Quadratic, by_blocks, tightness
from diffthrust.estimation._one_step import batch_passes, cost_of_errors
from diffthrust.estimation._problem import Problem

ABREAST = 32
"""Numerics: series that go through a log together, padded with zeros to this number so that one
program serves all: a step of the loop takes hardly longer with them."""
_MOST_REMOVED = 0.9
"""Numerics: share of the squared errors that a step is credited with removing at most: the
logarithm of what remains has no bound, and a linear response far from the null is not to be trusted
so far."""


class LinearResponse:
    """The linear response of the one-step errors of a trial.

    Args:
        problem: the logs, at the values of the trial and with its clipped residuals.

    Example:
        >>> response.quadratic(response.to("shaft", series)).information
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        layout, numbers = problem.layout, problem.numbers
        passed = batch_passes(problem)
        self.errors = [np.asarray(errors) for errors, _ in passed]
        paths = [path for _, path in passed]
        self.slopes = step_slopes(layout, numbers, problem.start(), paths)
        # what is each log's own, and how tight those that differ by log are about their means
        self.own = problem.start()[problem.shared :].reshape(len(problem.records), -1)
        self.tight = np.asarray(tightness(layout, numbers))
        self.cost = self._present.cost + self._pull(self.own)

    def to(
        self, place: str, series: Sequence[np.ndarray], ends: Sequence[np.ndarray] | None = None
    ) -> list[np.ndarray]:
        """Derivatives of the errors by the amplitude of each of some series, added at a place.

        Args:
            place: a port, an input, or a measured channel.
            series: by batch ``(B, K, T)``.
            ends: the series as the next sample comes; their next values where ``None``.

        Returns:
            By batch ``(B, K, C, T)``.
        """
        if ends is None:
            ends = [np.concatenate([s[..., 1:], s[..., -1:]], axis=-1) for s in series]
        # between samples the series is a straight line, and its mean drives the state; under
        # zero-order hold it is constant
        zero_order = [dict(grid.hold).get(place) == "zero" for grid in self.problem.layout.grids]
        return [
            _response_to(
                slopes,
                slopes.places.index(place),
                start,
                start if is_constant else 0.5 * (start + end),
            )
            for slopes, start, end, is_constant in zip(
                self.slopes, series, ends, zero_order, strict=True
            )
        ]

    def quadratic(
        self, more: Sequence[np.ndarray] = (), change: Sequence[np.ndarray] = ()
    ) -> Quadratic:
        """The likelihood of the trial with more coordinates, after its own shared ones.

        Args:
            more: derivatives of the errors by these coordinates, by batch ``(B, K, C, T)``.
            change: what the errors are changed by, by batch ``(B, C, T)``.
        """
        errors = [e + d for e, d in zip(self.errors, change, strict=True)] if change else None
        own = self._weighed(errors) if errors else self._present
        n, extra = self.problem.shared, more[0].shape[1] if more else 0
        size, starts = n + extra, self.problem.each
        logs = sum(map(len, self.errors))
        information = np.zeros((size + logs * starts,) * 2)
        gradient, at = np.zeros(size + logs * starts), size
        for i, batch in enumerate(own.batches):
            root, weighted, rows = batch.root, batch.weighted, batch.rows
            flat, count = rows.reshape(*rows.shape[:2], -1), len(rows)
            further = (more[i] * root[:, None]).reshape(count, extra, -1) if more else flat[:, :0]
            inner, crossed = further @ further.transpose(0, 2, 1), flat @ further.transpose(0, 2, 1)
            moved = (further @ weighted.reshape(count, -1, 1))[..., 0]
            information[:n, :n] += batch.gram[:, :n, :n].sum(axis=0)
            information[:n, n:size] += crossed[:, :n].sum(axis=0)
            information[n:size, n:size] += inner.sum(axis=0)
            gradient[:n] += batch.slope[:, :n].sum(axis=0)
            gradient[n:size] += moved.sum(axis=0)
            # initial states are of one log each: they meet the shared coordinates only
            for gram, slope, cross in zip(batch.gram, batch.slope, crossed, strict=True):
                local = slice(at, at + starts)
                information[:n, local] = gram[:n, n:]
                information[n:size, local] = cross[n:].T
                information[local, local] = gram[n:, n:] + np.diag(self.tight)
                gradient[local] = slope[n:]
                at += starts
        information[n:size, :n] = information[:n, n:size].T
        information[size:, :size] = information[:size, size:].T
        gradient[size:] += (self.tight * self.own).ravel()
        energy = sum(float(np.sum(batch.weighted**2)) for batch in own.batches)
        cost = np.asarray(own.cost + self._pull(self.own))
        without_scores = np.zeros((gradient.size, 0))  # `scores` gives those that are tested
        return Quadratic(cost, gradient, information, np.asarray(energy), own.sigma, without_scores)

    def after(
        self,
        q: Quadratic,
        movable: np.ndarray,
        more: Sequence[np.ndarray],
        change: Sequence[np.ndarray],
        limits: tuple[np.ndarray, np.ndarray],
    ) -> float:
        """The cost after a full step within a `quadratic`, as far as the errors are linear.

        The further coordinates move within ``limits``.
        """
        n, extra = self.problem.shared, more[0].shape[1] if more else 0
        further = slice(n, n + extra)
        step = gauss_newton_step(q.information, q.gradient, movable)
        within = np.clip(step[further], *limits)
        if np.any(within != step[further]):  # on their bounds; the others follow them there
            movable = movable.copy()
            movable[further] = False
            slope = q.gradient + q.information[:, further] @ within
            step = gauss_newton_step(q.information, slope, movable)
            step[further] = within
        logs = sum(map(len, self.errors))
        starts = step[n + extra :].reshape(logs, self.problem.each)
        errors, at = [], 0
        for i, (batch_errors, offset) in enumerate(zip(self.errors, change, strict=True)):
            jacobian, count = self.slopes[i].jacobian, len(batch_errors)
            moved = batch_errors + offset + np.tensordot(step[:n], jacobian[:, :n], (0, 1))
            moved = moved + np.einsum("bj,bjct->bct", starts[at : at + count], jacobian[:, n:])
            if extra:
                moved = moved + np.tensordot(step[further], more[i], (0, 1))
            errors.append(moved)
            at += count
        cost = float(cost_of_errors(self.problem.layout, self.problem.numbers, errors)[0])
        return cost + self._pull(self.own + starts)

    def _pull(self, own: np.ndarray) -> float:
        """What parameters that differ by log cost by lying apart from their means."""
        return 0.5 * float(np.sum(self.tight * own**2))

    def scores(
        self, estimated: Sequence[int], more: Sequence[np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Information, and gradient by blocks of time, of some coordinates and of more.

        Args:
            estimated: some of the shared coordinates.
            more: derivatives of the errors by further ones, by batch ``(B, K, C, T)``.
        """
        own, n = list(estimated), len(estimated)
        size = n + more[0].shape[1]
        information, scores = np.zeros((size, size)), []
        parts = zip(self._present.batches, self._own_scores, more, strict=True)
        for batch, own_scores, further in parts:
            rows, count = further * batch.root[:, None], len(further)
            scores.append(np.concatenate([own_scores[own], _scores(rows, batch.weighted)]))
            flat = rows.reshape(count, size - n, -1).transpose(0, 2, 1)
            crossed = (batch.rows.reshape(count, -1, flat.shape[1]) @ flat).sum(axis=0)
            information[:n, :n] += batch.gram.sum(axis=0)[np.ix_(own, own)]
            information[:n, n:] += crossed[own]
            information[n:, n:] += (flat.transpose(0, 2, 1) @ flat).sum(axis=0)
        information[n:, :n] = information[:n, n:].T
        return information, np.concatenate(scores, axis=1)

    def at_bound(self, gradient: np.ndarray) -> np.ndarray:
        """Which coordinates of a `quadratic` lie at a bound and would be moved beyond it."""
        (low, high), z = self.problem.limits(), self.problem.start()
        shared, more = self.problem.shared, gradient.size - z.size
        low, high, z = (
            np.concatenate([side[:shared], np.full(more, fill), side[shared:]])
            for side, fill in ((low, -np.inf), (high, np.inf), (z, 0.0))
        )
        return ((z <= low + 1e-9) & (gradient >= 0)) | ((z >= high - 1e-9) & (gradient <= 0))

    def batched(self, series: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Series log by log, ``(K, T)`` each, in the batches of the problem: ``(B, K, T)``."""
        out = []
        for batch, indices in zip(self.problem.numbers.batches, self.problem.order, strict=True):
            rows = np.zeros((len(indices), len(series[0]), batch.time.shape[1]))
            for row, index in enumerate(indices):
                rows[row, :, : series[index].shape[1]] = series[index]
            out.append(rows)
        return out

    @cached_property
    def _present(self) -> _Weighed:
        """Of the errors as they are: quadratics and tests of structure ask by the hundred."""
        return self._weighed(self.errors)

    @cached_property
    def _own_scores(self) -> list[np.ndarray]:
        """The gradient by the trial's own coordinates and by blocks of time, by batch."""
        return [_scores(batch.rows, batch.weighted) for batch in self._present.batches]

    def _weighed(self, errors: Sequence[np.ndarray]) -> _Weighed:
        """The likelihood of some errors, with the derivatives by the trial's own coordinates."""
        layout, batches = self.problem.layout, []
        cost, sigma = map(np.asarray, cost_of_errors(layout, self.problem.numbers, errors))
        for batch_errors, slopes in zip(errors, self.slopes, strict=True):
            weights = np.asarray(layout.likelihood.law.weights(batch_errors, sigma))
            root = np.sqrt(weights) / sigma[None, :, None]
            weighted, rows = batch_errors * root, slopes.jacobian * root[:, None]
            flat = rows.reshape(*rows.shape[:2], -1)
            gram, slope = flat @ flat.transpose(0, 2, 1), flat @ weighted.reshape(len(rows), -1, 1)
            batches.append(_WeighedBatch(root, weighted, rows, gram, slope[..., 0]))
        return _Weighed(float(cost), sigma, batches)


class _WeighedBatch(NamedTuple):
    """Of a batch of ``B`` logs, with ``m`` coordinates of the trial's own.

    Args:
        root: of the weights over the noise, ``(B, C, T)``.
        weighted: the errors times it, ``(B, C, T)``.
        rows: the derivatives times it, ``(B, m, C, T)``.
        gram: their inner products, ``(B, m, m)``.
        slope: those with the errors, ``(B, m)``.
    """

    root: np.ndarray
    weighted: np.ndarray
    rows: np.ndarray
    gram: np.ndarray
    slope: np.ndarray


class _Weighed(NamedTuple):
    """The cost of some errors, the noise of each channel ``(C,)``, and what is summed by batch."""

    cost: float
    sigma: np.ndarray
    batches: list[_WeighedBatch]


def _scores(rows: np.ndarray, weighted: np.ndarray) -> np.ndarray:
    """The gradient by coordinates, for each block of time of each log, ``(k, B * blocks)``."""
    sums = by_blocks(rows * weighted[:, None], SETTINGS.structure.blocks, np)
    return sums.transpose(1, 0, 2).reshape(sums.shape[1], -1)


def _response_to(
    slopes: StepSlopes, place: int, series: np.ndarray, over: np.ndarray
) -> np.ndarray:
    """A batch's response to series at the samples, and their means until the next, at a place."""
    count = series.shape[1]
    padding = ((0, 0), (0, -count % ABREAST), (0, 0))
    series, over = np.pad(series, padding), np.pad(over, padding)
    now, later, direct = (
        matrix[..., place] for matrix in (slopes.push_now, slopes.push_over, slopes.direct)
    )
    chunks = [
        (series[:, at : at + ABREAST], over[:, at : at + ABREAST])
        for at in range(0, count, ABREAST)
    ]
    out = [
        np.asarray(_propagated(slopes.transition, slopes.output, now, later, direct, *chunk))
        for chunk in chunks
    ]
    return np.concatenate(out, axis=1)[:, :count]


@program(0)
def _propagated(
    transition: Any, output: Any, now: Any, later: Any, direct: Any, series: Any, over: Any
) -> Any:
    def of_log(log: Any) -> Any:
        transition, output, now, later, direct, series, over = log

        pushes = now[:, :, None] * series.T[:, None] + later[:, :, None] * over.T[:, None]

        def body(x: Any, row: Any) -> tuple[Any, Any]:
            a, after = row
            # one kernel: with a matrix product a step of five states takes three times as long
            for i in range(len(x)):
                after = after + a[:, i, None] * x[i, None]
            return after, x

        start = jnp.zeros((transition.shape[-1], series.shape[0]))
        states = jax.lax.scan(body, start, (transition, pushes))[1]
        return jnp.einsum("tcn,tnk->kct", output, states) + direct.T[None] * series[:, None]

    return jax.lax.map(of_log, (transition, output, now, later, direct, series, over))


def gauss_newton_step(
    information: np.ndarray, gradient: np.ndarray, movable: np.ndarray
) -> np.ndarray:
    """The full Gauss-Newton step in the coordinates that may move; zero in the others.

    The information is scaled to a unit diagonal first: parameters differ in unit by 1e3 and more.
    """
    length = np.sqrt(np.diagonal(information))
    live = (length > 0) & np.isfinite(length) & movable
    scaled = information[np.ix_(live, live)] / np.outer(length[live], length[live])
    slope = gradient[live] / length[live]
    step = np.zeros(gradient.size)
    step[live] = -(np.linalg.pinv(scaled, rcond=1e-9, hermitian=True) @ slope) / length[live]
    return step


def promised_gain(q: Quadratic, movable: np.ndarray) -> float:
    """The gain in log-likelihood that a full Gauss-Newton step promises.

    The likelihood goes with the logarithm of the squared errors: a step that removes most of them
    gains more than its quadratic says.
    """
    if not q.energy > 0:
        return 0.0
    step = gauss_newton_step(q.information, q.gradient, movable)
    removed = -float(np.sum(np.where(step != 0.0, q.gradient * step, 0.0)))
    energy = float(q.energy) / len(q.sigma)
    return -0.5 * energy * float(np.log1p(-min(removed / energy, _MOST_REMOVED)))


# -- whether coordinates at zero differ from it by more than chance, beside estimated ones ---------


def project_out(
    information: np.ndarray, scores: np.ndarray, base: int
) -> tuple[np.ndarray, np.ndarray]:
    """Information and scores of coordinates, without what the first ``base`` ones do (Neyman 1959).

    Args:
        information: of all coordinates, ``(n, n)``.
        scores: the gradient by blocks of time, ``(n, blocks)``.
        base: the number of coordinates that are projected out.

    Returns:
        The information ``(n - base, n - base)`` and the scores ``(n - base, blocks)``.
    """
    scores = np.where(np.isfinite(np.diagonal(information))[:, None], scores, 0.0)
    information = without_overflow(information)
    nuisance, cross = information[:base, :base], information[base:, :base]
    # a pseudo-inverse: parameters that the logs do not determine make the information singular
    through = cross @ np.linalg.pinv(nuisance, rcond=1e-11, hermitian=True)
    return information[base:, base:] - through @ cross.T, scores[base:] - through @ scores[:base]


def without_overflow(information: np.ndarray) -> np.ndarray:
    """An information, zero for coordinates whose derivatives overflow along a path.

    They can be neither tested nor moved. A diagonal that is finite bounds all beside it. Of a
    Kingfisher, whose sway nobody measures, one was not, and no eigenvalues are found then.
    """
    finite = np.isfinite(np.diagonal(information))
    return np.where(np.outer(finite, finite), information, 0.0)


def score_test(
    information: np.ndarray, scores: np.ndarray, base: int
) -> tuple[float, np.ndarray, np.ndarray]:
    """Robust score test of coordinates at zero, after ``base`` estimated ones.

    The square of the projected gradient, in units of the information, is divided by the scatter of
    the gradient over blocks of time in the same units: errors that last for less than a block raise
    no alarm. Arguments as of `project_out`.

    Returns:
        The p-value, the one-step estimate of the coordinates, and its covariance.
    """
    from scipy.special import fdtrc  # slow to import

    count = len(scores) - base
    projected, gradient = project_out(information, scores, base)
    values, vectors = np.linalg.eigh(projected)
    # directions that the estimated coordinates can do all of have eigenvalues of rounding errors
    unprojected = np.diagonal(without_overflow(information))[base:].max(initial=0.0)
    kept = values > 1e-8 * max(unprojected, 1e-300)
    rank = int(kept.sum())
    blocks = int(np.sum(np.any(scores != 0, axis=0)))
    if rank == 0 or blocks < SETTINGS.structure.fewest_blocks:
        return 1.0, np.zeros(count), np.full((count, count), np.nan)
    basis = vectors[:, kept] / np.sqrt(values[kept])
    standardised = basis.T @ gradient
    scatter = max(1.0, float(np.sum(standardised**2)) / rank)
    ratio = float(np.sum(standardised.sum(axis=1) ** 2)) / rank / scatter
    covariance = basis @ basis.T
    estimated = -covariance @ gradient.sum(axis=1)
    return float(fdtrc(rank, rank * (blocks - 1), ratio)), estimated, covariance
