"""Samples that cannot be: what a logger writes for a missing value, and gross outliers."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from diffthrust._support.words import number
from diffthrust.logs._log import Log
from diffthrust.logs._rails import stretches
from diffthrust.soundness._doubt import Doubt, moment
from diffthrust.soundness._repeats import as_written, width_shown

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
    for channel, samples in {**log.inputs, **log.measured}.items():
        where = np.flatnonzero(np.isfinite(samples))
        values = samples[where]
        if values.size < 20 or not np.ptp(values) > 0:
            continue
        span = float(np.ptp(np.quantile(values, (0.02, 0.98))))
        if not np.abs(np.diff(values)).max() > _FAR * span:  # most channels: nothing jumps
            continue
        yield from _jumps(log, channel, where, values, channel in log.measured)


def _jumps(
    log: Log, channel: str, where: np.ndarray, values: np.ndarray, measured: bool
) -> Iterator[Doubt]:
    if measured and (block := _block(log, channel, values)) is not None:
        yield _sentinel(log, channel, where, block)
        return
    if measured and (away := _dropout(log, where, values)) is not None:
        yield Doubt(
            channel,
            "sentinel",
            f"{log.name}: {channel} drops to exactly 0 for {int(away.sum())} samples and comes "
            f"back, from {moment(log, _first(log, where, away))} on, by jumps and while the drive "
            "is far from its stop: the sensor was away.",
            f"leave these samples of {channel} empty (nan), or cut the log there; other zeros "
            "may be true.",
        )
        return
    height = _heights(values)
    span = float(np.ptp(np.quantile(values[height == 0], (0.02, 0.98)))) if any(height == 0) else 0
    turn = {"rad": 2 * np.pi, "deg": 360.0}.get(log.units[channel], np.inf)
    if channel in ("heading", "wind_direction"):
        height = np.where(np.abs(height - turn) < 0.2 * turn, 0.0, height)
    usual = 5 * float(np.quantile(np.abs(np.diff(values)), 0.7))
    high = height > max(_FAR * span, usual)
    levels, counts = np.unique(values[high], return_counts=True)
    for value, count in zip(levels, counts, strict=True):
        beyond = height[high & (values == value)].min() > 2 * max(span, 1e-12)
        coded = _is_code(_coded(log, channel, float(value))) and beyond
        # zeros and other repeated numbers: sensors do not jump there and back, commands may
        repeated = count >= 3 and measured
        if not (coded or repeated):
            continue
        if not coded and np.mean(values[high] == value) < 0.5:
            continue  # outliers that were clipped, some of them alike
        yield _sentinel(log, channel, where, high & (values == value))
        return
    height = _heights(values, 1)
    gross = high & (height > _GROSS * span)
    gross[gross] = [_alone(values, height, int(k)) for k in np.flatnonzero(gross)]
    if measured and gross.sum() >= 3 and gross.sum() < 0.1 * values.size and span > 0:
        yield Doubt(
            channel,
            "outliers",
            f"{log.name}: {int(gross.sum())} samples of {channel} stand alone, "
            f"{width_shown(log, channel, float(height[gross].max()))} and less from their "
            f"neighbours, where all others lie within {width_shown(log, channel, span)}; the first "
            f"at {moment(log, _first(log, where, gross))}.",
            'leave them empty (nan), or fit with loss = "student_t", which forgives them.',
        )


def _block(log: Log, channel: str, values: np.ndarray) -> np.ndarray | None:
    """Where a code lasts for some samples, entered and left by jumps; ``None`` if none does."""
    lasting = values[1:][values[1:] == values[:-1]]
    for value in np.unique(lasting):
        coded = values == value
        is_code = _is_code(_coded(log, channel, float(value)), 90)
        if not is_code or not 3 <= coded.sum() < 0.5 * values.size:
            continue
        remaining = values[~coded]
        edges = np.abs(np.diff(values))[coded[1:] != coded[:-1]]
        if np.median(edges) > _FAR * np.ptp(np.quantile(remaining, (0.02, 0.98))):
            return coded
    return None


def _dropout(log: Log, where: np.ndarray, values: np.ndarray) -> np.ndarray | None:
    """Where a channel is 0 for a while, entered and left by jumps, while the drive goes on."""
    far = _FAR * float(np.quantile(np.abs(values), 0.95))
    away = np.zeros(values.size, bool)
    for begin, end in zip(*stretches(values == 0), strict=True):
        if end - begin <= _ALONE or begin == 0 or end == values.size:
            continue
        if min(abs(values[begin - 1]), abs(values[end])) > far:
            away[begin:end] = _driven(log, int(where[begin]), int(where[end - 1]) + 1)
    return away if 0 < away.sum() < 0.5 * values.size else None


def _driven(log: Log, begin: int, end: int) -> bool:
    """Whether an input is far from its stop around both ends of a stretch, and mostly between."""
    for drive in (log.inputs[name] for name in _DRIVES if name in log.inputs):
        on = np.abs(drive) > _DRIVEN * np.nanquantile(np.abs(drive), 0.98)
        ends = (on[max(0, k - _NEAR) : k + _NEAR] for k in (begin, end))
        if all(flags.all() for flags in ends) and on[begin:end].mean() > 0.7:
            return True
    return False


def _sentinel(log: Log, channel: str, where: np.ndarray, coded: np.ndarray) -> Doubt:
    """The doubt on samples that are the code of a missing value."""
    written = _coded(log, channel, float({**log.inputs, **log.measured}[channel][where[coded][0]]))
    times = "once" if coded.sum() == 1 else f"in {int(coded.sum())} samples"
    return Doubt(
        channel,
        "sentinel",
        f"{log.name}: {channel} jumps {times} to exactly {number(written)} and back, the first "
        f"time at {moment(log, _first(log, where, coded))}: that is how a logger writes a missing "
        "value.",
        f'[logs] missing_values = ["{written:g}"], or read_log(..., '
        f'missing_values=["{written:g}"]).',
    )


def _heights(values: np.ndarray, longest: int = _ALONE) -> np.ndarray:
    """How far each sample of a short excursion lies from where it began and ended, else 0."""
    height = np.zeros(values.size)
    for width in range(1, longest + 1):
        if values.size < width + 2:
            break
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


def _coded(log: Log, channel: str, value: float) -> float:
    """A stored number as it stands in the column."""
    way = log.written.get(channel)
    return as_written(log, channel, value) / (way.scale if way is not None else 1.0)


def _is_code(written: float, least: float = 0.0) -> bool:
    return any(abs(written - c) < 1e-6 * abs(c) for c in _CODES if abs(c) >= least)


def _first(log: Log, where: np.ndarray, chosen: np.ndarray) -> float:
    return float(log.time[where[np.flatnonzero(chosen)[0]]])
