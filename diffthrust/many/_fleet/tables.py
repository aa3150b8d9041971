"""A fleet as text for people."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.text import Text

from diffthrust._support.tables import number, plain_table, rendered, with_error
from diffthrust._support.words import joined, percent, probability, spelt

if TYPE_CHECKING:
    from diffthrust.many._fleet.fleet import Fleet
    from diffthrust.many._fleet.pooled import Pooled


def fleet_report(fleet: Fleet) -> str:
    """Spread, outliers, drift, effects and notes."""
    parts: list[RenderableType] = [
        Text(f"Fits: {len(fleet.entries)}. Vehicles: {len(fleet.vehicles)}.", style="bold"),
        Text(),
        _spread(fleet),
        Text(),
        *(Text(sentence) for sentence in (*_outliers(fleet), *_drift(fleet), *_effects(fleet))),
        *(Text(f"Note: {note}") for note in fleet.notes),
    ]
    return rendered(Group(*parts), width=120)


def pooled_report(pooled: Pooled) -> str:
    """The law of the fleet, each vehicle, convergence and notes."""
    law = plain_table("Parameter", "Unit", "Median", "Interval", "Between sd", "Interval",
                 numbers=(2, 4))  # fmt: skip
    for row in _rows(pooled.population):
        spread = number(row.between_low, 2), number(row.between_high, 2)
        median, low, high = _interval(row.median, row.low, row.high)
        law.add_row(escape(row.parameter), escape(row.unit), median, f"{low} to {high}",
                    number(row.between_sd, 2), " to ".join(spread))  # fmt: skip
    own = plain_table("Vehicle", "Parameter", "By itself", "Std error", "Pooled", "Sd", "Interval",
                 "From the fleet", numbers=(2, 3, 4, 5, 7))  # fmt: skip
    for row in _rows(pooled.table):
        error = row.separate_std_error if np.isfinite(row.separate_std_error) else None
        median, sd = with_error(row.median, row.sd)
        _, low, high = _interval(row.median, row.low, row.high)
        star = "*" if row.likelihood == "exact" else ""
        own.add_row(f"{escape(row.vehicle)}{star}", escape(row.parameter),
                    *with_error(row.separate, error), median, sd, f"{low} to {high}",
                    percent(row.shrinkage))  # fmt: skip
    parts: list[RenderableType] = [
        Text(f"The fleet ({percent(pooled.level)} intervals)", style="bold"),
        law,
        Text(),
        Text("Its vehicles", style="bold"),
        own,
        *([Text("* by the exact likelihood of its logs")] if pooled.exact else []),
        Text(),
        Text(pooled.convergence.message),
        *(Text(f"Note: {note}") for note in pooled.notes),
    ]
    return rendered(Group(*parts), width=120)


def _rows(table: Any) -> list[Any]:
    """The rows of a table as tuples with the columns' names."""
    return list(table.itertuples())


def _interval(median: float, low: float, high: float) -> tuple[str, str, str]:
    error = 0.25 * (high - low)
    return with_error(median, error)[0], with_error(low, error)[0], with_error(high, error)[0]


def _spread(fleet: Fleet) -> RenderableType:
    table = plain_table("Parameter", "Unit", "Vehicles", "Median", "Robust sd", "Between sd",
                   "Beyond errors", "Q", "Dof", "Alike?", numbers=range(2, 9))  # fmt: skip
    for row in _rows(fleet.spread()):
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


def _outliers(fleet: Fleet) -> Iterator[str]:
    found = _rows(fleet.outliers())
    told = [row for row in found if row.outlier]
    for row in told:
        yield (
            f"Outlier: {row.vehicle}, {row.parameter} {number(row.value, 3)} {row.unit}, the "
            f"others {number(row.others, 3)} ({number(abs(row.distance), 2)} standard deviations "
            "away)."
        )
    if found and not told:
        yield "No vehicle is an outlier (5 % chance of a false alarm over all)."


def _drift(fleet: Fleet) -> Iterator[str]:
    if np.isnan(fleet.times).any():
        return
    found = _rows(fleet.drift())
    told = [row for row in found if row.drifts]
    for row in told:
        slope, error = with_error(100 * row.relative, 100 * abs(
            row.relative * row.slope_std_error / row.slope))  # fmt: skip
        yield (
            f"Drift: {row.vehicle}, {row.parameter} by {slope} +- {error} % per {fleet.time_unit} "
            f"({row.fits} fits, {probability(row.p_value)})."
        )
    if found and not told:
        yield "Nothing drifts (5 % chance of a false alarm over all)."


def _effects(fleet: Fleet) -> Iterator[str]:
    table: Any = fleet.effects()
    for name in (column for column in table.columns if column != "fits"):
        where = [
            f"{vehicle} ({round(share * fits)} of {fits})"
            for vehicle, share, fits in zip(table.index, table[name], table["fits"], strict=True)
            if share > 0
        ]
        yield f"Effect: {spelt(name)} in {joined(where)}."
