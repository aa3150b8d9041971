"""Derived quantities and predictive bands as tables for people."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.text import Text

from diffthrust._support.tables import number, plain_table
from diffthrust._support.words import percent
from diffthrust.uncertainty._prediction.band import Band
from diffthrust.uncertainty._prediction.derived_quantity import DerivedQuantity

_POINTS = 12
"""A table shows at most so many points of a curve."""


def interval_text(median: float, low: float, high: float) -> tuple[str, str, str]:
    """Median and ends, all to the second digit of half the interval's width.

    Example:
        >>> interval_text(0.0370107, 0.036952, 0.037068)
        ('0.037011', '0.036952', '0.037068')
    """
    half = 0.5 * (high - low)
    if not (np.isfinite([median, low, high]).all() and half > 0):
        return number(median), number(low), number(high)
    places = 1 - int(np.floor(np.log10(half)))
    if 0 <= places <= 8 and 1e-4 <= max(abs(low), abs(high)) < 1e6:
        return f"{median:.{places}f}", f"{low:.{places}f}", f"{high:.{places}f}"
    top = int(np.floor(np.log10(max(abs(low), abs(high)))))
    digits = min(max(2, top + places + 1), 12)
    return number(median, digits), number(low, digits), number(high, digits)


def prediction_table(
    channels: Mapping[str, Band], level: float, sentence: str, notes: Iterable[str]
) -> RenderableType:
    """Coverage by channel, and in words."""
    table = plain_table("Channel", f"Inside {percent(level)} band", "Samples", numbers=(1, 2))
    for name, band in channels.items():
        table.add_row(escape(name), percent(band.coverage), str(band.samples))
    return Group(table, Text(sentence), *(Text(f"Note: {note}") for note in notes))


def quantities_table(
    quantities: Sequence[DerivedQuantity], level: float, notes: Iterable[str]
) -> RenderableType:
    """Intervals of the numbers, then each curve, at some of its points where it has many."""
    share = percent(level)
    parts: list[RenderableType] = []
    quantities = [q.shown for q in quantities]
    numbers = [q for q in quantities if q.grid is None]
    if numbers:
        table = plain_table("Quantity", "Median", f"{share} from", "to", "Unit", numbers=(1, 2, 3))
        for q in numbers:
            row = interval_text(float(q.median), float(q.low), float(q.high))
            table.add_row(escape(q.name), *row, escape(q.unit))
        parts += [table, Text()]
    for q in quantities:
        if q.grid is None:
            continue
        unit = f" [{q.grid_unit}]" if q.grid_unit else ""
        head = f"{q.name}{f' [{q.unit}]' if q.unit else ''}"
        headings = f"{q.grid_name}{unit}", head, f"{share} from", "to"
        table = plain_table(*headings, numbers=(0, 1, 2, 3))
        for at in _some(q):
            row = interval_text(float(q.median[at]), float(q.low[at]), float(q.high[at]))
            table.add_row(f"{float(q.grid[at]):.6g}", *row)
        parts += [table, Text()]
    return Group(*parts, *(Text(f"Note: {note}") for note in notes))


def _some(quantity: DerivedQuantity) -> Iterable[int]:
    assert quantity.grid is not None
    size = quantity.grid.size
    return np.unique(np.linspace(0, size - 1, min(size, _POINTS)).round().astype(int)).tolist()
