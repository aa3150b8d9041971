"""Statistics of a fleet's estimates: spread between vehicles, drift within them, outliers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from diffthrust.many._fleet.entries import Axis, Entry

if TYPE_CHECKING:
    import pandas as pd

_MAD = 1.4826
"""Standard deviations in a median absolute deviation of a Gaussian."""


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


def spread_table(fleet: Estimates) -> pd.DataFrame:
    """See `Fleet.spread`."""
    import pandas as pd
    from scipy.stats import chi2

    rows = []
    for name, axis in fleet.axes.items():
        means = vehicle_means(fleet, name)
        if len(means.vehicles) < 2:
            continue
        mean = weighted_mean(means.values, means.errors)
        values = axis.value(means.values)
        median = float(np.median(values))
        robust = _MAD * float(np.median(np.abs(values - median)))
        sd = between(means.values, means.errors) * float(axis.slope(np.asarray(median)))
        share = max(0.0, 1.0 - mean.dof / mean.q) if mean.q > 0 else 0.0
        test = (mean.q, mean.dof, float(chi2.sf(mean.q, mean.dof)))
        rows.append((name, axis.unit, len(means.vehicles), median, robust, sd, share, *test))
    columns = ["parameter", "unit", "vehicles", "median", "robust_sd", "between_sd", "share"]
    return pd.DataFrame(rows, columns=[*columns, "q", "dof", "p_value"])


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


def drift_table(fleet: Estimates, false_alarms: float) -> pd.DataFrame:
    """See `Fleet.drift`."""
    import pandas as pd

    rows = []
    for vehicle in fleet.vehicles:
        for name, axis in fleet.axes.items():
            line = trend(*fleet.series(vehicle, name))
            if line is None:
                continue
            level = axis.value(line.level)
            per = float(axis.slope(level))
            slope, unit = line.slope * per, f"{axis.unit or '1'} per {fleet.time_unit}"
            size = (line.fits, slope, line.error * per, slope / abs(float(level)))
            rows.append((vehicle, name, unit, *size, line.dispersion, line.p_value))
    columns = ["vehicle", "parameter", "unit", "fits", "slope", "slope_std_error", "relative"]
    table = pd.DataFrame(rows, columns=[*columns, "dispersion", "p_value"])
    table["drifts"] = holm(table["p_value"].to_numpy(float), false_alarms)
    return table


def effects_table(fleet: Estimates) -> pd.DataFrame:
    """See `Fleet.effects`."""
    import pandas as pd

    names = list(dict.fromkeys(e for entry in fleet.entries for e in entry.effects))
    rows = {}
    for vehicle in fleet.vehicles:
        fits = [entry for entry in fleet.entries if entry.vehicle == vehicle]
        shares = (sum(e in entry.effects for entry in fits) / len(fits) for e in names)
        rows[vehicle] = [len(fits), *shares]
    table = pd.DataFrame.from_dict(rows, orient="index", columns=["fits", *names])
    return table.rename_axis("vehicle")


def outlier_table(fleet: Estimates, false_alarms: float) -> pd.DataFrame:
    """See `Fleet.outliers`."""
    import pandas as pd
    from scipy.stats import t as student

    rows = []
    for name, axis in fleet.axes.items():
        means = vehicle_means(fleet, name)
        for i, vehicle in enumerate(means.vehicles):
            # Student's t of the test has two degrees of freedom fewer than vehicles: with three
            # vehicles, one, whose tails let nothing be significant.
            if len(means.vehicles) < 4:
                break
            values, errors = np.delete(means.values, i), np.delete(means.errors, i)
            sd = between(values, errors)
            peers = weighted_mean(values, np.hypot(errors, sd))
            away = float(np.sqrt(means.errors[i] ** 2 + sd**2 + peers.error**2))
            distance = float((means.values[i] - peers.value) / away)
            values_at = [float(axis.value(x)) for x in (means.values[i], peers.value)]
            p_value = 2.0 * float(student.sf(abs(distance), peers.dof))
            rows.append((vehicle, name, axis.unit, *values_at, distance, p_value))
    columns = ["vehicle", "parameter", "unit", "value", "others", "distance", "p_value"]
    table = pd.DataFrame(rows, columns=columns)
    table["outlier"] = holm(table["p_value"].to_numpy(float), false_alarms)
    return table.sort_values("p_value", ignore_index=True)
