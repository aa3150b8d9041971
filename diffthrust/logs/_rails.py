"""Detect samples at the ends of a sensor's range, where it reports only "at least" or "at most"."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from diffthrust._support.envelope import stretches
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
"""With this many separate stretches at its extreme, a sensor is not merely standing still."""
_STRETCH = 3
"""Fewest samples in a row that count as a stretch."""
_REST = 0.02
"""An extreme below this share of the largest value is the sensor at rest, not a rail."""
_GAP = 0.15
"""Largest gap between a rail and the next value, as a share of the range; a logger's mark for a
missing value, such as -999, lies further away."""
_NOISY = 1.5
"""Noise above this multiple of the resolution cannot repeat one value by chance."""
_ALTERNATING = 0.6
"""In white noise 77 % of the third differences change sign from one to the next; in a signal that
is sampled fast enough hardly any do."""
_BROAD = 0.03
"""Steps above this share of the range are too coarse to tell a rail from a sensor that rests on
its last step. A signal that settles at its extreme takes long over the last such share."""
_SETTLED = 0.3
"""An approach that takes this share of the time spent at the extreme is slow."""
_DRIVEN = 0.3
"""An input has moved if it covers this share of its range (10th to 90th percentile)."""
_MOVED = 0.07
"""Another sensor has moved if it covers this share of its range ..."""
_CLEAR = 8.0
"""... and this multiple of its noise."""


class Railed(NamedTuple):
    """The ends of a sensor's range, infinite where there is none, and the samples that stand there.

    ``side`` is -1 at the lower end, 1 at the upper one, 0 between them, ``(n,)``.
    """

    low: float
    high: float
    side: np.ndarray

    @property
    def samples(self) -> int:
        """How many samples stand at either end."""
        return int(np.count_nonzero(self.side))


def _railed_between(values: np.ndarray, low: float, high: float) -> Railed | None:
    """Samples at given rails; ``None`` if there are none."""
    # Given rails pass through conversions of units, and the samples as well: 300 rpm in rad/s may
    # differ in the last bit.
    slack = 1e-9 * np.array([abs(low), abs(high)])
    slack = np.where(np.isfinite(slack), slack, 0.0)
    side = np.zeros(values.size, np.int8)
    side[values >= high - slack[1]] = 1
    side[values <= low + slack[0]] = -1
    return Railed(low, high, side) if side.any() else None


def railed_note(
    channel: str, at: Railed, display: ShownUnits, unit: str, censored: bool = False
) -> str:
    """A note: how many samples of a channel are at its rails, and how they are used."""
    from diffthrust._support.words import number

    counts = []
    for side, end in ((-1, at.low), (1, at.high)):
        if count := int(np.count_nonzero(at.side == side)):
            value = number(float(display.values(channel, end, unit)))
            counts.append(f"{count} at {value} {display.unit(channel, unit)}".rstrip())
    return (
        f"measured {channel!r}: {' and '.join(counts)} of {at.side.size} samples are saturated; "
        f"they {'are in no error' if censored else 'are ignored'}."
    )


# Numbers in a wrong unit may overflow; the check of units reports them.
@np.errstate(over="ignore", invalid="ignore")
def railed(
    values: np.ndarray,
    rails: tuple[float, float] | None,
    inputs: Collection[np.ndarray],
    measured: Collection[np.ndarray],
) -> Railed | None:
    """Samples of a sensor at its rails, given or detected; ``None`` if there are none.

    A rail is an extreme value that is repeated far more often than a signal would repeat it. A
    sensor whose noise is wider than its resolution does not repeat any value like that: the extreme
    is the tail of the noise and rarer than the values next to it. A sensor without such noise
    repeats every value at which it settles; there a rail shows by a fast approach, and by other
    sensors that keep moving meanwhile. (If these stand still too, the system is at its limit, not
    the sensor.) Inputs are considered only if there are no other sensors.

    ``values`` are NaN where nothing was measured, or a reading is held; ``measured`` are the other
    sensors; all ``(n,)``.
    """
    if rails is not None:
        return _railed_between(values, *rails)
    finite = np.isfinite(values)
    valid = values[finite]
    if valid.size < 3 * _LEAST or not np.ptp(valid) > 0:
        return None
    drives, sensors = ([v[finite] for v in series] for series in (inputs, measured))
    high = valid.max() if _is_rail(valid, drives, sensors) else np.inf
    low = valid.min() if _is_rail(-valid, drives, sensors) else -np.inf
    if np.isinf(low) and np.isinf(high):
        return None
    same = _SAME * np.ptp(valid)
    at_rails = _railed_between(values, float(low) + same, float(high) - same)
    return at_rails and at_rails._replace(low=float(low), high=float(high))


def _is_rail(
    values: np.ndarray, drives: Collection[np.ndarray], sensors: Collection[np.ndarray]
) -> bool:
    """Whether the largest value is a rail."""
    extreme = values.max()
    at = values >= extreme - _SAME * np.ptp(values)
    count, remaining = int(at.sum()), values[~at]
    if count < _FEWEST or remaining.size < _LEAST or abs(extreme) <= _REST * np.abs(values).max():
        return False
    # A rail cuts a distribution off, so that values just inside it occur as well; a mark stands
    # alone.
    if not extreme - remaining.max() <= _GAP * np.ptp(remaining):
        return False
    begins, ends = stretches(at).T
    lengths = ends - begins
    # Many visits suffice for a noisy sensor. One long stand needs the other channels as witnesses:
    # a vessel at its top speed stands at an extreme, too.
    if begins.size >= _VISITS and _repeats_too_often(values, at):
        return True
    stands = count >= _LEAST and (
        _repeats_too_often(values, at) or _is_clipped(values, begins, lengths)
    )
    return stands and _companions_moved(at, drives, sensors)


def _repeats_too_often(values: np.ndarray, at: np.ndarray) -> bool:
    """Whether the extreme is repeated more often than the noise elsewhere allows."""
    apart = np.convolve(at, np.ones(4, int))[3 : at.size] == 0  # four samples off the extreme
    # Third differences remove any slow signal (up to a parabola) and leave the noise.
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
    """Standard deviation of the noise of a series, from its third differences.

    0.6745 turns a median of absolute values into a standard deviation; white noise of variance 1
    has third differences of variance 1 + 9 + 9 + 1 = 20.
    """
    return float(np.median(np.abs(bends))) / 0.6745 / np.sqrt(20.0)


def _resolution(values: np.ndarray) -> float:
    """The smallest step between two readings."""
    steps = np.diff(np.unique(values))
    return float(steps[steps > _SAME * np.ptp(values)].min(initial=np.ptp(values)))


def _is_clipped(values: np.ndarray, begins: np.ndarray, lengths: np.ndarray) -> bool:
    """Whether stretches at the extreme are long and reached fast: a clipped signal."""
    at, long = lengths.sum(), lengths[lengths >= _STRETCH].sum()
    if long < max(_LEAST, _SHARE * values.size, 0.6 * at):
        return False
    broad = _BROAD * np.ptp(values)
    if _resolution(values) > broad:
        return False
    # How long the signal took from the last value well below the extreme to each stretch: a
    # settling system creeps up, a clipped signal runs into the rail.
    far = np.flatnonzero(values < values.max() - broad)
    previous = np.searchsorted(far, begins) - 1
    ways = begins - np.where(previous >= 0, far[previous], -1) - 1
    return bool(np.minimum(ways, lengths)[lengths >= _STRETCH].sum() <= _SETTLED * long)


def _companions_moved(
    at: np.ndarray, drives: Collection[np.ndarray], sensors: Collection[np.ndarray]
) -> bool:
    """Whether other channels moved while this channel stood at its extreme."""
    moving = [v for v in sensors if np.isfinite(v).any() and np.nanmax(v) > np.nanmin(v)]
    if moving:
        return any(_moved_beyond_noise(v, at, _MOVED, _CLEAR) for v in moving)
    return any(_moved_beyond_noise(v, at, _DRIVEN) for v in drives)


def _moved_beyond_noise(
    values: np.ndarray, during: np.ndarray, share: float, clear: float = 0.0
) -> bool:
    """Whether a channel moved by a share of its range and clearly beyond its noise."""
    finite = values[np.isfinite(values)]
    here = values[during & np.isfinite(values)]
    if here.size < _STRETCH:
        return False
    width = float(np.ptp(np.quantile(here, (0.1, 0.9))))
    least = share * float(np.ptp(np.quantile(finite, (0.02, 0.98))))
    # Only changes: repeats of a held sensor would make its noise look like zero.
    read = finite[np.flatnonzero(np.diff(finite, prepend=np.nan))]
    return width > max(least, clear * _noise(np.diff(read, 3))) > 0
