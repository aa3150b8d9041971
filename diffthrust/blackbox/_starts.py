"""Starts of the searches for black-box models: linear least squares, single or iterated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diffthrust.blackbox._prediction_error import Shape, equations
from diffthrust.blackbox._records import SampledLog
from diffthrust.blackbox._system import passed

_ROUNDS = 10


def reflected(polynomial: np.ndarray, limit: float = 0.999) -> np.ndarray:
    """The polynomial in q^-1 with its roots inside the unit circle."""
    roots = np.roots(polynomial)
    size = np.abs(roots)
    inside = np.where(size > 1.0, roots / np.maximum(size, 1e-300) ** 2, roots)
    # a root on the circle itself would filter without end
    inside = inside * np.minimum(1.0, limit / np.maximum(np.abs(inside), 1e-300))
    return np.atleast_1d(np.real(np.poly(inside))) if roots.size else polynomial


def least_squares(records: Sequence[SampledLog], shape: Shape) -> np.ndarray:
    """A and B of least squared equation errors: the closed form of ARX."""
    stretches = [stretch for record in records for stretch in equations(record, shape)]
    rows = np.concatenate([stretch[1] for stretch in stretches])
    scale = np.linalg.norm(rows, axis=0)
    scale[scale == 0] = 1.0
    y = np.concatenate([stretch[2] for stretch in stretches])
    return np.linalg.lstsq(rows / scale, y, rcond=None)[0] / scale


def without_c(shape: Shape) -> Shape:
    """The same without C."""
    return Shape(shape.na, shape.nb, 0, shape.delays)


def armax_starts(records: Sequence[SampledLog], shape: Shape) -> list[np.ndarray]:
    """ARX with C = 1, and a regression with residuals of a long ARX in place of the noise.

    Source of the second: Hannan & Rissanen 1982, Biometrika 69.
    """
    starts = [np.concatenate([least_squares(records, without_c(shape)), np.zeros(shape.nc)])]
    samples = sum(int(record.complete.sum()) for record in records)
    # long enough for the noise model's memory, with five equations or more for each coefficient
    depth = min(max(10, 3 * shape.reach), samples // (5 * (1 + len(shape.nb))))
    long = Shape(depth, tuple(n if n == 1 else max(n, depth) for n in shape.nb), 0, shape.delays)
    if depth <= shape.nc or not any(equations(record, long) for record in records):
        return starts
    theta = least_squares(records, long)
    rows, target = [], []
    for record in records:
        noise = np.full(len(record.u), np.nan)
        for t, past, y in equations(record, long):
            noise[t] = y - past @ theta
        for t, past, y in equations(record, without_c(shape)):
            earlier = t[:, None] - np.arange(1, shape.nc + 1)
            lagged = np.where(earlier >= 0, noise[earlier], np.nan)
            complete = np.isfinite(lagged).all(axis=1)
            rows.append(np.concatenate([past, lagged], axis=1)[complete])
            target.append(y[complete])
    matrix, y = np.concatenate(rows), np.concatenate(target)
    if len(y) > matrix.shape[1]:
        theta = np.linalg.lstsq(matrix, y, rcond=None)[0]
        _, _, c = shape.split(theta)
        starts.append(shape.with_c(theta, reflected(c)))
    return starts


def output_error_starts(records: Sequence[SampledLog], shape: Shape) -> list[np.ndarray]:
    """ARX, and ARX on records filtered by 1 / A of the last round (Steiglitz & McBride 1965).

    Unstable poles are reflected into the unit circle.
    """
    free = without_c(shape)

    def inside(theta: np.ndarray) -> np.ndarray:
        a = reflected(np.concatenate([[1.0], theta[: shape.na]]))
        return np.concatenate([a[1:], theta[shape.na :]])

    raw = least_squares(records, free)
    theta = inside(raw)
    # the raw ARX stays among the starts: an unstable system is lost by reflection
    starts = [theta] if np.allclose(theta, raw) else [theta, raw]
    filled = [_filled(record) for record in records]
    for _ in range(_ROUNDS):
        a, _, _ = free.split(theta)
        whitened = [SampledLog(passed(a, r.u), passed(a, r.y), r.log) for r in filled]
        theta = inside(least_squares(whitened, free))
    return [theta, *starts]


def _filled(record: SampledLog) -> SampledLog:
    """The record with gaps interpolated linearly."""
    measured, y = record.complete, record.y
    if measured.all():
        return record
    t = np.arange(len(y))
    return SampledLog(record.u, np.interp(t, t[measured], y[measured, 0])[:, None], record.log)
