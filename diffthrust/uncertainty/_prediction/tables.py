"""The reports of derived quantities and predictive bands, as data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from diffthrust._support.report import Report, Rows, Section, notes
from diffthrust._support.words import number, percent
from diffthrust.uncertainty._prediction.band import Band, DerivedQuantity

_POINTS = 12
"""Most points of a curve in a table."""


def interval_text(median: float, low: float, high: float) -> tuple[str, str, str]:
    """Median and ends, all to the second digit of half the interval's width."""
    half = 0.5 * (high - low)
    if not (np.isfinite([median, low, high]).all() and half > 0):
        return number(median), number(low), number(high)
    places = 1 - int(np.floor(np.log10(half)))
    if 0 <= places <= 8 and 1e-4 <= max(abs(low), abs(high)) < 1e6:
        return f"{median:.{places}f}", f"{low:.{places}f}", f"{high:.{places}f}"
    top = int(np.floor(np.log10(max(abs(low), abs(high)))))
    digits = min(max(2, top + places + 1), 12)
    return number(median, digits), number(low, digits), number(high, digits)


def evenly(size: int, most: int) -> np.ndarray:
    """Indices of at most so many points, first and last among them."""
    return np.unique(np.linspace(0, size - 1, min(size, most)).round().astype(int))


def prediction_report(
    channels: Mapping[str, Band], level: float, sentence: str, remarks: Iterable[str]
) -> Report:
    """Coverage by channel, and in words."""
    rows = ((n, percent(band.coverage), str(band.samples)) for n, band in channels.items())
    headings = ("Channel", f"Inside {percent(level)} band", "Samples")
    return Report(Section("", Rows.of(headings, rows, numbers=(1, 2)), sentence, *notes(remarks)))


def quantities_report(
    quantities: Iterable[DerivedQuantity], level: float, remarks: Iterable[str]
) -> Report:
    """Intervals of the numbers, then each curve, at some of its points where it has many."""
    ends = (f"{percent(level)} from", "to")
    quantities = [q.shown for q in quantities]
    numbers = [
        (q.name, *interval_text(float(q.median), float(q.low), float(q.high)), q.unit)
        for q in quantities
        if q.grid is None
    ]
    headings = ("Quantity", "Median", *ends, "Unit")
    curves = (_curve_rows(q, q.grid, ends) for q in quantities if q.grid is not None)
    return Report(
        Section("", Rows.of(headings, numbers, numbers=(1, 2, 3))),
        *(Section("", rows) for rows in curves),
        Section("", *notes(remarks)),
    )


def _curve_rows(q: DerivedQuantity, grid: np.ndarray, ends: tuple[str, str]) -> Rows:
    unit = f" [{q.grid_unit}]" if q.grid_unit else ""
    headings = (f"{q.grid_name}{unit}", f"{q.name}{f' [{q.unit}]' if q.unit else ''}", *ends)
    rows = (
        (
            f"{float(grid[at]):.6g}",
            *interval_text(float(q.median[at]), float(q.low[at]), float(q.high[at])),
        )
        for at in evenly(grid.size, _POINTS)
    )
    return Rows.of(headings, rows, numbers=range(4))
