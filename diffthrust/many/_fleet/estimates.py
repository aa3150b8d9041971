"""Estimates of each vehicle's parameters from its fits, and statistics of such estimates."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

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

    high = float(np.ptp(values)) ** 2
    if excess(0.0) <= 0:
        return 0.0
    # The range squared nearly always exceeds the variance that is sought; doubling covers the rest.
    while excess(high) > 0:
        high *= 2.0
    root: Any = brentq(excess, 0.0, high, xtol=1e-14 * high)
    return math.sqrt(root)


def holm(p_values: np.ndarray, level: float) -> np.ndarray:
    """Tests that reject, with the family-wise error rate at most ``level``.

    Source: Holm 1979. NaN never rejects and does not count as a test.
    """
    p = np.asarray(p_values, float)
    out = np.zeros(p.shape, bool)
    order = np.argsort(np.where(np.isnan(p), np.inf, p), kind="stable")
    count = int(np.sum(~np.isnan(p)))
    for rank, i in enumerate(order[:count]):
        if p[i] > level / (count - rank):
            break
        out[i] = True
    return out


class Estimates(Protocol):
    """The attributes of a `Fleet` that tables, figures and pooling use."""

    @property
    def entries(self) -> tuple[Entry, ...]: ...
    @property
    def axes(self) -> Mapping[str, Axis]: ...
    @property
    def vehicles(self) -> tuple[str, ...]: ...
    @property
    def time_unit(self) -> str: ...

    def series(self, vehicle: str, parameter: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times, coordinates and their standard errors of one parameter over a vehicle's fits."""
        ...


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
