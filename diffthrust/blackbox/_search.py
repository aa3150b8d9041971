"""Search for the coefficients of least squared residuals, and assessment of its end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from diffthrust.blackbox._criteria import WHITENESS_LEVEL, memory_of
from diffthrust.blackbox._prediction_error import Shape, equations, stretches
from diffthrust.blackbox._records import SampledLog
from diffthrust.blackbox._starts import reflected

_FLAT = 1e-5
"""Largest |J_j . r| / (|J_j| |r|) at a point that counts as stationary."""
_RANK = 1e-10
"""Singular values of the scaled gradient below this share of the largest count as zero."""
_WORTH = 11.0
"""An unstable model is kept if it gains this in twice the log-likelihood (chi-square, 0.1 %)."""


@dataclass(frozen=True)
class SearchEnd:
    """The outcome of a search.

    Args:
        theta: coefficients, ``(k,)``.
        covariance: of the coefficients, ``(k, k)``; ``None`` if they are not identifiable.
        variance: of the one-step prediction's error (of the output's for an output error).
        residuals: by stretch.
        flat: max over coefficients of |J_j . r| / (|J_j| |r|).
        rank: of the scaled gradient.
        starts: number of starts.
        agreeing: number of starts that ended there.
        memory: lag-one correlation of residuals, and its p-value for white ones; NaN if there are
            too few.
    """

    theta: np.ndarray
    covariance: np.ndarray | None
    variance: float
    residuals: list[np.ndarray] = field(repr=False)
    flat: float
    rank: int
    starts: int
    agreeing: int
    memory: tuple[float, float]

    @property
    def stationary(self) -> bool:
        """Whether the end is stationary."""
        return self.flat < _FLAT


def search_coefficients(
    records: Sequence[SampledLog], shape: Shape, starts: Sequence[np.ndarray]
) -> SearchEnd:
    """The coefficients of least squared residuals, from several starts.

    Starts whose residuals are not finite are left out; at least one must have finite ones.
    """
    from scipy.optimize import least_squares  # takes a while

    # SciPy asks for residuals and Jacobian of one point in two calls: the last point is kept
    kept: list[tuple[np.ndarray, list[tuple[np.ndarray, np.ndarray, int]]]] = []

    def parts(theta: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, int]]:
        if not (kept and np.array_equal(kept[0][0], theta)):
            with np.errstate(over="ignore", invalid="ignore"):
                try:
                    now = stretches(records, shape, theta)
                except (
                    np.linalg.LinAlgError,
                    FloatingPointError,
                ):  # an unstable filter overflowed
                    now = [(np.full(1, np.inf), np.zeros((1, shape.size)), 0)]
            kept[:] = [(theta.copy(), now)]
        return kept[0][1]

    def residual(theta: np.ndarray, bounded: bool = False) -> np.ndarray:
        if bounded and not settles(theta):
            return np.full(count, np.inf)
        joined = np.concatenate([stretch[0] for stretch in parts(theta)])
        return joined if np.isfinite(joined).all() else np.full(count, np.inf)

    def gradient(theta: np.ndarray) -> np.ndarray:
        return np.concatenate([stretch[1] for stretch in parts(theta)])

    counts = [int(r.complete[shape.first :].sum()) for r in records]
    if not shape.tied:
        counts = [t.size for r in records for t, _, _ in equations(r, shape)]
    count, scale = sum(counts), size_of(records)

    def settles(theta: np.ndarray) -> bool:
        return bool(np.all(np.abs(np.roots(shape.split(theta)[0])) < 1.0))

    def end_of(start: np.ndarray, bounded: bool = False) -> tuple[float, np.ndarray]:
        with np.errstate(over="ignore", invalid="ignore"):
            if not np.isfinite(residual(start, bounded)).all():
                return np.inf, start
            # residuals in units of the output, so that the tolerances mean the same for newtons and
            # for rpm
            end = least_squares(
                lambda theta: residual(theta, bounded) / scale,
                start,
                jac=lambda theta: gradient(theta) / scale,  # pyright: ignore
                x_scale="jac",
                xtol=1e-10,
                ftol=1e-12,
                gtol=1e-12,
                max_nfev=200,
            )
        return float(end.cost), end.x

    ends = [end_of(start) for start in starts]
    best, theta = min(ends, key=lambda end: end[0])
    if not np.isfinite(best):
        raise FloatingPointError
    agreeing = sum(cost <= best * 1.001 + 1e-20 * count for cost, _ in ends)
    if shape.tied and not settles(
        theta
    ):  # an unstable model is kept only if the records clearly favour it
        restarts = [np.concatenate([reflected(shape.split(s)[0])[1:], s[shape.na :]])
                 for s in (theta, *starts)]  # fmt: skip
        cost, alternative = min((end_of(start, True) for start in restarts), key=lambda end: end[0])
        if count * np.log(max(cost, 1e-300) / max(best, 1e-300)) < _WORTH:
            stable = judged(parts(alternative), alternative, shape, scale, len(starts), agreeing)
            if stable.stationary:  # not merely stopped at the stability limit
                return stable
    return judged(parts(theta), theta, shape, scale, len(starts), agreeing)


def size_of(records: Sequence[SampledLog]) -> float:
    """Root mean square of the outputs; 1 if all are zero."""
    return float(np.sqrt(np.mean(np.concatenate([r.y[r.complete] for r in records]) ** 2))) or 1.0


def judged(
    parts: Sequence[tuple[np.ndarray, np.ndarray, int]],
    theta: np.ndarray,
    shape: Shape,
    scale: float,
    starts: int = 1,
    agreeing: int = 1,
) -> SearchEnd:
    """Variance and covariance at a point, and whether it is stationary.

    For an output error, the covariance allows for autocorrelated residuals that are independent of
    the input: sums over lags of their correlation times that of the gradient (Ljung 1999, section
    9.3).
    """
    residuals = [stretch[0] for stretch in parts]
    r, j = np.concatenate(residuals), np.concatenate([stretch[1] for stretch in parts])
    # columns of unit length: the rank then does not depend on the units of the channels
    size = np.linalg.norm(j, axis=0)
    size = np.where(size > 0, size, 1.0)
    scaled = j / size
    norm = float(np.linalg.norm(r))
    exact = norm <= 1e-9 * scale * np.sqrt(r.size)  # the remaining residuals are rounding errors
    flat = 0.0 if exact else float(np.max(np.abs(scaled.T @ r), initial=0.0)) / norm
    _, values, v = np.linalg.svd(scaled, full_matrices=False)
    rank = int(np.sum(values > _RANK * values.max(initial=0.0)))
    degrees = r.size - theta.size - sum(stretch[2] for stretch in parts)
    variance = norm**2 / degrees if degrees > 0 else np.nan
    memory = memory_of(residuals, 0 if shape.tied else shape.na + shape.nc)
    covariance = None
    if rank == theta.size and degrees > 0:
        half = v.T / values / size[:, None]
        covariance = half @ half.T
        if shape.tied and memory[1] < WHITENESS_LEVEL:
            covariance = covariance @ _with_memory(parts, r.size / degrees) @ covariance
        else:
            covariance = variance * covariance
    return SearchEnd(theta, covariance, variance, residuals, flat, rank, starts, agreeing, memory)


def _with_memory(parts: Sequence[tuple[np.ndarray, np.ndarray, int]], factor: float) -> np.ndarray:
    """The covariance of the gradient of the squared errors, ``(k, k)``."""
    samples = sum(e.size for e, _, _ in parts)
    longest = min(samples // 4, max(e.size for e, _, _ in parts) - 1)
    # two standard errors of a correlation of white noise (Bartlett)
    limit = 2.0 / np.sqrt(samples)
    power = sum(float(e @ e) for e, _, _ in parts) / samples
    total = power * sum(j.T @ j for _, j, _ in parts)
    quiet, lag = 0, 1
    while quiet < 5 and lag < longest:  # until the correlation stays within its confidence band
        used = [(e, j) for e, j, _ in parts if e.size > lag]
        r = sum(float(e[lag:] @ e[:-lag]) for e, _ in used) / samples
        cross = sum(j[lag:].T @ j[:-lag] for _, j in used)
        total = total + r * (cross + cross.T)  # pyright: ignore
        quiet = quiet + 1 if abs(r) < limit * power else 0
        lag += 1
    # a sum over lags that is cut off need not be positive definite: negative variances are lifted
    values, vectors = np.linalg.eigh(total)
    floor = 1e-3 * np.abs(values).max()
    return factor * (vectors * np.maximum(values, floor * (values <= 0))) @ vectors.T
