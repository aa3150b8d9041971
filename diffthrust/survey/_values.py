"""Evidence in the numbers of columns: sampling, possible units, and how they move together."""

from __future__ import annotations

import math

import numpy as np

from diffthrust.logs._contents import Field
from diffthrust.logs._written import PWM

_PWM = (800.0, 2200.0)
"""Range of pulse widths that motor controllers read, with a margin [us]."""
_STEPS = (("ns", 2e6), ("us", 2e3), ("ms", 2.0), ("s", 0.0))
"""Least median step in each unit; the median step of a log is below two seconds."""
_EPOCHS = (("ns", 1e17), ("us", 1e14), ("ms", 1e11), ("s", 1e8))
"""Least time stamps in each unit if they count from 1970."""


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
    steps = np.diff(numbers)
    return numbers.size > 2 and numbers[0] in (0.0, 1.0) and bool(np.all(steps == 1.0))


def is_pwm(values: np.ndarray) -> bool:
    """Whether the numbers can be pulse widths [us]; 0 means no pulse."""
    numbers = numbers_of(values)
    pulses = numbers[numbers != 0]
    if not pulses.size:
        return False
    low, high = float(pulses.min()), float(pulses.max())
    # A shaft speed in rpm may have the same size, but does not stay around 1500.
    return _PWM[0] <= low and high <= _PWM[1] and low <= 1600 and high >= 1400


def pulses(values: np.ndarray) -> PWM:
    """The width at rest and the range of a drive; by default 1500 and 400.

    Most logs begin at rest: a first width near 1500 that a twentieth of the samples has is taken.
    """
    numbers = numbers_of(values)
    numbers = numbers[numbers != 0]
    first = float(numbers[0])
    rests = abs(first - 1500) <= 40 and np.mean(np.abs(numbers - first) < 1) >= 0.05
    stop = round(first) if rests else 1500.0
    # Captured pulses jitter by a microsecond or two.
    stop = 1500.0 if abs(stop - 1500) < 3 else stop
    span = float(max(numbers.max() - 1500, 1500 - numbers.min(), 0.0))
    # The usual ranges, 1100 to 1900 and 1000 to 2000, with the same jitter.
    reach = 400.0 if span <= 410 else 500.0 if span <= 510 else 100 * math.ceil(span / 100)
    return PWM(stop, 1500 + reach, None if stop == 1500 else 1500 - reach)


def pulses_ahead(values: np.ndarray) -> PWM:
    """The widths of a one-way drive: 1000 to 2000, or 1100 to 1900."""
    numbers = numbers_of(values)
    low, high = float(numbers[numbers != 0].min()), float(numbers.max())
    return PWM(1100.0, 1900.0) if 1090 <= low <= 1110 and high <= 1910 else PWM(1000.0, 2000.0)


def time_unit(values: np.ndarray) -> tuple[str, str, bool]:
    """The unit of time stamps from their numbers: unit, reason, and whether it is in doubt."""
    numbers = numbers_of(values)
    first, steps = abs(float(numbers[0])), np.diff(numbers)
    step = float(np.median(steps)) or float(np.mean(steps))  # a clock may be coarser than the rows
    for unit, least in _EPOCHS:
        # 1e9 s is September 2001: seconds since 1970 in any log exceed it, and a short clock does
        # not reach it.
        if first > least and (unit != "s" or first > 1e9):
            return unit, "its stamps count from 1970", False
    for unit, least in _STEPS:
        if step >= least:
            # Steps of 0.2 ms to 0.5 s in one of the units; in between (2 s or 2 ms?) the unit is a
            # guess.
            sure = 2e-4 <= step <= 0.5 or 5 <= step <= 500 or 5e3 <= step <= 5e5
            return unit, f"its step is {step:.4g}", not sure
    return "s", f"its step is {step:.4g}", True


def angle_unit(values: np.ndarray, turn: float) -> tuple[str, bool]:
    """``"deg"`` if the numbers exceed the range in radians (``turn``), and whether in doubt."""
    numbers = numbers_of(values)
    largest = float(np.abs(numbers).max()) if numbers.size else 0.0
    return ("deg", False) if largest > 1.05 * turn else ("rad", True)


def one_sided(values: np.ndarray) -> bool:
    """Whether the numbers are positive, except for noise about zero."""
    numbers = numbers_of(values)
    return bool(numbers.size and numbers.max() > 0 and numbers.min() >= -0.02 * numbers.max())


def hardly_negative(values: np.ndarray) -> bool:
    """Whether the numbers are positive at the 5 % quantile, whatever the noise."""
    numbers = numbers_of(values)
    if not numbers.size:
        return False
    low, high = np.quantile(numbers, [0.05, 0.95])
    return bool(high > 0 and low >= -0.05 * high)


def two_sided(values: np.ndarray) -> bool:
    """Whether the numbers extend well to both sides of zero."""
    numbers = numbers_of(values)
    return bool(numbers.size and min(numbers.max(), -numbers.min()) > 0.1 * np.abs(numbers).max())


def sampling(time: np.ndarray) -> tuple[float, float]:
    """Sample rate [Hz] and largest step [s]; NaN with fewer than two samples."""
    steps = np.diff(numbers_of(time))
    steps = steps[steps > 0]
    if not steps.size:
        return math.nan, math.nan
    return 1 / float(np.median(steps)), float(steps.max())


_POINTS, _LAGS, _SHARE = 2000, 20, 0.05
"""Points of the common grid, number of lags tried, and largest lag as a share of the log."""


def correlated(first: Field, second: Field, *, zero: float = 0.0, sizes: bool = False) -> float:
    """The largest correlation of a driving column, counted from ``zero``, and one that follows it.

    The second may lag by up to a twentieth of the log; with ``sizes`` absolute values are compared.
    """
    a, b = _common(first, second)
    a = a - zero
    if sizes:
        a, b = np.abs(a), np.abs(b)
    return strongest(a, b)


def strongest(first: np.ndarray, second: np.ndarray) -> float:
    """The correlation of largest magnitude of two series, ``(n,)`` each, the second lagging."""
    # A response lags its command by its time constant; a twentieth of a log covers it, and more
    # lags would find chance correlations in slow signals.
    reach = int(_SHARE * first.size)
    best = 0.0
    for lag in sorted({int(reach * k / _LAGS) for k in range(_LAGS + 1)}):
        a, b = first[: first.size - lag], second[lag:]
        good = np.isfinite(a) & np.isfinite(b)
        if good.sum() < 3 or not np.ptp(a[good]) or not np.ptp(b[good]):
            continue
        correlation = float(np.corrcoef(a[good], b[good])[0, 1])
        best = correlation if abs(correlation) > abs(best) else best
    return best


def _common(*fields: Field) -> tuple[np.ndarray, ...]:
    """Fields on a common grid of some thousand points at most."""
    if any(field.time is None for field in fields):
        size = min(field.values.size for field in fields)
        keep = slice(None, size, max(1, size // _POINTS))
        return tuple(field.values[:size][keep] for field in fields)
    clocks = [field.time for field in fields if field.time is not None]
    start, stop = max(clock[0] for clock in clocks), min(clock[-1] for clock in clocks)
    if stop <= start:
        return tuple(np.zeros(0) for _ in fields)
    grid = np.linspace(start, stop, _POINTS)
    return tuple(np.interp(grid, clock, f.values) for clock, f in zip(clocks, fields, strict=True))


def difference(first: Field, second: Field, third: Field) -> float:
    """The correlation of the first minus the second with the third, which may lag."""
    a, b, c = _common(first, second, third)
    return strongest(a - b, c)


def turning(heading: Field, clock: np.ndarray, turn: float, rate: Field) -> tuple[float, float]:
    """Compare the change of a heading, whose full turn is ``turn``, with a yaw rate of any unit.

    ``clock`` are stamps of the heading [s], ``(n,)``. Returns their correlation, and the ratio of
    the heading's change [rad/s] to the rate.
    """
    angle = np.full(heading.values.size, np.nan)
    good = np.isfinite(heading.values) & np.isfinite(clock)
    angle[good] = np.unwrap(heading.values[good], period=turn) * (2 * np.pi / turn)
    if good.sum() < 20:
        return 0.0, np.nan
    rate_clock = rate.time if rate.time is not None else clock
    grid = np.linspace(clock[good][0], clock[good][-1], 200)
    valid = np.isfinite(rate.values) & np.isfinite(rate_clock)
    if valid.sum() < 20:
        return 0.0, np.nan
    # Compare steps of the heading with the integral of the rate over the same time: the derivative
    # of a heading is mostly noise.
    path = np.concatenate(
        ([0.0], np.cumsum(np.diff(rate_clock[valid]) * _middles(rate.values[valid])))
    )
    steps = np.diff(np.interp(grid, rate_clock[valid], path))
    turns = np.diff(np.interp(grid, clock[good], angle[good]))
    if not np.ptp(steps) or not np.ptp(turns):
        return 0.0, np.nan
    return float(np.corrcoef(steps, turns)[0, 1]), float(steps @ turns / (steps @ steps))


def _middles(values: np.ndarray) -> np.ndarray:
    return 0.5 * (values[1:] + values[:-1])
