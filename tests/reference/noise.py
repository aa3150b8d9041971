"""Sensor and process noise, every draw from a given NumPy generator."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .records import Record

Array = np.ndarray


def white(rng: np.random.Generator, count: int, std: float) -> Array:
    """Independent normal errors."""
    return std * rng.standard_normal(count)


def ar1(rng: np.random.Generator, count: int, std: float, correlation: float) -> Array:
    """First-order autoregressive errors, stationary from the first sample.

    ``correlation`` is that of neighbouring samples; ``std`` that of the series.
    """
    draw = rng.standard_normal(count)
    out = np.empty(count)
    spread = np.sqrt(1.0 - correlation**2)
    last = draw[0]
    out[0] = last
    for k in range(1, count):
        last = correlation * last + spread * draw[k]
        out[k] = last
    return std * out


def spikes(rng: np.random.Generator, count: int, share: float, size: float) -> Array:
    """Rare errors of either sign, ``share`` of the samples, between half and all of ``size``."""
    hit = rng.random(count) < share
    sign = np.where(rng.random(count) < 0.5, -1.0, 1.0)
    return np.where(hit, sign * rng.uniform(0.5 * size, size, count), 0.0)


def quantise(values: Array, step: float) -> Array:
    """Round to whole steps; a step of zero leaves the values alone."""
    return np.round(values / step) * step if step > 0.0 else values


def dropouts(rng: np.random.Generator, values: Array, share: float) -> Array:
    """Lose ``share`` of the samples: NaN in their place."""
    return np.where(rng.random(len(values)) < share, np.nan, values)


def ornstein_uhlenbeck(
    rng: np.random.Generator, time: Array, std: float, time_constant: float
) -> Array:
    """Process noise, exact on any grid (Gillespie 1996, Phys. Rev. E 54, 2084).

    A turbulent torque when added to the shaft acceleration, gusts when added to a hull.
    """
    keep = np.exp(-np.diff(time) / time_constant)
    draw = rng.standard_normal(len(time))
    out = np.empty(len(time))
    out[0] = draw[0]
    for k in range(len(keep)):
        out[k + 1] = keep[k] * out[k] + np.sqrt(1.0 - keep[k] ** 2) * draw[k + 1]
    return std * out


@dataclass(frozen=True)
class Sensor:
    """How one channel is read: error, its colour, spikes, resolution, lost samples.

    ``std``, ``spike_size`` and ``quantum`` in the channel's SI unit; shares as fractions.
    ``unsigned`` sensors report the absolute value (a pulse counter).
    """

    std: float = 0.0
    correlation: float = 0.0
    spike_share: float = 0.0
    spike_size: float = 0.0
    quantum: float = 0.0
    dropout_share: float = 0.0
    unsigned: bool = False

    def read(self, rng: np.random.Generator, values: Array) -> Array:
        """A noisy reading of ``values``; draws the same numbers whatever the sizes are."""
        count = len(values)
        values = values + ar1(rng, count, self.std, self.correlation)
        values = values + spikes(rng, count, self.spike_share, self.spike_size)
        values = np.abs(values) if self.unsigned else values
        return dropouts(rng, quantise(values, self.quantum), self.dropout_share)


def measure(record: Record, rng: np.random.Generator, **sensors: Sensor) -> Record:
    """The record as these sensors read it; a channel without a sensor is not measured."""
    measured = {name: s.read(rng, record.measured[name]) for name, s in sensors.items()}
    return replace(record, measured=measured)
