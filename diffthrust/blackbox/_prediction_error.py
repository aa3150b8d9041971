"""Residuals of polynomial models with their gradients by filtering.

All models here are A(q) y = sum of q^-delay B(q) u + C(q) e, with C = 1 (ARX), a free C (ARMAX), or
C = A (output error). Source: Ljung 1999, System Identification, 2nd
edition, sections 10.2 and 10.3. The past before a record enters as starting values, which are
eliminated in each stretch (variable projection, Golub & Pereyra 1973).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from diffthrust.blackbox._records import SampledLog
from diffthrust.blackbox._system import passed


@dataclass(frozen=True)
class Shape:
    """The coefficients of a model.

    Args:
        na: of A.
        nb: of each input's B.
        nc: of C.
        delays: of each input [samples].
        tied: C is A.
    """

    na: int
    nb: tuple[int, ...]
    nc: int
    delays: tuple[int, ...]
    tied: bool = False

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return self.na + sum(self.nb) + self.nc

    @property
    def first(self) -> int:
        """The first sample with all its inputs inside the record."""
        return max(d + n - 1 for d, n in zip(self.delays, self.nb, strict=True))

    @property
    def reach(self) -> int:
        """Number of past samples in an equation."""
        return max(self.na, self.first)

    def split(self, theta: np.ndarray) -> tuple[np.ndarray, list[np.ndarray], np.ndarray]:
        """Polynomials A, B by input, and C."""
        a = np.concatenate([[1.0], theta[: self.na]])
        ends = self.na + np.cumsum([0, *self.nb])
        b = [theta[i:j] for i, j in pairwise(ends)]
        c = a if self.tied else np.concatenate([[1.0], theta[ends[-1] :]])
        return a, b, c

    def with_c(self, theta: np.ndarray, c: np.ndarray) -> np.ndarray:
        """The coefficients with C replaced."""
        return np.concatenate([theta[: self.na + sum(self.nb)], c[1:]])


def equations(record: SampledLog, shape: Shape) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Rows of past values, and the output, for each stretch without a gap.

    Returns:
        ``(samples (n,), rows (n, na + nb), y (n,))`` of each stretch; y = rows @ (a, b) + C e.
    """
    y, rows = record.y[:, 0], []
    for begin, end in record.segments:
        t = np.arange(max(begin + shape.na, shape.first), end)
        if t.size:
            columns = [-y[t - i] for i in range(1, shape.na + 1)]
            columns += [record.u[t - d - i, j]
                        for j, (d, n) in enumerate(zip(shape.delays, shape.nb, strict=True))
                        for i in range(n)]  # fmt: skip
            rows.append((t, np.stack(columns, axis=1), y[t]))
    return rows


def stretches(
    records: Sequence[SampledLog], shape: Shape, theta: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray, int]]:
    """Residuals ``(n,)``, their gradient ``(n, k)`` and the starting values by stretch."""
    residuals_of = _simulated if shape.tied else _predicted
    return [stretch for record in records for stretch in residuals_of(record, shape, theta)]


def _predicted(
    record: SampledLog, shape: Shape, theta: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray, int]]:
    """C e = A y - B u + starting values, in each stretch without a gap."""
    _, _, c = shape.split(theta)
    out = []
    for _, rows, y in equations(record, shape):
        wrong = y - rows @ theta[: rows.shape[1]]
        if not shape.nc:
            out.append((wrong, -rows, 0))
            continue
        e = passed(c, wrong)
        basis = _pulses(c, y.size, shape.nc)
        _check_finite(e, basis)
        # starting values are linear: the best ones are projected off, so the search knows only
        # coefficients
        e = e - basis @ np.linalg.lstsq(basis, e, rcond=None)[0]
        by_ab = -passed(c, rows)
        # dC/dc_i e = q^-i e, filtered once more by 1 / C
        past = passed(c, e)
        by_c = -np.stack([_later(past, i) for i in range(1, shape.nc + 1)], axis=1)
        out.append((e, _freed(np.concatenate([by_ab, by_c], axis=1), basis), basis.shape[1]))
    return out


def _simulated(
    record: SampledLog, shape: Shape, theta: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray, int]]:
    """Y - w with A w = B u + starting values; gaps are left out."""
    a, b, _ = shape.split(theta)
    t = np.arange(min(shape.first, len(record.u)), len(record.u))
    measured = record.complete[t]
    if not measured.any():
        return []
    y = record.y[t, 0][measured]
    late = [
        record.u[t - d - i, j]
        for j, (d, n) in enumerate(zip(shape.delays, shape.nb, strict=True))
        for i in range(n)
    ]
    rows = passed(a, np.stack(late, axis=1))
    driven = rows @ np.concatenate(b)
    basis = _pulses(a, t.size, shape.na)
    free = basis.shape[1]
    start = np.zeros(free)
    _check_finite(driven, basis)
    if free:
        # nearly equal poles make nearly equal responses: directions at rounding level are left out
        start = np.linalg.lstsq(basis[measured], y - driven[measured], rcond=1e-12)[0]
    w = driven + basis @ start
    past = passed(a, w)
    by_a = [_later(past, i) for i in range(1, shape.na + 1)]
    gradient = np.concatenate([*(x[:, None] for x in by_a), -rows], axis=1)[measured]
    return [(y - w[measured], _freed(gradient, basis[measured]), free)]


def _check_finite(*series: np.ndarray) -> None:
    """Raise before LAPACK receives non-finite output of an unstable filter."""
    if not all(np.isfinite(x).all() for x in series):
        raise FloatingPointError


def _later(x: np.ndarray, samples: int) -> np.ndarray:
    return np.concatenate([np.zeros(samples), x])[: x.size]


def _pulses(c: np.ndarray, size: int, count: int) -> np.ndarray:
    """Responses to starting values at the first samples, ``(size, count)``."""
    count = min(count, size)
    pulse = np.zeros(size)
    pulse[0] = 1.0
    pulse = passed(c, pulse)
    if not count:
        return np.zeros((size, 0))
    return np.stack([_later(pulse, i) for i in range(count)], axis=1)


def _freed(gradient: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """The gradient with starting values profiled out (projected off their responses)."""
    if not basis.shape[1]:
        return gradient
    # Kaufman's simplification of the variable-projection gradient: its second term is of the order
    # of the residuals
    q, _ = np.linalg.qr(basis)
    return gradient - q @ (q.T @ gradient)
