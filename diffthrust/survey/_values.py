"""Evidence in the numbers of columns: sampling, possible units, and how they move together."""

from __future__ import annotations

import math

import numpy as np

from diffthrust.logs._tables.table import Field
from diffthrust.logs._written import PWM

_PWM = (800.0, 2200.0)
"""Range of pulse widths that motor controllers read, with a margin [us]."""
_CLOCKS = (("ns", 2e6, 1e17), ("us", 2e3, 1e14), ("ms", 2.0, 1e11), ("s", 0.0, 1e9))
"""Least median step in each unit (that of a log is below two seconds), and least stamp if it counts
from 1970: seconds in any log exceed 1e9 (September 2001), which a short clock does not reach."""
_POINTS, _LAGS, _SHARE = 2000, 20, 0.05
"""Points of the common grid, number of lags tried, and largest lag as a share of the log."""


def numbers_of(values: np.ndarray) -> np.ndarray:
    """The numbers among the samples."""
    return values[np.isfinite(values)]


def varies(values: np.ndarray) -> bool:
    """Whether there are at least two different numbers."""
    numbers = numbers_of(values)
    return numbers.size > 1 and bool(np.ptp(numbers) > 0)


def increases(values: np.ndarray) -> bool:
    """Whether samples increase, but for few exceptions, and few are missing."""
    numbers = numbers_of(values)
    if numbers.size < 2 or numbers.size < 0.9 * values.size:
        return False
    return bool(numbers[-1] > numbers[0] and np.mean(np.diff(numbers) >= 0) > 0.9)


def counts(values: np.ndarray) -> bool:
    """Whether the samples are row numbers: 0, 1, 2, ... or 1, 2, 3, ..."""
    numbers = numbers_of(values)
    return numbers.size > 2 and numbers[0] in (0.0, 1.0) and bool(np.all(np.diff(numbers) == 1.0))


def _widths(values: np.ndarray) -> np.ndarray:
    """The numbers but for 0, which means no pulse."""
    numbers = numbers_of(values)
    return numbers[numbers != 0]


def is_pwm(values: np.ndarray) -> bool:
    """Whether the numbers can be pulse widths [us]."""
    widths = _widths(values)
    if not widths.size:
        return False
    low, high = float(widths.min()), float(widths.max())
    # A shaft speed in rpm may have the same size, but does not stay around 1500.
    return _PWM[0] <= low and high <= _PWM[1] and low <= 1600 and high >= 1400


def pulses(values: np.ndarray) -> PWM:
    """The width at rest and the range of a drive; by default 1500 and 400.

    Most logs begin at rest: a first width near 1500 that a twentieth of the samples has is taken.
    """
    widths = _widths(values)
    first = float(widths[0])
    rests = abs(first - 1500) <= 40 and np.mean(np.abs(widths - first) < 1) >= 0.05
    # Captured pulses jitter by a microsecond or two.
    stop = float(round(first)) if rests and abs(round(first) - 1500) >= 3 else 1500.0
    span = float(max(widths.max() - 1500, 1500 - widths.min(), 0.0))
    # The usual ranges, 1100 to 1900 and 1000 to 2000, with the same jitter.
    reach = 400.0 if span <= 410 else 500.0 if span <= 510 else 100 * math.ceil(span / 100)
    return PWM(stop, 1500 + reach, None if stop == 1500 else 1500 - reach)


def pulses_ahead(values: np.ndarray) -> PWM:
    """The widths of a one-way drive: 1000 to 2000, or 1100 to 1900."""
    widths = _widths(values)
    narrow = 1090 <= widths.min() <= 1110 and widths.max() <= 1910
    return PWM(1100.0, 1900.0) if narrow else PWM(1000.0, 2000.0)


def time_unit(values: np.ndarray) -> tuple[str, str, bool]:
    """The unit of time stamps from their numbers: unit, reason, and whether it is in doubt."""
    numbers = numbers_of(values)
    first, steps = abs(float(numbers[0])), np.diff(numbers)
    step = float(np.median(steps)) or float(np.mean(steps))  # a clock may be coarser than the rows
    for unit, _, epoch in _CLOCKS:
        if first > epoch:
            return unit, "its stamps count from 1970", False
    unit = next((unit for unit, least, _ in _CLOCKS if step >= least), "s")
    # Steps of 0.2 ms to 0.5 s in one of the units; in between (2 s or 2 ms?) the unit is a guess.
    sure = 2e-4 <= step <= 0.5 or 5 <= step <= 500 or 5e3 <= step <= 5e5
    return unit, f"its step is {step:.4g}", not sure


def one_sided(values: np.ndarray) -> bool:
    """Whether the numbers are positive, except for noise about zero."""
    numbers = numbers_of(values)
    return bool(numbers.size and numbers.max() > 0 and numbers.min() >= -0.02 * numbers.max())


def hardly_negative(values: np.ndarray) -> bool:
    """Whether the numbers are positive at the 5 % quantile, whatever the noise."""
    numbers = numbers_of(values)
    low, high = np.quantile(numbers, [0.05, 0.95]) if numbers.size else (0.0, 0.0)
    return bool(high > 0 and low >= -0.05 * high)


def two_sided(values: np.ndarray) -> bool:
    """Whether the numbers extend well to both sides of zero."""
    numbers = numbers_of(values)
    return bool(numbers.size and min(numbers.max(), -numbers.min()) > 0.1 * np.abs(numbers).max())


def sampling(time: np.ndarray) -> tuple[float, float]:
    """Sample rate [Hz] and largest step [s]; NaN with fewer than two samples."""
    steps = np.diff(numbers_of(time))
    steps = steps[steps > 0]
    return (1 / float(np.median(steps)), float(steps.max())) if steps.size else (math.nan, math.nan)


def correlated(first: Field, second: Field, *, zero: float = 0.0, sizes: bool = False) -> float:
    """The largest correlation of a driving column, counted from ``zero``, and one that follows it.

    The second may lag by up to a twentieth of the log; with ``sizes`` absolute values are compared.
    """
    a, b = _common(first, second)
    a = a - zero
    return _strongest(np.abs(a), np.abs(b)) if sizes else _strongest(a, b)


def difference(first: Field, second: Field, third: Field) -> float:
    """The correlation of the first minus the second with the third, which may lag."""
    a, b, c = _common(first, second, third)
    return _strongest(a - b, c)


def _strongest(first: np.ndarray, second: np.ndarray) -> float:
    """The correlation of largest magnitude of two series, ``(n,)`` each, the second lagging."""
    # A response lags its command by its time constant; a twentieth of a log covers it, and more
    # lags would find chance correlations in slow signals.
    reach = int(_SHARE * first.size)
    best = 0.0
    for lag in sorted({int(reach * k / _LAGS) for k in range(_LAGS + 1)}):
        a, b = first[: first.size - lag], second[lag:]
        good = np.isfinite(a) & np.isfinite(b)
        if good.sum() >= 3 and np.ptp(a[good]) and np.ptp(b[good]):
            best = max(best, float(np.corrcoef(a[good], b[good])[0, 1]), key=abs)
    return best


def _common(*fields: Field) -> tuple[np.ndarray, ...]:
    """Fields on a common grid of some thousand points at most."""
    clocks = [field.time for field in fields if field.time is not None]
    if len(clocks) < len(fields):
        size = min(field.values.size for field in fields)
        keep = slice(None, size, max(1, size // _POINTS))
        return tuple(field.values[keep] for field in fields)
    start, stop = max(clock[0] for clock in clocks), min(clock[-1] for clock in clocks)
    if stop <= start:
        return tuple(np.zeros(0) for _ in fields)
    grid = np.linspace(start, stop, _POINTS)
    return tuple(np.interp(grid, clock, f.values) for clock, f in zip(clocks, fields, strict=True))


def turning(heading: Field, clock: np.ndarray, turn: float, rate: Field) -> tuple[float, float]:
    """Compare the change of a heading, whose full turn is ``turn``, with a yaw rate of any unit.

    ``clock`` are stamps of the heading [s], ``(n,)``. Returns their correlation, and the ratio of
    the heading's change [rad/s] to the rate.
    """
    times = rate.time if rate.time is not None else clock
    good = np.isfinite(heading.values) & np.isfinite(clock)
    valid = np.isfinite(rate.values) & np.isfinite(times)
    if min(good.sum(), valid.sum()) < 20:
        return 0.0, np.nan
    # Compare steps of the heading with the integral of the rate over the same time: the derivative
    # of a heading is mostly noise.
    times, rates = times[valid], rate.values[valid]
    path = np.append(0.0, np.cumsum(np.diff(times) * 0.5 * (rates[1:] + rates[:-1])))
    angle = np.unwrap(heading.values[good], period=turn) * (2 * np.pi / turn)
    grid = np.linspace(clock[good][0], clock[good][-1], 200)
    steps, turns = (
        np.diff(np.interp(grid, t, x)) for t, x in ((times, path), (clock[good], angle))
    )
    if not np.ptp(steps) or not np.ptp(turns):
        return 0.0, np.nan
    return float(np.corrcoef(steps, turns)[0, 1]), float(steps @ turns / (steps @ steps))
