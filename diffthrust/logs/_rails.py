"""Where the range of a sensor ends: samples that say no more than "at least" or "at most"."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from diffthrust.logs._written import ShownUnits

_SAME = 1e-6
"""Values that differ by less than this share of their range are one reading."""
_FEWEST = 8
"""Samples at a rail that a noisy sensor must show."""
_LEAST = 20
"""Samples at a rail that a sensor without noise must show, in stretches, ..."""
_SHARE = 0.03
"""... and that share of the log."""
_VISITS = 5
"""So many stretches at an extreme are more than a sensor that stands still."""
_STRETCH = 3
"""Fewer samples in a row are no stretch."""
_REST = 0.02
"""An extreme of less than this share of the largest value is the sensor at rest."""
_GAP = 0.15
"""Values come so near to a rail, as a share of their range; what a logger writes for a missing
value stands apart from all others."""
_NOISY = 1.5
"""Noise of so many steps of the resolution cannot rest on one of them."""
_ALTERNATING = 0.6
"""Of white noise 77 of 100 third differences differ in sign from the one before; of a signal that
is sampled fast enough hardly any do."""
_BROAD = 0.03
"""Steps of this share of the range are so broad that a sensor rests on its last one; and so near
to an extreme the way to it is slow where a signal settles there."""
_SETTLED = 0.3
"""A way of this share of the time at the extreme is slow."""
_DRIVEN = 0.3
"""An input has moved if by this share of its range (10th to 90th percentile)."""
_MOVED = 0.07
"""Another sensor has, if by this share of its range ..."""
_CLEAR = 8.0
"""... and so many times its noise."""


class Railed(NamedTuple):
    """The samples of a channel that stand at the ends of its sensor's range.

    Args:
        low: lower end; minus infinity where none is known.
        high: upper end; infinity where none is known.
        side: -1 at the lower end, 1 at the upper end, 0 between them, ``(n,)``.
    """

    low: float
    high: float
    side: np.ndarray

    @property
    def samples(self) -> int:
        """How many samples stand at either end."""
        return int(np.count_nonzero(self.side))


def railed_between(values: np.ndarray, low: float, high: float) -> Railed | None:
    """The samples at rails that are known; ``None`` where there are none."""
    slack = 1e-9 * np.array([abs(low), abs(high)])
    slack = np.where(np.isfinite(slack), slack, 0.0)
    side = np.zeros(values.size, np.int8)
    side[values >= high - slack[1]] = 1
    side[values <= low + slack[0]] = -1
    return Railed(low, high, side) if side.any() else None


def railed_note(
    channel: str, at: Railed, shown: ShownUnits, unit: str, censored: bool = False
) -> str:
    """How many samples of a channel stand at its rails, and what becomes of them."""
    from diffthrust._support.words import number

    told = []
    for side, end in ((-1, at.low), (1, at.high)):
        if count := int(np.count_nonzero(at.side == side)):
            value = number(float(shown.values(channel, end, unit)))
            told.append(f"{count} at {value} {shown.unit(channel, unit)}".rstrip())
    return (
        f"measured {channel!r}: {' and '.join(told)} of {at.side.size} samples stand where the "
        f"sensor's range ends; they {'are in no error' if censored else 'carry no weight'}."
    )


@np.errstate(over="ignore", invalid="ignore")  # numbers of wrong units are told
def railed(
    values: np.ndarray, inputs: Collection[np.ndarray], measured: Collection[np.ndarray]
) -> Railed | None:
    """The samples of a sensor at rails that nobody told of; ``None`` where there are none.

    A rail is an extreme value that is repeated far more often than a signal would. Of a sensor
    whose noise is wider than its resolution no value is repeated so: the extreme is the tail of
    the noise, and seen less often than what lies next to it. A sensor without such noise repeats
    every value at which it settles; there a rail is told by a way to it that is not slow, and by
    other sensors, which move on meanwhile. (Where these stand still too, the system is at its
    limit, and not the sensor.) Only where there are none an input tells it.

    Args:
        values: a measured channel, ``(n,)``; NaN where nothing was measured, or a reading is held.
        inputs: the inputs of the log, ``(n,)`` each.
        measured: its other measured channels, ``(n,)`` each.
    """
    seen = np.isfinite(values)
    here = values[seen]
    if here.size < 3 * _LEAST or not np.ptp(here) > 0:
        return None
    drives, sensors = ([v[seen] for v in series] for series in (inputs, measured))
    high = here.max() if _ends(here, drives, sensors) else np.inf
    low = here.min() if _ends(-here, drives, sensors) else -np.inf
    if np.isinf(low) and np.isinf(high):
        return None
    same = _SAME * np.ptp(here)
    found = railed_between(values, float(low) + same, float(high) - same)
    return found and found._replace(low=float(low), high=float(high))


def _ends(
    values: np.ndarray, drives: Collection[np.ndarray], sensors: Collection[np.ndarray]
) -> bool:
    """Whether the largest value is a rail."""
    extreme = values.max()
    at = values >= extreme - _SAME * np.ptp(values)
    count, rest = int(at.sum()), values[~at]
    if count < _FEWEST or rest.size < _LEAST or abs(extreme) <= _REST * np.abs(values).max():
        return False
    if not extreme - rest.max() <= _GAP * np.ptp(rest):
        return False
    edges = np.flatnonzero(np.diff(np.concatenate([[0], at.astype(np.int8), [0]])))
    begins, lengths = edges[::2], edges[1::2] - edges[::2]
    if begins.size >= _VISITS and _too_often(values, at):
        return True
    stands = count >= _LEAST and (_too_often(values, at) or _cut(values, begins, lengths))
    return stands and _went_on(at, drives, sensors)


def _too_often(values: np.ndarray, at: np.ndarray) -> bool:
    """Whether the noise that is seen elsewhere would not repeat the extreme so often."""
    apart = np.convolve(at, np.ones(4, int))[3 : at.size] == 0  # four samples off the extreme
    bends = np.diff(values, 3)
    both = apart[1:] & apart[:-1]
    if both.sum() < _LEAST:
        return False
    noise, step = _noise(bends[apart]), _resolution(values)
    if np.mean((bends[1:] * bends[:-1] < 0)[both]) < _ALTERNATING or noise <= _NOISY * step:
        return False
    beside = values >= values.max() - max(1.01 * step, 0.3 * noise)
    return bool(2 * at.sum() > np.count_nonzero(beside))


def _noise(bends: np.ndarray) -> float:
    """Standard deviation of the noise of a series, from its third differences."""
    return float(np.median(np.abs(bends))) / 0.6745 / np.sqrt(20.0)


def _resolution(values: np.ndarray) -> float:
    """The least step between two readings."""
    steps = np.diff(np.unique(values))
    return float(steps[steps > _SAME * np.ptp(values)].min(initial=np.ptp(values)))


def _cut(values: np.ndarray, begins: np.ndarray, lengths: np.ndarray) -> bool:
    """Whether stretches at the extreme are long, and the ways to them are not slow."""
    at, long = lengths.sum(), lengths[lengths >= _STRETCH].sum()
    if long < max(_LEAST, _SHARE * values.size, 0.6 * at):
        return False
    broad = _BROAD * np.ptp(values)
    if _resolution(values) > broad:
        return False
    far = np.flatnonzero(values < values.max() - broad)
    before = np.searchsorted(far, begins) - 1
    ways = begins - np.where(before >= 0, far[before], -1) - 1
    return bool(np.minimum(ways, lengths)[lengths >= _STRETCH].sum() <= _SETTLED * long)


def _went_on(
    at: np.ndarray, drives: Collection[np.ndarray], sensors: Collection[np.ndarray]
) -> bool:
    """Whether other channels moved while this one stood at its extreme."""
    moving = [v for v in sensors if np.isfinite(v).any() and np.nanmax(v) > np.nanmin(v)]
    if moving:
        return any(_moved(v, at, _MOVED, _CLEAR) for v in moving)
    return any(_moved(v, at, _DRIVEN) for v in drives)


def _moved(values: np.ndarray, during: np.ndarray, share: float, clear: float = 0.0) -> bool:
    """Whether a channel moved meanwhile by a share of its range, and clearly beyond its noise."""
    whole = values[np.isfinite(values)]
    here = values[during & np.isfinite(values)]
    if here.size < _STRETCH:
        return False
    width = float(np.ptp(np.quantile(here, (0.1, 0.9))))
    least = share * float(np.ptp(np.quantile(whole, (0.02, 0.98))))
    read = whole[np.flatnonzero(np.diff(whole, prepend=np.nan))]  # once, where a sensor is held
    return width > max(least, clear * _noise(np.diff(read, 3))) > 0
