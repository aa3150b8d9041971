"""Waves along a position: how many there are, read off the one-step errors.

A ripple of so many per turn, of the teeth of a gear or the poles of a motor, has more waves over a
log than a curve has pieces. The periodogram of the one-step errors over the position, which need
not be sampled evenly (Schuster 1898), tells how long they are and where they begin.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from diffthrust.diagnosis._innovations_fit import TrialFit

_FEWEST = 4.0
"""Fewer waves over the range of a position are in reach of a curve."""
_MOST = 1000
"""More wave numbers are not looked at."""
_FINER = 41
"""Wave numbers that are looked at about the best."""
_ABOVE = 10.0
"""A wave is tried where its power is this far above what white errors reach anywhere."""


class Wave(NamedTuple):
    """A wave along a position x, ``sin(number * x + phase)``, and how far its number may be off."""

    number: float
    phase: float
    off: float

    @property
    def length(self) -> float:
        """From one wave to the next, in the unit of x."""
        return 2.0 * math.pi / self.number


def wave_along(trial: TrialFit, name: str) -> Wave | None:
    """The wave along a state that one-step errors show most, if any stands out.

    Args:
        trial: the model, fitted in the innovations form.
        name: the state.
    """
    ran = trial.passed
    sigma = np.asarray(trial.quadratic.sigma)[:, None]
    along = [log.path[name][:-1] for log in ran]
    errors = [np.nan_to_num(log.errors[:, 1:] / sigma) for log in ran]
    numbers = _numbers(along)
    if not numbers.size:
        return None
    power, angle = _periodogram(along, errors, numbers)
    if power.max() < np.log(power.size) + _ABOVE:
        return None
    peak = numbers[int(np.argmax(power.max(axis=0)))]
    beside = 0.5 * np.pi / max(float(np.ptp(np.concatenate(along))), 1e-300)
    near = np.linspace(peak - beside, peak + beside, _FINER)
    power, angle = _periodogram(along, errors, near)
    at = np.unravel_index(int(np.argmax(power)), power.shape)
    return Wave(float(near[at[1]]), float(angle[at] + 0.5 * np.pi), beside)


def _periodogram(
    along: Sequence[np.ndarray], errors: Sequence[np.ndarray], numbers: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Power and angle of errors over a position, by channel and wave number ``(C, K)``.

    Of white errors the power at a wave number is exponentially distributed, of mean one.
    """
    sums = np.zeros((len(errors[0]), numbers.size), complex)
    level = np.zeros((len(errors[0]), 1))
    for x, residual in zip(along, errors, strict=True):
        sums += residual @ np.exp(-1j * np.outer(x, numbers))
        level += np.sum(residual**2, axis=1, keepdims=True)
    return np.abs(sums) ** 2 / np.maximum(level, 1e-300), np.angle(sums)


def _numbers(along: Sequence[np.ndarray]) -> np.ndarray:
    """Wave numbers: from a few waves over the range to two samples a wave, half a wave apart."""
    pooled = np.concatenate(along)
    span = float(np.ptp(pooled))
    steps = np.abs(np.concatenate([np.diff(x) for x in along]))
    moved = steps[steps > 0]
    if not span > 0 or not moved.size:
        return np.empty(0)
    apart = np.pi / span
    highest = min(np.pi / float(np.median(moved)), _MOST * apart)
    return np.arange(2.0 * np.pi * _FEWEST / span, highest, apart)
