"""A fleet as text for people."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.text import Text

from diffthrust._support.tables import number, plain_table, with_error
from diffthrust._support.words import joined, percent, probability, spelt
from diffthrust.many._fleet.estimates import Estimates


def fleet_table(
    fleet: Estimates, spread: Any, outliers: Any, drift: Any, effects: Any, notes: Sequence[str]
) -> RenderableType:
    """Spread, outliers, drift (``None`` where there are no times), effects and notes."""
    sentences = [*_outliers(outliers), *_drift(drift, fleet.time_unit), *_effects(effects)]
    parts: list[RenderableType] = [
        Text(f"Fits: {len(fleet.entries)}. Vehicles: {len(fleet.vehicles)}.", style="bold"),
        Text(),
        _spread(spread),
        Text(),
        *(Text(sentence) for sentence in sentences),
        *(Text(f"Note: {note}") for note in notes),
    ]
    return Group(*parts)


def pooled_table(
    population: Any, vehicles: Any, level: float, notes: Sequence[str]
) -> RenderableType:
    """The law of the fleet, each vehicle, and what is to be said of them."""
    law = plain_table("Parameter", "Unit", "Median", "Interval", "Between sd", "Interval",
                 numbers=(2, 4))  # fmt: skip
    for row in _rows(population):
        spread = number(row.between_low, 2), number(row.between_high, 2)
        median, low, high = _interval(row.median, row.low, row.high)
        law.add_row(escape(row.parameter), escape(row.unit), median, f"{low} to {high}",
                    number(row.between_sd, 2), " to ".join(spread))  # fmt: skip
    each = plain_table("Vehicle", "Parameter", "By itself", "Std error", "Pooled", "Sd", "Interval",
                 "From the fleet", numbers=(2, 3, 4, 5, 7))  # fmt: skip
    for row in _rows(vehicles):
        error = row.separate_std_error if np.isfinite(row.separate_std_error) else None
        median, sd = with_error(row.median, row.sd)
        _, low, high = _interval(row.median, row.low, row.high)
        star = "*" if row.likelihood == "exact" else ""
        each.add_row(f"{escape(row.vehicle)}{star}", escape(row.parameter),
                    *with_error(row.separate, error), median, sd, f"{low} to {high}",
                    percent(row.shrinkage))  # fmt: skip
    parts: list[RenderableType] = [
        Text(f"The fleet ({percent(level)} intervals)", style="bold"),
        law,
        Text(),
        Text("Its vehicles", style="bold"),
        each,
        *(
            [Text("* by the exact likelihood of its logs")]
            if (vehicles["likelihood"] == "exact").any()
            else []
        ),
        Text(),
        *(Text(note) for note in notes),
    ]
    return Group(*parts)


def _rows(table: Any) -> list[Any]:
    """The rows of a table as tuples with the columns' names."""
    return list(table.itertuples())


def _interval(median: float, low: float, high: float) -> tuple[str, str, str]:
    error = 0.25 * (high - low)
    return with_error(median, error)[0], with_error(low, error)[0], with_error(high, error)[0]


def _spread(spread: Any) -> RenderableType:
    table = plain_table("Parameter", "Unit", "Vehicles", "Median", "Robust sd", "Between sd",
                   "Beyond errors", "Q", "Dof", "Alike?", numbers=range(2, 9))  # fmt: skip
    for row in _rows(spread):
        table.add_row(
            escape(row.parameter),
            escape(row.unit),
            str(row.vehicles),
            with_error(row.median, row.robust_sd or None)[0],
            number(row.robust_sd, 2),
            number(row.between_sd, 2),
            percent(row.share),
            number(row.q, 3),
            str(row.dof),
            probability(row.p_value),
        )
    return table


def _outliers(outliers: Any) -> Iterator[str]:
    rows = _rows(outliers)
    far = [row for row in rows if row.outlier]
    for row in far:
        yield (
            f"Outlier: {row.vehicle}, {row.parameter} {number(row.value, 3)} {row.unit}, the "
            f"others {number(row.others, 3)} ({number(abs(row.distance), 2)} standard deviations "
            "away)."
        )
    if rows and not far:
        yield "No vehicle is an outlier (5 % chance of a false alarm over all)."


def _drift(drift: Any, time_unit: str) -> Iterator[str]:
    if drift is None:
        return
    rows = _rows(drift)
    moving = [row for row in rows if row.drifts]
    for row in moving:
        slope, error = with_error(100 * row.relative, 100 * abs(
            row.relative * row.slope_std_error / row.slope))  # fmt: skip
        yield (
            f"Drift: {row.vehicle}, {row.parameter} by {slope} +- {error} % per {time_unit} "
            f"({row.fits} fits, {probability(row.p_value)})."
        )
    if rows and not moving:
        yield "Nothing drifts (5 % chance of a false alarm over all)."


def _effects(table: Any) -> Iterator[str]:
    for name in (column for column in table.columns if column != "fits"):
        where = [
            f"{vehicle} ({round(share * fits)} of {fits})"
            for vehicle, share, fits in zip(table.index, table[name], table["fits"], strict=True)
            if share > 0
        ]
        yield f"Effect: {spelt(name)} in {joined(where)}."
