"""A first-order motor whose speed is read now and then, and a least squares of its readings.

d(speed)/dt = (gain * command - speed) / time_constant, solved exactly between samples, over which
the command is constant.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares


class Readings(NamedTuple):
    """A log of the motor.

    Args:
        time: [s], ``(n,)``.
        command: ``(n,)``.
        speed: the last reading, ``(n,)``.
        read: places of the readings, ``(k,)``; before the first one the log repeats an older one.
    """

    time: np.ndarray
    command: np.ndarray
    speed: np.ndarray
    read: np.ndarray


def simulate(
    time: np.ndarray, command: np.ndarray, gain: float, time_constant: float, start: float
) -> np.ndarray:
    """The speed at each sample, ``(n,)``."""
    kept = np.exp(-np.diff(time) / time_constant)
    speed = np.empty(time.size)
    speed[0] = start
    for k, (share, drive) in enumerate(zip(kept, gain * command[:-1], strict=True)):
        speed[k + 1] = drive + (speed[k] - drive) * share
    return speed


def drawn(
    seed: int,
    gain: float = 1.05,
    time_constant: float = 0.5,
    noise: float = 0.5,
    step: float = 0.05,
    duration: float = 200.0,
) -> Readings:
    """A log under steps of 5 s, read every 0.8 to 2.7 s at random."""
    rng = np.random.default_rng([36, seed])
    time = step * np.arange(round(duration / step))
    command = rng.uniform(-80.0, 80.0, int(duration // 5) + 1)[(time // 5).astype(int)]
    speed = simulate(time, command, gain, time_constant, rng.uniform(-10.0, 10.0))
    arrivals = np.cumsum(rng.uniform(0.8, 2.7, int(duration)))
    read = np.searchsorted(time, arrivals[arrivals < time[-1]])
    readings = speed + noise * rng.standard_normal(time.size)
    places = np.append(0, read)
    last = np.searchsorted(places, np.arange(time.size), side="right") - 1
    return Readings(time, command, readings[places[last]], read)


def fitted(log: Readings, guess: tuple[float, float] = (1.0, 0.4)) -> np.ndarray:
    """Gain, time constant and initial speed by least squares of the readings alone, ``(3,)``."""

    def errors(x: np.ndarray) -> np.ndarray:
        return simulate(log.time, log.command, *x)[log.read] - log.speed[log.read]

    start = (*guess, log.speed[0])
    return least_squares(errors, start, x_scale="jac", xtol=1e-12, ftol=1e-12, gtol=1e-12).x
