"""Estimates of each vehicle's parameters from its fits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np

from diffthrust.many._fleet.axis import Axis
from diffthrust.many._fleet.entries import Entry
from diffthrust.many._fleet.statistics import dispersed, weighted_mean


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
