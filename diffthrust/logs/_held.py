"""Sensors that are read more slowly than a log is written, and held in between."""

from __future__ import annotations

import numpy as np

_LEAST = 12
"""So many waits from one change to the next tell whether they are regular."""
_REGULAR = 0.95
"""Share of the waits that must be whole holds; a few samples may be lost."""
_COUNTED = 0.9
"""Where so large a share of the changes is of one size, a coarse sensor counts on."""


def held_readings(values: np.ndarray) -> tuple[float, np.ndarray] | None:
    """Every how many samples a sensor is read, and which samples are readings.

    A held sensor keeps exactly one value and then changes: at every second sample, or at every
    fifth. One that rests, or is coarse, changes anywhere, and one that counts always by as much.
    Its clock need not be that of the log: holds of two and three samples in turn are one of two
    and a half. A reading that repeats the one before it, as at rest, is a reading still; what is
    held when the log begins is none, for its age is not known.

    Args:
        values: a measured channel, ``(n,)``; NaN where nothing was measured.

    Returns:
        Samples from one reading to the next on average, and for each sample whether it is a
        reading, ``(n,)``; ``None`` where the sensor is not held.
    """
    steps = np.diff(values)
    if np.count_nonzero(steps == 0) < 0.4 * np.count_nonzero(np.isfinite(steps)):
        return None
    new = np.flatnonzero(np.isfinite(steps) & (steps != 0)) + 1
    blind = np.cumsum(np.isnan(values))
    waits = np.diff(new)[blind[new[1:]] == blind[new[:-1]]]
    if waits.size < _LEAST:
        return None
    usual = int(np.bincount(waits).argmax())
    if usual < 2:
        return None
    near = (np.abs(waits - usual) <= 1) & (waits > 1)
    every = float(np.mean(waits[near]))
    holds = np.maximum(np.round(waits / every), 1.0)
    if np.mean(np.abs(waits - holds * every) < 1.0) < _REGULAR:
        return None
    sizes = np.abs(steps[new - 1])
    if np.mean(np.abs(sizes - np.median(sizes)) <= 1e-6 * np.nanmax(np.abs(values))) > _COUNTED:
        return None
    return every, _due(new, every, values.size) & np.isfinite(values)


def _due(new: np.ndarray, every: float, size: int) -> np.ndarray:
    """Where readings are due: at each new value, and in between as often as the sensor is read."""
    due = np.zeros(size, bool)
    first = new[0] - np.round(np.arange(every, new[0] + 0.5, every)).astype(int)
    due[first] = True
    for begin, end in zip(new, np.append(new[1:], size), strict=True):
        due[begin] = True
        due[begin + np.round(np.arange(every, end - begin - 0.5 * every, every)).astype(int)] = True
    return due
