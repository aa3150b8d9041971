"""What one-step errors answer to anything that is added at a port or to a channel.

Along the path of a trial the innovations form is linearised sample by sample: how the states after
a sample, and its errors, depend on the states before it, on the parameters, and on a push at each
port and channel. All samples are linearised side by side, in one small program for each model;
whatever is then added anywhere is carried through these matrices by a program that knows no model.
So every candidate and every signal of unknown form is tried without compiling anything for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.programs import program
from diffthrust.diagnosis._score_test import gauss_newton_step
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._step_slopes import StepSlopes, step_slopes
from diffthrust.estimation._likelihood import Quadratic
from diffthrust.estimation._one_step import batch_passes
from diffthrust.estimation._problem import Problem

_NARROW, _WIDE = 32, 128
"""So many series are carried through a log together, or so many where there are more than half of
that: a step of the loop takes hardly longer with them."""


class LinearResponse:
    """The answer of the one-step errors of a trial.

    Args:
        problem: the logs, at the values of the trial and under its limit of errors.

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
        self.cost = float(_law(layout, numbers, self.errors)[0])

    def to(
        self, place: str, series: Sequence[np.ndarray], ends: Sequence[np.ndarray] | None = None
    ) -> list[np.ndarray]:
        """Derivatives of the errors by a factor of each of some series, added at a place.

        Args:
            place: a port, an input, or a measured channel.
            series: by batch ``(B, K, T)``.
            ends: what they have become when the next sample comes; its own values where ``None``.

        Returns:
            By batch ``(B, K, C, T)``.
        """
        if ends is None:
            ends = [np.concatenate([start[..., 1:], start[..., -1:]], axis=-1) for start in series]
        held = [dict(grid.hold).get(place) == "zero" for grid in self.problem.layout.grids]
        return [
            _response_to(
                slopes, slopes.places.index(place), start, start if still else 0.5 * (start + end)
            )
            for slopes, start, end, still in zip(self.slopes, series, ends, held, strict=True)
        ]

    def quadratic(
        self, more: Sequence[np.ndarray] = (), change: Sequence[np.ndarray] = ()
    ) -> Quadratic:
        """The likelihood of the trial with more coordinates, after its own shared ones.

        Args:
            more: derivatives of the errors by these coordinates, by batch ``(B, K, C, T)``.
            change: what the errors are changed by, by batch ``(B, C, T)``.
        """
        layout, numbers = self.problem.layout, self.problem.numbers
        errors = self.errors
        if change:
            errors = [e + d for e, d in zip(errors, change, strict=True)]
        cost, sigma = _law(layout, numbers, errors)
        sigma = np.asarray(sigma)
        n, extra = layout.shared, more[0].shape[1] if more else 0
        size, starts = n + extra, len(layout.starts)
        count = sum(batch_errors.shape[0] for batch_errors in errors)
        information = np.zeros((size + count * starts,) * 2)
        gradient, energy, scores, at = np.zeros(size + count * starts), 0.0, [], size
        for i, weighted in enumerate(errors):
            root = np.sqrt(np.asarray(layout.likelihood.law.weights(weighted, sigma)))
            root = root / sigma[None, :, None]
            weighted, jacobian = weighted * root, self.slopes[i].jacobian
            parts = [jacobian[:, :n], *([more[i]] if more else []), jacobian[:, n:]]
            rows = np.concatenate(parts, axis=1) * root[:, None]
            scores.append(_by_blocks(rows[:, :size] * weighted[:, None]))
            flat = rows.reshape(*rows.shape[:2], -1)
            gram, slope = (
                flat @ flat.transpose(0, 2, 1),
                flat @ weighted.reshape(len(weighted), -1, 1),
            )
            energy += float(np.sum(weighted**2))
            information[:size, :size] += gram[:, :size, :size].sum(axis=0)
            gradient[:size] += slope[:, :size, 0].sum(axis=0)
            for block, slopes_of_log in zip(gram, slope, strict=True):
                local = slice(at, at + starts)
                information[:size, local] = block[:size, size:]
                information[local, :size] = block[size:, :size]
                information[local, local] = block[size:, size:]
                gradient[local] = slopes_of_log[size:, 0]
                at += starts
        return Quadratic(
            np.asarray(cost), gradient, information, np.asarray(energy), sigma,
            np.concatenate(scores, axis=1),
        )  # fmt: skip

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
        extra_slice = slice(n, n + extra)
        step = gauss_newton_step(q.information, q.gradient, movable)
        room = np.clip(step[extra_slice], *limits)
        if np.any(room != step[extra_slice]):  # those that would go beyond their bounds go to them
            movable = movable.copy()
            movable[extra_slice] = False
            slope = q.gradient + q.information[:, extra_slice] @ room
            step = gauss_newton_step(q.information, slope, movable)
            step[extra_slice] = room
        logs = sum(map(len, self.errors))
        starts = step[n + extra :].reshape(logs, len(self.problem.layout.starts))
        errors, at = [], 0
        for i, (predicted, off) in enumerate(zip(self.errors, change, strict=True)):
            jacobian, count = self.slopes[i].jacobian, len(predicted)
            predicted = predicted + off + np.tensordot(step[:n], jacobian[:, :n], (0, 1))
            predicted = predicted + np.einsum(
                "bj,bjct->bct", starts[at : at + count], jacobian[:, n:]
            )
            if extra:
                predicted = predicted + np.tensordot(step[n : n + extra], more[i], (0, 1))
            errors.append(predicted)
            at += count
        return float(_law(self.problem.layout, self.problem.numbers, errors)[0])

    @cached_property
    def weighted(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """By batch the root of the weights, and the errors and shared derivatives under it."""
        layout, out = self.problem.layout, []
        sigma = np.asarray(_law(layout, self.problem.numbers, self.errors)[1])
        for errors, slopes in zip(self.errors, self.slopes, strict=True):
            root = np.sqrt(np.asarray(layout.likelihood.law.weights(errors, sigma)))
            root = root / sigma[None, :, None]
            shared = slopes.jacobian[:, : layout.shared] * root[:, None]
            out.append((root, errors * root, shared))
        return out

    def scores(
        self, estimated: Sequence[int], more: Sequence[np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Information, and gradient by blocks of time, of some coordinates and of more.

        Args:
            estimated: some of the shared coordinates.
            more: derivatives of the errors by further ones, by batch ``(B, K, C, T)``.
        """
        size = len(estimated) + more[0].shape[1]
        information, scores = np.zeros((size, size)), []
        for (root, residual, shared), added in zip(self.weighted, more, strict=True):
            rows = np.concatenate([shared[:, list(estimated)], added * root[:, None]], axis=1)
            scores.append(_by_blocks(rows * residual[:, None]))
            flat = rows.reshape(*rows.shape[:2], -1)
            information += (flat @ flat.transpose(0, 2, 1)).sum(axis=0)
        return information, np.concatenate(scores, axis=1)

    def held(self, gradient: np.ndarray) -> np.ndarray:
        """Which coordinates of a `quadratic` lie at a bound that the gradient moves them beyond."""
        (low, high), z = self.problem.limits(), self.problem.start()
        shared, more = self.problem.shared, gradient.size - z.size
        low, high, z = (
            np.concatenate([side[:shared], np.full(more, fill), side[shared:]])
            for side, fill in ((low, -np.inf), (high, np.inf), (z, 0.0))
        )
        return ((z <= low + 1e-9) & (gradient >= 0)) | ((z >= high - 1e-9) & (gradient <= 0))

    def batched(self, series: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Series log by log, ``(K, T)`` each, as they are batched: ``(B, K, T)``."""
        out = []
        for batch, indices in zip(self.problem.numbers.batches, self.problem.order, strict=True):
            rows = np.zeros((len(indices), len(series[0]), batch.time.shape[1]))
            for row, index in enumerate(indices):
                rows[row, :, : series[index].shape[1]] = series[index]
            out.append(rows)
        return out


def _by_blocks(products: np.ndarray) -> np.ndarray:
    """Sums of ``(B, k, C, T)`` over channels and blocks of time, ``(k, B * blocks)``."""
    size = -(-products.shape[-1] // SETTINGS.structure.blocks)
    padding = SETTINGS.structure.blocks * size - products.shape[-1]
    padded = np.pad(products.sum(axis=2), ((0, 0), (0, 0), (0, padding)))
    sums = padded.reshape(*padded.shape[:2], SETTINGS.structure.blocks, size).sum(axis=-1)
    return sums.transpose(1, 0, 2).reshape(sums.shape[1], -1)


@program(1)
def _law(layout: Any, numbers: Any, errors: Any) -> Any:
    return layout.cost(numbers, errors)


def _response_to(
    slopes: StepSlopes, place: int, series: np.ndarray, over: np.ndarray
) -> np.ndarray:
    """The errors' answer to series ``(B, K, T)`` at a place, ``(B, K, C, T)``."""
    count = series.shape[1]
    wide = _WIDE if 2 * count > _WIDE else _NARROW
    room = ((0, 0), (0, -count % wide), (0, 0))
    series, over = np.pad(series, room), np.pad(over, room)
    now, later, shown = (chunk[..., place] for chunk in (slopes.now, slopes.over, slopes.shown))
    out = [
        np.asarray(_propagated(slopes.carry, slopes.seen, now, later, shown, *chunk))
        for at in range(0, count, wide)
        for chunk in [(series[:, at : at + wide], over[:, at : at + wide])]
    ]
    return np.concatenate(out, axis=1)[:, :count]


@jax.jit
def _propagated(
    carry: Any, output: Any, now: Any, later: Any, shown: Any, series: Any, over: Any
) -> Any:
    def log_response(log: Any) -> Any:
        carry, output, now, later, shown, series, over = log

        def body(x: Any, row: Any) -> tuple[Any, Any]:
            a, c, b, o, d, p, q = row
            error = c @ x + d[:, None] * p[None, :]
            return a @ x + b[:, None] * p[None, :] + o[:, None] * q[None, :], error

        start = jnp.zeros((carry.shape[-1], series.shape[0]))
        rows = (carry, output, now, later, shown, series.T, over.T)
        return jax.lax.scan(body, start, rows)[1].transpose(2, 1, 0)

    return jax.lax.map(log_response, (carry, output, now, later, shown, series, over))
