"""Samples that cannot be: what a logger writes for a missing value, and gross outliers."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from diffthrust._support.envelope import stretches
from diffthrust._support.words import number
from diffthrust.logs._log import Log
from diffthrust.soundness._doubt import Doubt, moment
from diffthrust.soundness._record import ANGLES, Series

_CODES = (
    *(-1.0, -9.0, -99.0, -999.0, -9999.0, -99999.0, -32768.0, -2147483648.0),
    *(99.0, 255.0, 999.0, 1023.0, 4095.0, 9999.0, 32767.0, 65535.0, 99999.0, 2147483647.0),
)
"""What loggers and converters write where there is no value."""
_DRIVES = ("command", "speed", "force", "propeller_speed", "left_force", "right_force")
"""Inputs that are 0 at their stop."""
_FAR = 0.25
"""A jump there and back of this share of the range of the others, from which on samples that are
all alike are a code."""
_DRIVEN = 0.4
"""Share of its size from which on a drive is far from its stop, and out of any dead band."""
_GROSS = 1.5
"""The same for single samples that differ; field logs have spikes of up to a third of the range."""
_NEAR = 8
"""Samples on either side that say how calm a channel is."""
_LOUD = 6.0
"""Times the steps around it that an outlier must stand out."""
_ALONE = 3
"""Samples in a row at most."""


def jumping(log: Log) -> Iterator[Doubt]:
    """Doubts on samples to which a channel jumps and from which it jumps back."""
    for channel in {**log.inputs, **log.measured}:
        s = Series.of(log, channel)
        if s.values.size < 20 or not np.ptp(s.values) > 0:
            continue
        if not np.abs(np.diff(s.values)).max() > _FAR * _span(s.values):
            continue  # most channels: nothing jumps
        measured = channel in log.measured  # sensors do not jump there and back, commands may
        if measured and (block := _block(s)) is not None:
            yield _sentinel(s, block)
        elif measured and (away := _dropout(s)) is not None:
            yield _away(s, away)
        else:
            yield from _excursions(s, measured)


def _excursions(s: Series, measured: bool) -> Iterator[Doubt]:
    """A doubt on single samples, or a few in a row, that stand out: a code, or outliers."""
    height = _heights(s.values)
    span = _span(s.values[height == 0]) if any(height == 0) else 0.0
    if s.channel in ANGLES:
        turn = {"rad": 2 * np.pi, "deg": 360.0}.get(s.log.units[s.channel], np.inf)
        height = np.where(np.abs(height - turn) < 0.2 * turn, 0.0, height)
    usual = 5 * float(np.quantile(np.abs(np.diff(s.values)), 0.7))
    high = height > max(_FAR * span, usual)
    levels, counts = np.unique(s.values[high], return_counts=True)
    for value, count in zip(levels, counts, strict=True):
        chosen = high & (s.values == value)
        beyond = height[chosen].min() > 2 * max(span, 1e-12)
        # zeros and other repeated numbers; of outliers that were clipped, some are alike
        repeated = measured and count >= 3 and np.mean(s.values[high] == value) >= 0.5
        if repeated or (beyond and _is_code(s, value)):
            yield _sentinel(s, chosen)
            return
    height = _heights(s.values, 1)
    gross = high & (height > _GROSS * span)
    gross[gross] = [_alone(s.values, height, int(k)) for k in np.flatnonzero(gross)]
    if measured and 3 <= gross.sum() < 0.1 * s.values.size and span > 0:
        evidence = (
            f"{int(gross.sum())} samples of {s.channel} stand alone, "
            f"{s.width_shown(float(height[gross].max()))} and less from their neighbours, where "
            f"all others lie within {s.width_shown(span)}; the first at {_first(s, gross)}."
        )
        mend = 'leave them empty (nan), or fit with loss = "student_t", which forgives them.'
        yield Doubt(s.channel, "outliers", evidence, mend)


def _span(values: np.ndarray) -> float:
    return float(np.ptp(np.quantile(values, (0.02, 0.98))))


def _first(s: Series, chosen: np.ndarray) -> str:
    """When the first of the chosen samples was taken, in words."""
    return moment(s.log, float(s.log.time[s.where[np.argmax(chosen)]]))


def _block(s: Series) -> np.ndarray | None:
    """Where a code lasts for some samples, entered and left by jumps; ``None`` if none does."""
    lasting = s.values[1:][s.values[1:] == s.values[:-1]]
    for value in np.unique(lasting):
        coded = s.values == value
        if not _is_code(s, value, 90) or not 3 <= coded.sum() < 0.5 * s.values.size:
            continue
        edges = np.abs(np.diff(s.values))[coded[1:] != coded[:-1]]
        if np.median(edges) > _FAR * _span(s.values[~coded]):
            return coded
    return None


def _dropout(s: Series) -> np.ndarray | None:
    """Where a channel is 0 for a while, entered and left by jumps, while the drive goes on."""
    values, where = s.values, s.where
    far = _FAR * float(np.quantile(np.abs(values), 0.95))
    away = np.zeros(values.size, bool)
    for begin, end in stretches(values == 0):
        if end - begin <= _ALONE or begin == 0 or end == values.size:
            continue
        if min(abs(values[begin - 1]), abs(values[end])) > far:
            away[begin:end] = _driven(s.log, int(where[begin]), int(where[end - 1]) + 1)
    return away if 0 < away.sum() < 0.5 * values.size else None


def _driven(log: Log, begin: int, end: int) -> bool:
    """Whether an input is far from its stop around both ends of a stretch, and mostly between."""
    for drive in (log.inputs[name] for name in _DRIVES if name in log.inputs):
        on = np.abs(drive) > _DRIVEN * np.nanquantile(np.abs(drive), 0.98)
        ends = (on[max(0, k - _NEAR) : k + _NEAR] for k in (begin, end))
        if all(flags.all() for flags in ends) and on[begin:end].mean() > 0.7:
            return True
    return False


def _away(s: Series, away: np.ndarray) -> Doubt:
    evidence = (
        f"{s.channel} drops to exactly 0 for {int(away.sum())} samples and comes back, from "
        f"{_first(s, away)} on, by jumps and while the drive is far from its stop: the sensor was "
        "away."
    )
    mend = (
        f"leave these samples of {s.channel} empty (nan), or cut the log there; other zeros may be "
        "true."
    )
    return Doubt(s.channel, "sentinel", evidence, mend)


def _sentinel(s: Series, coded: np.ndarray) -> Doubt:
    """The doubt on samples that are the code of a missing value."""
    written = _as_coded(s, s.values[coded][0])
    times = "once" if coded.sum() == 1 else f"in {int(coded.sum())} samples"
    evidence = (
        f"{s.channel} jumps {times} to exactly {number(written)} and back, the first time at "
        f"{_first(s, coded)}: that is how a logger writes a missing value."
    )
    mend = (
        f'[logs] missing_values = ["{written:g}"], or read_log(..., '
        f'missing_values=["{written:g}"]).'
    )
    return Doubt(s.channel, "sentinel", evidence, mend)


def _as_coded(s: Series, value: float) -> float:
    """A stored number as it stands in the column."""
    way = s.log.written.get(s.channel)
    return s.written(float(value)) / (way.scale if way is not None else 1.0)


def _is_code(s: Series, value: float, least: float = 0.0) -> bool:
    written = _as_coded(s, value)
    return any(abs(written - c) < 1e-6 * abs(c) for c in _CODES if abs(c) >= least)


def _heights(values: np.ndarray, longest: int = _ALONE) -> np.ndarray:
    """How far each sample of a short excursion lies from where it began and ended, else 0."""
    height = np.zeros(values.size)
    for width in range(1, min(longest, values.size - 2) + 1):
        previous, following = values[: -width - 1], values[width + 1 :]
        inside = np.stack([values[1 + k : values.size - width + k] for k in range(width)])
        low, high = np.minimum(previous, following), np.maximum(previous, following)
        out = np.maximum((inside - high).min(axis=0), (low - inside).min(axis=0))
        out = np.where(out > 2 * (high - low), out, 0.0)
        for k in range(width):
            neighbours = height[1 + k : values.size - width + k]
            np.maximum(neighbours, out, out=neighbours)
    return height


def _alone(values: np.ndarray, height: np.ndarray, k: int) -> bool:
    """Whether the samples around an outlier are calm: what rings after a blow is no outlier."""
    steps = np.sort(np.abs(np.diff(values[max(0, k - _NEAR) : k + _NEAR + 1])))
    return bool(height[k] > _LOUD * np.quantile(steps[:-2], 0.75))
