"""Correlation of columns, whatever their time stamps and units."""

from __future__ import annotations

import numpy as np

from diffthrust.logs._contents import Field

_POINTS, _LAGS, _SHARE = 2000, 20, 0.05
"""Points of the common grid, number of lags tried, and largest lag as a share of the log."""


def correlated(first: Field, second: Field, *, zero: float = 0.0, sizes: bool = False) -> float:
    """The correlation of two columns, allowing the second to lag.

    Args:
        first: the driving column.
        second: the following column, which may lag by up to a twentieth of the log.
        zero: zero of the first column.
        sizes: use absolute values.

    Returns:
        The correlation of largest magnitude; 0 if there is nothing to correlate.
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
    """Compare the change of a heading with a yaw rate.

    Args:
        heading: the angle.
        clock: stamps of the heading [s], ``(n,)``.
        turn: a full turn in its unit.
        rate: the yaw rate, in any unit.

    Returns:
        Their correlation, and the ratio of the heading's change [rad/s] to the rate.
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
