"""Detect sensors that are read more slowly than the log is written, and held in between."""

from __future__ import annotations

import numpy as np

_LEAST = 12
"""Fewest intervals between changes from which regularity can be judged."""
_REGULAR = 0.95
"""Share of the intervals that must be multiples of the hold; a few samples may be lost."""
_COUNTED = 0.9
"""If a larger share of the changes has one size, the sensor is a coarse counter, not a held one."""


def held_readings(values: np.ndarray) -> tuple[float, np.ndarray] | None:
    """Find the hold of a sensor and which samples are readings.

    A held sensor keeps exactly one value and then changes, for example at every fifth sample. A
    sensor at rest, or a coarse one, changes at irregular intervals, and a counter always by the
    same amount. The sensor's clock need not be that of the log: holds of two and three samples in
    turn are a hold of two and a half. A reading equal to the previous reading, as at rest, still
    counts; the value held when the log begins does not, because its age is unknown.

    Args:
        values: a measured channel, ``(n,)``; NaN where nothing was measured.

    Returns:
        Mean number of samples from one reading to the next, and for each sample whether it is a
        reading, ``(n,)``; ``None`` if the sensor is not held.
    """
    steps = np.diff(values)
    # A hold of two samples, the shortest, repeats every second one; 0.4 leaves room for lost
    # samples.
    if np.count_nonzero(steps == 0) < 0.4 * np.count_nonzero(np.isfinite(steps)):
        return None
    new = np.flatnonzero(np.isfinite(steps) & (steps != 0)) + 1
    # Intervals across missing samples are left out: a change in between would go unnoticed.
    blind = np.cumsum(np.isnan(values))
    waits = np.diff(new)[blind[new[1:]] == blind[new[:-1]]]
    if waits.size < _LEAST:
        return None
    usual = int(np.bincount(waits).argmax())
    if usual < 2:
        return None
    # The mean of the waits about the most frequent one gives a hold that is no whole number of
    # samples: 2, 3, 2, 3 is one reading in 2.5.
    near = (np.abs(waits - usual) <= 1) & (waits > 1)
    every = float(np.mean(waits[near]))
    holds = np.maximum(np.round(waits / every), 1.0)
    if np.mean(np.abs(waits - holds * every) < 1.0) < _REGULAR:
        return None
    # A counter or a coarse encoder under constant speed changes as regularly as a held sensor does,
    # but always by one step of its resolution.
    sizes = np.abs(steps[new - 1])
    if np.mean(np.abs(sizes - np.median(sizes)) <= 1e-6 * np.nanmax(np.abs(values))) > _COUNTED:
        return None
    return every, _due(new, every, values.size) & np.isfinite(values)


def _due(new: np.ndarray, every: float, size: int) -> np.ndarray:
    """Mark the readings: each new value, and in between one at every hold (repeated readings)."""
    due = np.zeros(size, bool)
    # Before the first change the value is a reading of unknown age: readings are due counting back
    # from that change.
    first = new[0] - np.round(np.arange(every, new[0] + 0.5, every)).astype(int)
    due[first] = True
    for begin, end in zip(new, np.append(new[1:], size), strict=True):
        due[begin] = True
        due[begin + np.round(np.arange(every, end - begin - 0.5 * every, every)).astype(int)] = True
    return due
