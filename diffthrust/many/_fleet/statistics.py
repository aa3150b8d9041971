"""Statistics of a fleet's estimates: weighted means, spread beyond errors, lines, and tests."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from diffthrust.many._fleet.entries import Axis, Entry


class Mean(NamedTuple):
    """A weighted mean: its standard error, and Cochran's Q with its degrees of freedom."""

    value: float
    error: float
    q: float
    dof: int


def weighted_mean(values: np.ndarray, errors: np.ndarray) -> Mean:
    """The mean of values, ``(n,)``, weighted by 1 / error^2 (Cochran 1954)."""
    weight = 1.0 / errors**2
    mean = float(np.sum(weight * values) / np.sum(weight))
    q = float(np.sum(weight * (values - mean) ** 2))
    return Mean(mean, float(1.0 / np.sqrt(np.sum(weight))), q, len(values) - 1)


def dispersed(mean: Mean) -> float:
    """Factor by which scatter exceeds the errors, at least one (the Birge ratio, 1932)."""
    return math.sqrt(max(1.0, mean.q / mean.dof)) if mean.dof else 1.0


def between(values: np.ndarray, errors: np.ndarray) -> float:
    """Standard deviation beyond the errors; zero if they explain the scatter.

    The value at which Q with the weights 1 / (error^2 + sd^2) equals its degrees of freedom (Paule
    & Mandel 1982).
    """
    from scipy.optimize import brentq  # slow to import

    if len(values) < 2:
        return 0.0

    def excess(variance: float) -> float:
        mean = weighted_mean(values, np.sqrt(errors**2 + variance))
        return mean.q - mean.dof

    if excess(0.0) <= 0:
        return 0.0
    # At n / (n - 1) of the range squared, Q is below its degrees of freedom.
    high = 2.0 * float(np.ptp(values)) ** 2
    root: Any = brentq(excess, 0.0, high, xtol=1e-14 * high)
    return math.sqrt(root)


def holm(p_values: np.ndarray, level: float) -> np.ndarray:
    """Tests that reject, with the family-wise error rate at most ``level``.

    Source: Holm 1979. NaN never rejects and does not count as a test.
    """
    p = np.asarray(p_values, float)
    order = np.argsort(p, kind="stable")  # NaN comes last
    count = np.sum(~np.isnan(p))
    limits = level / np.maximum(count - np.arange(p.size), 1)
    rejects = np.zeros(p.shape, bool)
    rejects[order] = np.logical_and.accumulate(p[order] <= limits)
    return rejects


@dataclass(frozen=True, eq=False, repr=False)
class Estimates:
    """The estimates of a fleet, one entry for each fit."""

    entries: tuple[Entry, ...] = field(repr=False)
    axes: Mapping[str, Axis] = field(repr=False)
    times: np.ndarray = field(repr=False)
    time_unit: str

    @property
    def vehicles(self) -> tuple[str, ...]:
        """Names of the vehicles, in order of appearance."""
        return tuple(dict.fromkeys(entry.vehicle for entry in self.entries))

    def series(self, vehicle: str, parameter: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times, coordinates and their standard errors of one parameter over a vehicle's fits."""
        axis, points = self.axes[parameter], []
        for entry, time in zip(self.entries, self.times, strict=True):
            value, error = entry.estimates.get(parameter, (np.nan, None))
            if entry.vehicle != vehicle or not entry.usable or error is None:
                continue
            at = float(axis.coordinate(value))
            # A negative estimate of a positive quantity has no logarithm.
            if np.isfinite(at):
                points.append((time, at, error / float(axis.slope(value))))
        times, values, errors = np.array(points, float).reshape(-1, 3).T
        return times, values, errors


class VehicleMeans(NamedTuple):
    """Mean and error of a parameter for each vehicle, in its coordinate."""

    vehicles: tuple[str, ...]
    values: np.ndarray
    errors: np.ndarray


def vehicle_means(fleet: Estimates, parameter: str) -> VehicleMeans:
    """Each vehicle's mean over its fits; its error grows if they scatter beyond their errors."""
    means = []
    for vehicle in fleet.vehicles:
        _, values, errors = fleet.series(vehicle, parameter)
        if values.size:
            mean = weighted_mean(values, errors)
            # Without the factor a hundred short tests would claim a precision that their own
            # scatter refutes.
            means.append((vehicle, mean.value, mean.error * dispersed(mean)))
    names, values, errors = zip(*means, strict=True) if means else ((), (), ())
    return VehicleMeans(tuple(names), np.array(values, float), np.array(errors, float))


class Trend(NamedTuple):
    """A weighted straight line: value at the mean time, slope, its error, and the p-value."""

    fits: int
    middle: float
    level: float
    slope: float
    error: float
    dispersion: float
    p_value: float


def trend(times: np.ndarray, values: np.ndarray, errors: np.ndarray) -> Trend | None:
    """A weighted straight line through estimates; ``None`` with fewer than two times.

    If the scatter about the line exceeds the errors, the slope's error grows accordingly, and the
    test uses Student's t instead of a Gaussian.
    """
    from scipy.stats import norm
    from scipy.stats import t as student

    if values.size < 2 or np.ptp(times) == 0:
        return None
    middle = weighted_mean(times, errors).value
    away = times - middle
    (slope, level), covariance = np.polyfit(away, values, 1, w=1.0 / errors, cov="unscaled")
    residuals, dof = (values - level - slope * away) / errors, values.size - 2
    dispersion = math.sqrt(max(1.0, float(residuals @ residuals) / dof)) if dof else 1.0
    error = dispersion * math.sqrt(covariance[0, 0])
    # Errors that were enlarged by the observed scatter are estimates with dof degrees of freedom.
    law: Any = student(dof) if dispersion > 1.0 else norm
    p_value = 2.0 * float(law.sf(abs(slope) / error))
    return Trend(values.size, middle, level, slope, error, dispersion, p_value)
