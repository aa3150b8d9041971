"""The reports of a fleet, as data."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from diffthrust._support.report import Report, Rows, Section, Styled, notes
from diffthrust._support.words import humanize, joined, number, percent, probability, with_error
from diffthrust.many._fleet.statistics import Estimates


def fleet_report(
    fleet: Estimates, spread: Any, outliers: Any, drift: Any, effects: Any, remarks: Sequence[str]
) -> Report:
    """Spread, outliers, drift (``None`` where there are no times), effects and notes."""
    counts = f"Fits: {len(fleet.entries)}. Vehicles: {len(fleet.vehicles)}."
    return Report(
        Section("", Styled(counts, "strong")),
        Section("", _spread_rows(spread)),
        Section(
            "",
            *_outliers(outliers),
            *_drift(drift, fleet.time_unit),
            *_effects(effects),
            *notes(remarks),
        ),
    )


def pooled_report(population: Any, vehicles: Any, level: float, remarks: Sequence[str]) -> Report:
    """The law of the fleet, its vehicles, and remarks."""
    exact = bool((vehicles["likelihood"] == "exact").any())
    return Report(
        Section(f"The fleet ({percent(level)} intervals)", _population_rows(population)),
        Section(
            "Its vehicles",
            _vehicle_rows(vehicles),
            "* by the exact likelihood of its logs" if exact else "",
        ),
        Section("", *remarks),
    )


def _population_rows(population: Any) -> Rows:
    rows = []
    for row in population.itertuples():
        median, low, high = _interval(row.median, row.low, row.high)
        spread = f"{number(row.between_low, 2)} to {number(row.between_high, 2)}"
        law = (row.parameter, row.unit, median, f"{low} to {high}", number(row.between_sd, 2))
        rows.append((*law, spread))
    headings = ("Parameter", "Unit", "Median", "Interval", "Between sd", "Interval")
    return Rows.of(headings, rows, numbers=(2, 4))


def _vehicle_rows(vehicles: Any) -> Rows:
    rows = []
    for row in vehicles.itertuples():
        error = row.separate_std_error if np.isfinite(row.separate_std_error) else None
        median, sd = with_error(row.median, row.sd)
        _, low, high = _interval(row.median, row.low, row.high)
        star = "*" if row.likelihood == "exact" else ""
        separate = with_error(row.separate, error)
        pooled = (median, sd, f"{low} to {high}", percent(row.shrinkage))
        rows.append((f"{row.vehicle}{star}", row.parameter, *separate, *pooled))
    headings = (
        *("Vehicle", "Parameter", "By itself", "Std error"),
        *("Pooled", "Sd", "Interval", "From the fleet"),
    )
    return Rows.of(headings, rows, numbers=(2, 3, 4, 5, 7))


def _interval(median: float, low: float, high: float) -> tuple[str, str, str]:
    # Half the half-width of a 95 % interval: about the standard error, which sets the digits.
    error = 0.25 * (high - low)
    return with_error(median, error)[0], with_error(low, error)[0], with_error(high, error)[0]


def _spread_rows(spread: Any) -> Rows:
    rows = []
    for row in spread.itertuples():
        median = with_error(row.median, row.robust_sd or None)[0]
        sizes = (number(row.robust_sd, 2), number(row.between_sd, 2), percent(row.share))
        test = (number(row.q, 3), str(row.dof), probability(row.p_value))
        rows.append((row.parameter, row.unit, str(row.vehicles), median, *sizes, *test))
    headings = (
        *("Parameter", "Unit", "Vehicles", "Median", "Robust sd"),
        *("Between sd", "Beyond errors", "Q", "Dof", "Alike?"),
    )
    return Rows.of(headings, rows, numbers=range(2, 9))


def _outliers(outliers: Any) -> Iterator[str]:
    for row in outliers[outliers["outlier"]].itertuples():
        yield (
            f"Outlier: {row.vehicle}, {row.parameter} {number(row.value, 3)} {row.unit}, the "
            f"others {number(row.others, 3)} ({number(abs(row.distance), 2)} standard deviations "
            "away)."
        )
    if len(outliers) and not outliers["outlier"].any():
        yield "No vehicle is an outlier (5 % chance of a false alarm over all)."


def _drift(drift: Any, time_unit: str) -> Iterator[str]:
    if drift is None:
        return
    for row in drift[drift["drifts"]].itertuples():
        slope, error = with_error(100 * row.relative, 100 * abs(
            row.relative * row.slope_std_error / row.slope))  # fmt: skip
        yield (
            f"Drift: {row.vehicle}, {row.parameter} by {slope} +- {error} % per {time_unit} "
            f"({row.fits} fits, {probability(row.p_value)})."
        )
    if len(drift) and not drift["drifts"].any():
        yield "Nothing drifts (5 % chance of a false alarm over all)."


def _effects(table: Any) -> Iterator[str]:
    for name in (column for column in table.columns if column != "fits"):
        where = [
            f"{vehicle} ({round(share * fits)} of {fits})"
            for vehicle, share, fits in zip(table.index, table[name], table["fits"], strict=True)
            if share > 0
        ]
        yield f"Effect: {humanize(name)} in {joined(where)}."
