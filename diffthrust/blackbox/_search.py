"""Search for the coefficients of least squared residuals, and criteria of what its end is worth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from diffthrust.blackbox._prediction_error import Shape, Stretch, equations, stretches
from diffthrust.blackbox._sampled import SampledLog, System, passed

_ROUNDS = 10
"""Of iterated least squares before an output error."""
FLAT = 1e-5
"""Largest |J_j . r| / (|J_j| |r|) at a point that counts as stationary."""
_RANK = 1e-10
"""Singular values of the scaled gradient below this share of the largest count as zero."""
_WORTH = 11.0
"""An unstable model is kept if it gains this in twice the log-likelihood (chi-square, 0.1 %)."""

_BEYOND = 10.0
"""Numerics: over a record that is N samples long a zero of C may grow to 1 + this / N: answers that
grow to exp(10) keep ten digits."""


def reflected(polynomial: np.ndarray, limit: float = 0.999) -> np.ndarray:
    """The polynomial in q^-1 with its roots inside the unit circle."""
    roots = np.roots(polynomial)
    size = np.abs(roots)
    inside = np.where(size > 1.0, roots / np.maximum(size, 1e-300) ** 2, roots)
    # a root on the circle itself would filter without end
    inside = inside * np.minimum(1.0, limit / np.maximum(np.abs(inside), 1e-300))
    return np.atleast_1d(np.real(np.poly(inside))) if roots.size else polynomial


def equation_fit(records: Sequence[SampledLog], shape: Shape) -> np.ndarray:
    """A and B of least squared equation errors: the closed form of ARX."""
    stretches = [stretch for record in records for stretch in equations(record, shape)]
    rows = np.concatenate([stretch[1] for stretch in stretches])
    scale = np.linalg.norm(rows, axis=0)
    scale[scale == 0] = 1.0
    y = np.concatenate([stretch[2] for stretch in stretches])
    return np.linalg.lstsq(rows / scale, y, rcond=None)[0] / scale


def armax_starts(records: Sequence[SampledLog], shape: Shape) -> list[np.ndarray]:
    """ARX with C = 1, and a regression with residuals of a long ARX in place of the noise.

    Source of the second: Hannan & Rissanen 1982, Biometrika 69.
    """
    starts = [np.concatenate([equation_fit(records, shape.without_c), np.zeros(shape.nc)])]
    samples = sum(int(record.complete.sum()) for record in records)
    # long enough for the noise model's memory, with five equations or more for each coefficient
    depth = min(max(10, 3 * shape.reach), samples // (5 * (1 + len(shape.nb))))
    long = Shape(depth, tuple(n if n == 1 else max(n, depth) for n in shape.nb), 0, shape.delays)
    if depth <= shape.nc or not any(equations(record, long) for record in records):
        return starts
    theta = equation_fit(records, long)
    rows, target = [], []
    for record in records:
        noise = np.full(len(record.u), np.nan)
        for t, past, y in equations(record, long):
            noise[t] = y - past @ theta
        for t, past, y in equations(record, shape.without_c):
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
    free = shape.without_c

    def inside(theta: np.ndarray) -> np.ndarray:
        a = reflected(np.concatenate([[1.0], theta[: shape.na]]))
        return np.concatenate([a[1:], theta[shape.na :]])

    raw = equation_fit(records, free)
    theta = inside(raw)
    # the raw ARX stays among the starts: an unstable system is lost by reflection
    starts = [theta] if np.allclose(theta, raw) else [theta, raw]
    filled = []  # gaps interpolated linearly
    for record in records:
        t = np.arange(len(record.y))
        measured = record.complete
        y = np.interp(t, t[measured], record.y[measured, 0])[:, None]
        filled.append(SampledLog(record.u, y))
    for _ in range(_ROUNDS):
        a, _, _ = free.split(theta)
        whitened = [SampledLog(passed(a, r.u), passed(a, r.y)) for r in filled]
        theta = inside(equation_fit(whitened, free))
    return [theta, *starts]


@dataclass(frozen=True)
class SearchEnd:
    """The outcome of a search."""

    theta: np.ndarray
    covariance: np.ndarray | None
    """Of the coefficients, ``(k, k)``; ``None`` if they are not identifiable."""
    flat: float
    """Max over coefficients of |J_j . r| / (|J_j| |r|)."""
    rank: int
    """Of the scaled gradient."""
    memory: tuple[float, float]
    """Lag-one correlation of residuals, and its p-value for white ones; NaN of too few."""

    @property
    def stationary(self) -> bool:
        """Whether the end is stationary."""
        return self.flat < FLAT


def settles(polynomial: np.ndarray, beyond: float = 0.0) -> bool:
    """Whether all zeros lie inside the unit circle, or no farther beyond it than so much."""
    return bool(np.all(np.abs(np.roots(polynomial)) < 1.0 + beyond))


class _Residuals:
    """Residuals and their gradient in units of the output: tolerances mean the same in any unit.

    SciPy asks for both of one point in two calls: the last point is kept.
    """

    def __init__(self, records: Sequence[SampledLog], shape: Shape) -> None:
        self.records = records
        self.shape = shape
        self.scale = size_of(records)
        counts = [int(r.complete[shape.first :].sum()) for r in records]
        if not shape.tied:
            counts = [t.size + shape.nc for r in records for t, _, _ in equations(r, shape)]
        self.count = sum(counts)
        # a C is as likely as its mirror image in the unit circle: the likelihood is level on the
        # circle itself, and a search that may step across it ends there instead of creeping up to
        # it
        self.beyond = _BEYOND / max(len(record.u) for record in records)
        self.last: tuple[np.ndarray, list[Stretch]] | None = None

    def parts(self, theta: np.ndarray) -> list[Stretch]:
        if self.last is None or not np.array_equal(self.last[0], theta):
            with np.errstate(over="ignore", invalid="ignore"):
                try:
                    parts = stretches(self.records, self.shape, theta)
                except (np.linalg.LinAlgError, FloatingPointError):  # an unstable filter overflowed
                    parts = [Stretch(np.full(1, np.inf), 1, np.zeros((1, self.shape.size)))]
            self.last = theta.copy(), parts
        return self.last[1]

    def value(self, theta: np.ndarray, bounded: bool = False) -> np.ndarray:
        """Residuals, infinite where C, or of a ``bounded`` search A, leaves the unit circle."""
        a, _, c = self.shape.split(theta)
        settled = settles(c, self.beyond) if self.shape.nc else not bounded or settles(a)
        joined = joint(self.parts(theta))[0] if settled else np.full(self.count, np.inf)
        return joined / self.scale if np.isfinite(joined).all() else np.full(self.count, np.inf)

    def gradient(self, theta: np.ndarray) -> np.ndarray:
        return joint(self.parts(theta))[1] / self.scale

    def minimum(self, start: np.ndarray, bounded: bool = False) -> tuple[float, np.ndarray]:
        """Half the least squares reached from a start, and the coefficients there."""
        from scipy.optimize import least_squares  # takes a while

        with np.errstate(over="ignore", invalid="ignore"):
            if not np.isfinite(self.value(start, bounded)).all():
                return np.inf, start
            end = least_squares(
                lambda theta: self.value(theta, bounded),
                start,
                jac=self.gradient,  # pyright: ignore
                x_scale="jac",
                xtol=1e-10,
                ftol=1e-12,
                gtol=1e-12,
                max_nfev=200,
            )
        if not self.shape.nc or not end.cost > 0:
            return float(end.cost), end.x
        return self._polished(end)

    def _polished(self, end: Any) -> tuple[float, np.ndarray]:
        """Where BFGS leads from the end of a Gauss-Newton search.

        Gauss-Newton lacks the curvature of the determinant: near the unit circle, where that is all
        there is, it creeps.
        """
        from scipy.optimize import minimize  # takes a while

        count = end.fun.size
        size = np.linalg.norm(end.jac, axis=0)
        size[size == 0] = 1.0
        _, values, turned = np.linalg.svd(end.jac / size, full_matrices=False)
        values = np.maximum(values, 1e-6 * values.max()) * np.sqrt(count / (2.0 * end.cost))
        whitened = turned.T / values / size[:, None]

        def unlikely(step: np.ndarray) -> tuple[float, np.ndarray]:
            r = self.value(end.x + whitened @ step)
            if not np.isfinite(r).all():
                return np.inf, np.zeros_like(step)
            slope = whitened.T @ (self.gradient(end.x + whitened @ step).T @ r)
            return float(0.5 * count * np.log(r @ r)), count * slope / (r @ r)

        start = np.zeros(end.x.size)
        best = minimize(unlikely, start, jac=True, method="BFGS", options={"gtol": 1e-5})
        theta = end.x + whitened @ best.x
        return 0.5 * float(np.sum(self.value(theta) ** 2)), theta


def search_coefficients(
    records: Sequence[SampledLog], shape: Shape, starts: Sequence[np.ndarray]
) -> SearchEnd:
    """The coefficients of the largest likelihood, from several starts: of least squared residuals.

    Starts whose residuals are not finite are left out; at least one must have finite ones.
    """
    residuals = _Residuals(records, shape)
    best, theta = min(map(residuals.minimum, starts), key=lambda end: end[0])
    if not np.isfinite(best):
        raise FloatingPointError
    if shape.nc:  # of the two only the one inside can predict
        theta = shape.with_c(theta, reflected(shape.split(theta)[2], 1.0))
    # an unstable model is kept only if the records clearly favour it
    if shape.tied and not settles(shape.split(theta)[0]):
        ends = [
            residuals.minimum(
                np.concatenate([reflected(shape.split(s)[0])[1:], s[shape.na :]]), True
            )
            for s in (theta, *starts)
        ]
        cost, alternative = min(ends, key=lambda end: end[0])
        gain = residuals.count * np.log(max(cost, 1e-300) / max(best, 1e-300))
        if gain < _WORTH:
            stable = judged(residuals.parts(alternative), alternative, shape, residuals.scale)
            if stable.stationary:  # not merely stopped at the stability limit
                return stable
    return judged(residuals.parts(theta), theta, shape, residuals.scale)


def joint(parts: Sequence[Stretch]) -> tuple[np.ndarray, np.ndarray]:
    """Residuals whose squares are least where the likelihood is largest, and their gradient.

    With N samples of covariance S^2 D the likelihood is largest where the sum of squares times
    det(D)^(1/N) is least. Source: Ansley 1979, Biometrika 66.
    """
    r, j = (np.concatenate(rows) for rows in ([x.residuals for x in parts],
                                              [x.gradient for x in parts]))  # fmt: skip
    twice = 2.0 * sum(stretch.samples for stretch in parts)
    factor = np.exp(sum(stretch.log_determinant for stretch in parts) / twice)
    slope = sum(stretch.slope for stretch in parts) / twice
    return factor * r, factor * (j + r[:, None] * slope)


def size_of(records: Sequence[SampledLog]) -> float:
    """Root mean square of the outputs; 1 if all are zero."""
    return float(np.sqrt(np.mean(np.concatenate([r.y[r.complete] for r in records]) ** 2))) or 1.0


def judged(parts: Sequence[Stretch], theta: np.ndarray, shape: Shape, scale: float) -> SearchEnd:
    """Variance and covariance at a point, and whether it is stationary.

    For an output error, the covariance allows for autocorrelated residuals that are independent of
    the input: sums over lags of their correlation times that of the gradient (Ljung 1999, section
    9.3).
    """
    r, j = joint(parts)
    # columns of unit length: the rank then does not depend on the units of the channels
    size = np.linalg.norm(j, axis=0)
    size = np.where(size > 0, size, 1.0)
    scaled = j / size
    norm = float(np.linalg.norm(r))
    exact = norm <= 1e-9 * scale * np.sqrt(r.size)  # the remaining residuals are rounding errors
    flat = 0.0 if exact else float(np.max(np.abs(scaled.T @ r), initial=0.0)) / norm
    _, values, v = np.linalg.svd(scaled, full_matrices=False)
    rank = int(np.sum(values > _RANK * values.max(initial=0.0)))
    degrees = r.size - theta.size - sum(stretch.past for stretch in parts)
    variance = norm**2 / degrees if degrees > 0 else np.nan
    memory = memory_of(
        [stretch.errors for stretch in parts], 0 if shape.tied else shape.na + shape.nc
    )
    covariance = None
    if rank == theta.size and degrees > 0:
        half = v.T / values / size[:, None]
        covariance = half @ half.T
        if shape.tied and memory[1] < WHITENESS_LEVEL:
            covariance = covariance @ _with_memory(parts, r.size / degrees) @ covariance
        else:
            covariance = variance * covariance
    return SearchEnd(theta, covariance, flat, rank, memory)


def _with_memory(parts: Sequence[Stretch], factor: float) -> np.ndarray:
    """The covariance of the gradient of the squared errors, ``(k, k)``."""
    pairs = [(stretch.residuals, stretch.gradient) for stretch in parts]
    samples = sum(e.size for e, _ in pairs)
    longest = min(samples // 4, max(e.size for e, _ in pairs) - 1)
    # two standard errors of a correlation of white noise (Bartlett)
    limit = 2.0 / np.sqrt(samples)
    power = sum(float(e @ e) for e, _ in pairs) / samples
    total = power * sum(j.T @ j for _, j in pairs)
    quiet, lag = 0, 1
    while quiet < 5 and lag < longest:  # until the correlation stays within its confidence band
        used = [(e, j) for e, j in pairs if e.size > lag]
        r = sum(float(e[lag:] @ e[:-lag]) for e, _ in used) / samples
        cross = sum(j[lag:].T @ j[:-lag] for _, j in used)
        total = total + r * (cross + cross.T)  # pyright: ignore
        quiet = quiet + 1 if abs(r) < limit * power else 0
        lag += 1
    # a sum over lags that is cut off need not be positive definite: negative variances are lifted
    values, vectors = np.linalg.eigh(total)
    floor = 1e-3 * np.abs(values).max()
    return factor * (vectors * np.maximum(values, floor * (values <= 0))) @ vectors.T


_LAGS = 25
WHITENESS_LEVEL = 0.001
"""Probability of taking white residuals for correlated ones."""


def samples_of(records: Sequence[SampledLog]) -> int:
    """Number of measured outputs."""
    return int(sum(np.isfinite(record.y).sum() for record in records))


def bic_of(system: System, records: Sequence[SampledLog], size: int) -> tuple[float, np.ndarray]:
    """The Bayesian information criterion of the one-step errors, and their standard deviations.

    Source: Schwarz 1978, with the Gaussian likelihood of white errors. All models are rated on the
    same samples, each from its best starting states, which count as parameters of each record.
    """
    e = np.concatenate([record.y - system.predict(record.u, record.y) for record in records])
    if np.isinf(e).any():
        return np.inf, np.full(e.shape[1], np.inf)
    e = e[np.isfinite(e).all(axis=1)]
    spread = e.T @ e / len(e)
    # noise-free logs leave rounding only: the logarithm stays finite, and more orders gain nothing
    floor = 1e-26 * np.mean(np.concatenate([r.y[r.complete] for r in records]) ** 2)
    _, logarithm = np.linalg.slogdet(spread + floor * np.eye(len(spread)))
    free = size + len(records) * system.order
    # count all measurements: a model with a longer delay does not predict the first samples
    samples = sum(int(record.complete.sum()) for record in records)
    degrees = max(1.0, samples - free / len(spread))
    criterion = float(samples * logarithm + free * np.log(samples))
    return criterion, np.sqrt(np.diag(spread) * samples / degrees)


def memory_of(residuals: Sequence[np.ndarray], used: int) -> tuple[float, float]:
    """The correlation at one step, and its probability if residuals were white.

    Source: Ljung & Box 1978, pooled over stretches, with ``used`` coefficients taken off.
    """
    from scipy.stats import chi2  # takes a while

    pooled = np.concatenate(residuals)
    power = float(pooled @ pooled)
    # the chi-square law holds for many more samples than lags
    if pooled.size < 4 * _LAGS or not power > 0:
        return np.nan, np.nan
    lags = np.arange(1, _LAGS + 1)
    rho = [sum(float(e[k:] @ e[:-k]) for e in residuals if e.size > k) / power for k in lags]
    statistic = pooled.size * (pooled.size + 2) * np.sum(np.square(rho) / (pooled.size - lags))
    return rho[0], float(chi2.sf(statistic, max(1, _LAGS - used)))


def memory_note(memory: tuple[float, float], allowed_for: bool) -> tuple[str, ...]:
    """A note if residuals are not white."""
    if not memory[1] < WHITENESS_LEVEL:
        return ()
    means = "standard errors hold for white ones only."
    if allowed_for:
        means = "standard errors allow for that if the noise knows nothing of the input."
    return (
        f"The residuals last from sample to sample (correlation {memory[0]:.2f} at one step, "
        f"Ljung-Box p < {WHITENESS_LEVEL}): {means}",
    )
