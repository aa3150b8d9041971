"""Detect sensors that are read more slowly than the log is written, and held in between."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

_LEAST = 12
"""Fewest intervals between changes from which a hold can be judged."""
_REGULAR = 0.95
"""Share of the intervals that must be multiples of the hold; a few samples may be lost."""
_COUNTED = 0.9
"""If a larger share of the changes has one size, the sensor is a coarse counter, not a held one."""
_REPEATED = 0.4
"""Share of the samples that a held sensor must repeat. A hold of two samples, the shortest, repeats
every second one; 0.4 leaves room for lost samples."""
_APART = 0.6
"""Share of the changes that must come after two samples of one value or more: a sensor that stands
still and then moves changes from sample to sample while it moves. Positions of a satellite receiver
of 5 Hz in the log of 9 Hz of the Otter: 0.66."""
_VALUES = 0.5
"""No value may be held in a larger share of the holds: it is where the sensor rests or ends."""
_STEPS = 3.0
"""Changes after a hold must exceed this many steps of the sensor's resolution in the median: a
coarse sensor under a slow signal stays at one value as well, and then changes by one step."""
_FOLLOWS = 1.05
"""A channel whose values, ordered by those of an input, go to and fro by no more than this multiple
of their range is a function of that input."""
_LONGEST = 2.0
"""Times the 90th percentile of the waits: after a longer one, readings that equal the previous one
have come meanwhile. Of waits that are purely random one in a hundred is longer."""


class Hold(NamedTuple):
    """Which samples of a held sensor are readings, ``(n,)``, and how many lie between two of them.

    ``regular`` readings come at equal intervals; from one to the next are ``every`` samples in the
    mean, and ``shortest`` to ``longest`` (5th to 95th percentile).
    """

    regular: bool
    every: float
    shortest: int
    longest: int
    read: np.ndarray

    @property
    def readings(self) -> int:
        """How many samples are readings."""
        return int(np.count_nonzero(self.read))

    def seconds(self, time: np.ndarray) -> str:
        """After how long a reading follows another, in words: ``"0.8 to 2.7 s"``."""
        from diffthrust._support.words import number

        step = float(np.median(np.diff(time)))
        if self.regular:
            return f"{number(self.every * step, 3)} s"
        return f"{number(self.shortest * step, 2)} to {number(self.longest * step, 2)} s"


def held_note(channel: str, hold: Hold, time: np.ndarray) -> str:
    """A note: when a held channel is read, and how many samples count."""
    rhythm = (
        f"is read at every {hold.every:.3g} samples and held in between"
        if hold.regular
        else f"is read at irregular times, {hold.seconds(time)} apart, and repeats its last reading"
    )
    return (
        f"{channel} {rhythm}: only the {hold.readings} readings count, their repeats, of "
        f"{hold.read.size} samples, are taken as not measured."
    )


def held_readings(values: np.ndarray, inputs: Collection[np.ndarray] = ()) -> Hold | None:
    """Find the hold of a sensor and which samples are readings.

    A held sensor keeps exactly one value and then changes, for example at every fifth sample, or
    whenever a reading arrives. Readings at equal intervals show by these; a sensor at rest, or a
    coarse one, changes at irregular intervals, and a counter always by the same amount. The
    sensor's clock need not be that of the log: holds of two and three samples in turn are a hold
    of two and a half. Readings at irregular times show by changes that stand alone and are larger
    than the sensor's resolution. What only repeats the steps of an input is not held.

    A reading equal to the previous one, as at rest, still counts where it must have come; the
    value held when the log begins does not, because its age is unknown.

    ``values`` are those of a measured channel, ``(n,)``, NaN where nothing was measured, ``inputs``
    those of the log, ``(n,)`` each. None if the sensor is not held.
    """
    steps = np.diff(values)
    if np.count_nonzero(steps == 0) < _REPEATED * np.count_nonzero(np.isfinite(steps)):
        return None
    new = np.flatnonzero(np.isfinite(steps) & (steps != 0)) + 1
    # Intervals across missing samples are left out: a change in between would go unnoticed.
    blind = np.cumsum(np.isnan(values))
    unbroken = blind[new[1:]] == blind[new[:-1]]
    waits = np.diff(new)[unbroken]
    if waits.size < _LEAST:
        return None
    if any(_follows(series, values, new) for series in inputs):
        return None
    sizes = np.abs(steps[new - 1])
    every = _regular(waits, sizes, float(np.nanmax(np.abs(values))))
    if every is not None:
        due = _due(new, every, 0.5 * every, values.size)
    elif _irregular(values, new, waits, unbroken):
        longest = _LONGEST * float(np.quantile(waits, 0.9))
        due = _due(new, longest, longest, values.size)
        due[: new[0]] = False
    else:
        return None
    shortest, longest = map(int, np.quantile(waits, (0.05, 0.95), method="nearest"))
    typical = float(np.mean(waits)) if every is None else every
    return Hold(every is not None, typical, shortest, longest, due & np.isfinite(values))


def _regular(waits: np.ndarray, sizes: np.ndarray, largest: float) -> float | None:
    """The mean number of samples of a regular hold; ``None`` if readings are not regular."""
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
    if np.mean(np.abs(sizes - np.median(sizes)) <= 1e-6 * largest) > _COUNTED:
        return None
    return every


def _follows(drive: np.ndarray, values: np.ndarray, new: np.ndarray) -> bool:
    """Whether a channel holds its values because an input does, perhaps after a short delay.

    ``new`` are the places of its changes, ``(k,)``.
    """
    begin, middle = new[:-1], (new[:-1] + new[1:]) // 2
    if np.mean(drive[begin] == drive[middle]) < 0.5:
        return False
    ordered = values[begin][np.argsort(drive[middle], kind="stable")]
    return bool(np.sum(np.abs(np.diff(ordered))) <= _FOLLOWS * np.ptp(ordered))


def _irregular(
    values: np.ndarray, new: np.ndarray, waits: np.ndarray, unbroken: np.ndarray
) -> bool:
    """Whether changes at irregular intervals, at the places ``new``, are readings of a held sensor.

    ``waits`` are the samples from one to the next, where ``unbroken`` by missing samples.
    """
    holds = waits >= 2
    if np.mean(holds) < _APART:
        return False
    before, after = values[new[:-1]][unbroken][holds], values[new[1:]][unbroken][holds]
    if np.unique(before, return_counts=True)[1].max() > _VALUES * before.size:
        return False
    levels = np.unique(values[np.isfinite(values)])
    gaps = np.diff(levels)
    resolution = gaps[gaps > 1e-9 * np.ptp(levels)].min()
    return bool(np.median(np.abs(after - before)) >= _STEPS * resolution)


def _due(new: np.ndarray, every: float, spare: float, size: int) -> np.ndarray:
    """Mark the readings: each new value, and one at every hold until ``spare`` before the next."""
    due = np.zeros(size, bool)
    # Before the first change the value is a reading of unknown age: readings are due counting back
    # from that change.
    first = new[0] - np.round(np.arange(every, new[0] + 0.5, every)).astype(int)
    due[first] = True
    for begin, end in zip(new, np.append(new[1:], size), strict=True):
        due[begin] = True
        due[begin + np.round(np.arange(every, end - begin - spare, every)).astype(int)] = True
    return due
