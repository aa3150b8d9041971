"""Draws, derived quantities and predictive bands as tables for people."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.text import Text

from diffthrust._support.tables import number, plain_table, rendered, with_error
from diffthrust._support.words import percent

if TYPE_CHECKING:
    from diffthrust.uncertainty._prediction.predict import Prediction
    from diffthrust.uncertainty._prediction.quantities import DerivedQuantity, Quantities
    from diffthrust.uncertainty._sampling.summary import Sampled

__all__ = [
    "HEADINGS",
    "interval_text",
    "parameter_rows",
    "prediction_table",
    "quantities_table",
    "rendered",
    "sample_table",
]

POINTS = 12
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


def prediction_table(prediction: Prediction) -> RenderableType:
    """Coverage by channel, and in words."""
    table = plain_table(
        "Channel", f"Inside {percent(prediction.level)} band", "Samples", numbers=(1, 2)
    )
    for name, band in prediction.channels.items():
        table.add_row(escape(name), percent(band.coverage), str(band.samples))
    notes = (Text(f"Note: {note}") for note in prediction.notes)
    return Group(table, Text(prediction.sentence), *notes)


def quantities_table(found: Quantities) -> RenderableType:
    """Intervals of the numbers, then each curve, at some of its points where it has many."""
    share = percent(found.level)
    parts: list[RenderableType] = []
    numbers = [q for q in found.values() if q.grid is None]
    if numbers:
        table = plain_table("Quantity", "Median", f"{share} from", "to", "Unit", numbers=(1, 2, 3))
        for q in numbers:
            row = interval_text(float(q.median), float(q.low), float(q.high))
            table.add_row(escape(q.name), *row, escape(q.unit))
        parts += [table, Text()]
    for q in found.values():
        if q.grid is None:
            continue
        unit = f" [{q.grid_unit}]" if q.grid_unit else ""
        head = f"{q.name}{f' [{q.unit}]' if q.unit else ''}"
        headings = escape(f"{q.grid_name}{unit}"), escape(head), f"{share} from", "to"
        table = plain_table(*headings, numbers=(0, 1, 2, 3))
        for at in _some(q):
            row = interval_text(float(q.median[at]), float(q.low[at]), float(q.high[at]))
            table.add_row(f"{float(q.grid[at]):.6g}", *row)
        parts += [table, Text()]
    return Group(*parts, *(Text(f"Note: {note}") for note in found.notes))


def _some(quantity: DerivedQuantity) -> Iterable[int]:
    assert quantity.grid is not None
    size = quantity.grid.size
    return np.unique(np.linspace(0, size - 1, min(size, POINTS)).round().astype(int)).tolist()


HEADINGS = ("Parameter", "Median", "95 % from", "to", "Unit", "R-hat", "ESS bulk", "ESS tail")
"""The headings of `parameter_rows`, but for the last column, which is the fit's estimate."""


def parameter_rows(found: Sampled) -> list[tuple[str, ...]]:
    """One row for each parameter, with the fit's estimate at the end."""
    rows = []
    for name, s in found.parameters.items():
        own = found.fit.parameters.get(name) or (found.fit.disturbance or {}).get(name)
        estimate = "-"
        if own is not None:
            value, error = with_error(own.value, own.std_error)
            estimate = value if own.std_error is None else f"{value} ± {error}"
        interval = interval_text(s.median, s.low, s.high)
        mixing = f"{s.rhat:.3f}", f"{s.ess_bulk:.0f}", f"{s.ess_tail:.0f}"
        rows.append((name, *interval, s.unit, *mixing, estimate))
    return rows


def sample_table(found: Sampled) -> RenderableType:
    """Convergence in words, the parameters, and how the predictions of unseen logs came out."""
    told = found.told
    colour = "bold green" if told.status.ok else "bold red"
    parts: list[RenderableType] = [
        Text(str(found.fit.model), style="bold"),
        Text.assemble(("Status: ", "bold"), (told.status.value, colour)),
        Text(told.message),
        Text(),
    ]
    table = plain_table(*HEADINGS, "Fit", numbers=(1, 2, 3, 5, 6, 7, 8))
    for row in parameter_rows(found):
        table.add_row(*map(escape, row))
    parts += [table, Text(), found.intervals.table(), Text()]
    for prediction in found.predictions:
        parts += [prediction_table(prediction), Text()]
    if not found.predictions:
        parts.append(Text("There is no unseen log to hold the predictions against."))
    return Group(*parts, *(Text(f"Note: {note}") for note in found.fit.notes))
