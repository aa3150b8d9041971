"""State-space matrices of least free-simulation error.

The basis of the states is arbitrary, so the gradient is singular; damped steps move only in
directions that change the error. Starting states are
eliminated in each record (variable projection, Golub & Pereyra 1973). Source: Ljung 1999, System
Identification, 2nd edition, section 10.2; McKelvey, Helmersson & Ribarits 2004, Automatica 40, for
steps in data-driven local coordinates.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from diffthrust.blackbox._sampled import SampledLog, System
from diffthrust.blackbox._search import FLAT

_STEPS = 100
_STILL = 1e-6
"""The search ends if a step lowers the squared error by less than this share."""


class Simulated(NamedTuple):
    """The end of the search: a system without a predictor (K = 0)."""

    system: System
    error: float
    """Sum of squares, each output scaled by its size."""
    stationary: bool
    agreeing: int = 1
    """Number of starts that ended there."""


def simulation_fit(
    starts: Sequence[System], records: Sequence[SampledLog], free: np.ndarray
) -> Simulated:
    """Minimise the error of free simulation, each output scaled by its size.

    All of A, B and C is free, and the entries ``free`` of D, ``(p, m)``.
    """
    size = output_sizes(records)
    ends = [_searched(start, records, size, free) for start in starts]
    best = min(ends, key=lambda end: end.error)
    samples = sum(int(np.isfinite(r.y).sum()) for r in records)
    agreeing = sum(end.error <= 1.001 * best.error + 1e-18 * samples for end in ends)
    return best._replace(agreeing=agreeing)


def _searched(
    start: System, records: Sequence[SampledLog], size: np.ndarray, free: np.ndarray
) -> Simulated:
    current = _settled(start)
    error, r, j = linearized(current, records, size, free)
    damping = 1e-3 * np.mean(np.sum(j**2, axis=0))
    for _ in range(_STEPS):
        squares, slope = j.T @ j, j.T @ r
        length = np.linalg.norm(j, axis=0) * np.linalg.norm(r)
        flat = np.max(np.abs(slope) / np.where(length > 0, length, 1.0), initial=0.0)
        if error <= 1e-18 * r.size or flat < FLAT:  # the remaining error is rounding
            return Simulated(current, error, True)
        # damping also selects the step: the Jacobian has n^2 null directions, one for each change
        # of basis
        while damping < 1e12 * np.trace(squares):
            step = -np.linalg.solve(squares + damping * np.eye(slope.size), slope)
            trial = stepped(current, step, free)
            lower = squared_error(trial, records, size)
            if lower < error:
                break
            damping *= 4.0
        else:
            return Simulated(current, error, True)  # no step lowers the error beyond rounding
        still = lower > (1.0 - _STILL) * error
        current, damping = trial, damping / 5.0
        error, r, j = linearized(current, records, size, free)
        # a small gain under heavy damping is a short step, and no proof of an end
        if still and damping < 1e-3 * np.trace(squares):
            return Simulated(current, error, True)
    return Simulated(current, error, False)


def output_sizes(records: Sequence[SampledLog]) -> np.ndarray:
    """Root mean square of each output, ``(p,)``; 1 if it is zero."""
    power = np.nanmean(np.concatenate([r.y for r in records]) ** 2, axis=0)
    return np.where(power > 0, np.sqrt(power), 1.0)


def _settled(start: System) -> System:
    """The start without predictor, its poles reflected into the unit circle."""
    values, vectors = np.linalg.eig(start.a)
    size = np.abs(values)
    a = start.a
    if np.any(size >= 1.0):
        # reflected poles keep the magnitude of the response on the unit circle but for a factor
        inside = np.where(size >= 1.0, values / np.maximum(size, 1e-300) ** 2 * 0.999, values)
        a = np.real(vectors @ np.diag(inside) @ np.linalg.inv(vectors))
    return System(a, start.b, start.c, start.d, np.zeros_like(start.k), start.lags)


def stepped(s: System, step: np.ndarray, free: np.ndarray) -> System:
    n, m, p = s.a.shape[0], s.b.shape[1], s.c.shape[0]
    ab, c, d = np.split(step, [n * (n + m), n * (n + m) + p * n])
    ab = ab.reshape(n, n + m)
    moved = s.d.copy()
    moved[free] += d
    return System(s.a + ab[:, :n], s.b + ab[:, n:], s.c + c.reshape(p, n), moved, s.k, s.lags)


def squared_error(s: System, records: Sequence[SampledLog], size: np.ndarray) -> float:
    total = 0.0
    for record in records:
        missed = (s.simulate(record.u, record.y) - record.y) / size
        total += float(np.nansum(missed**2))
    return total if np.isfinite(total) else np.inf


def linearized(
    s: System, records: Sequence[SampledLog], size: np.ndarray, free: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Squared error, residuals ``(N,)`` and their gradient ``(N, k)``."""
    parts = [
        _linearized_record(s, record, size, free) for record in records if len(record.u) > s.unknown
    ]
    r, j = (np.concatenate(column) for column in zip(*parts, strict=True))
    return float(r @ r), r, j


def _linearized_record(
    s: System, record: SampledLog, size: np.ndarray, free: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    n, m, p = s.a.shape[0], s.b.shape[1], s.c.shape[0]
    u, y = s.late(record.u)[s.unknown :], record.y[s.unknown :]
    finite, driven = np.isfinite(y), u @ s.b.T
    x = np.zeros((len(u), n, 1 + n))  # response from rest, and to each starting state
    x[0, :, 1:] = np.eye(n)
    for t in range(len(u) - 1):
        x[t + 1] = s.a @ x[t]
        x[t + 1, :, 0] += driven[t]
    out = (s.c @ x) / size[:, None]
    out[:, :, 0] += u @ s.d.T / size
    basis, r = out[:, :, 1:][finite], (out[:, :, 0] - y / size)[finite]
    q, triangle = np.linalg.qr(basis)
    begin = -np.linalg.lstsq(triangle, q.T @ r, rcond=1e-10)[0]
    r = r + basis @ begin
    states = x[:, :, 0] + x[:, :, 1:] @ begin
    regressors = np.concatenate([states, u], axis=1)
    grown = np.zeros((len(u), n, n, n + m))  # derivatives of the states by each entry of A and B
    rows = np.arange(n)
    for t in range(len(u) - 1):
        grown[t + 1] = (s.a @ grown[t].reshape(n, -1)).reshape(n, n, n + m)
        grown[t + 1, rows, rows] += regressors[t]
    by_ab = (s.c @ grown.reshape(len(u), n, -1)).reshape(len(u), p, -1)
    by_c = np.einsum("kl,tj->tklj", np.eye(p), states).reshape(len(u), p, p * n)
    by_d = np.einsum("kl,tj->tklj", np.eye(p), u)[:, :, free]
    j = (np.concatenate([by_ab, by_c, by_d], axis=2) / size[:, None])[finite]
    return r, j - q @ (q.T @ j)
