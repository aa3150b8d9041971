"""How two columns move together, whatever their stamps and units."""

from __future__ import annotations

import numpy as np

from diffthrust.logs._contents import Field

_POINTS, _LAGS, _SHARE = 2000, 20, 0.05
"""Points of the common grid, lags tried, and the share of the log that they reach across."""


def correlated(first: Field, second: Field, *, zero: float = 0.0, sizes: bool = False) -> float:
    """The correlation of two columns, where the second may follow the first.

    Args:
        first: what may drive the second.
        second: what may follow it, by up to a twentieth of the log.
        zero: what counts as zero of the first.
        sizes: leave the signs out.

    Returns:
        The correlation of largest size; 0 where there is nothing to correlate.
    """
    a, b = _common(first, second)
    a = a - zero
    if sizes:
        a, b = np.abs(a), np.abs(b)
    return strongest(a, b)


def strongest(first: np.ndarray, second: np.ndarray) -> float:
    """The correlation of largest size of two series, ``(n,)`` each, the second lagging."""
    reach = int(_SHARE * first.size)
    best = 0.0
    for lag in sorted({int(reach * k / _LAGS) for k in range(_LAGS + 1)}):
        a, b = first[: first.size - lag], second[lag:]
        good = np.isfinite(a) & np.isfinite(b)
        if good.sum() < 3 or not np.ptp(a[good]) or not np.ptp(b[good]):
            continue
        found = float(np.corrcoef(a[good], b[good])[0, 1])
        best = found if abs(found) > abs(best) else best
    return best


def _common(*fields: Field) -> tuple[np.ndarray, ...]:
    """Both on one grid of at most some thousand points."""
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
    """The correlation of the first less the second with the third, which may follow."""
    a, b, c = _common(first, second, third)
    return strongest(a - b, c)


def turning(heading: Field, clock: np.ndarray, turn: float, rate: Field) -> tuple[float, float]:
    """How the change of a heading agrees with a yaw rate.

    Args:
        heading: the angle.
        clock: stamps of the heading [s], ``(n,)``.
        turn: a whole turn in its unit.
        rate: the yaw rate, in whatever unit.

    Returns:
        Their correlation, and how many times the rate the heading's change is [rad/s].
    """
    angle = np.full(heading.values.size, np.nan)
    good = np.isfinite(heading.values) & np.isfinite(clock)
    angle[good] = np.unwrap(heading.values[good], period=turn) * (2 * np.pi / turn)
    if good.sum() < 20:
        return 0.0, np.nan
    own = rate.time if rate.time is not None else clock
    grid = np.linspace(clock[good][0], clock[good][-1], 200)
    known = np.isfinite(rate.values) & np.isfinite(own)
    if known.sum() < 20:
        return 0.0, np.nan
    # the rate's integral over each step against the heading's step: noise of both is averaged
    path = np.concatenate(([0.0], np.cumsum(np.diff(own[known]) * _middles(rate.values[known]))))
    steps = np.diff(np.interp(grid, own[known], path))
    turns = np.diff(np.interp(grid, clock[good], angle[good]))
    if not np.ptp(steps) or not np.ptp(turns):
        return 0.0, np.nan
    return float(np.corrcoef(steps, turns)[0, 1]), float(steps @ turns / (steps @ steps))


def _middles(values: np.ndarray) -> np.ndarray:
    return 0.5 * (values[1:] + values[:-1])
