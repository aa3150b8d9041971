"""A number or curve derived from the parameters, with its interval."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from diffthrust._support.results import Brief


@dataclass(frozen=True, repr=False)
class DerivedQuantity(Brief):
    """A number or curve derived from the parameters, with its interval.

    Args:
        name: of the quantity.
        unit: of the values.
        median: a number, or ``(m,)`` for a curve.
        low: lower end of the interval, point by point.
        high: upper end.
        draws: the values by draw, ``(n,)`` or ``(n, m)``.
        grid: abscissa of a curve, ``(m,)``; ``None`` for a number.
        grid_name: name of the abscissa.
        grid_unit: its unit.
        per: number of ``shown_unit`` per ``unit``.
        shown_unit: display unit, in which the logs were written; ``unit`` if empty.
        shown_grid: the abscissa in its display unit, ``(m,)``; ``None`` if the same.
        shown_grid_unit: display unit of the abscissa.
    """

    name: str
    unit: str
    median: Any
    low: Any
    high: Any
    draws: np.ndarray = field(repr=False)
    grid: np.ndarray | None = None
    grid_name: str = ""
    grid_unit: str = ""
    per: float = 1.0
    shown_unit: str = ""
    shown_grid: np.ndarray | None = None
    shown_grid_unit: str = ""

    @property
    def shown(self) -> DerivedQuantity:
        """The same in the display units."""
        names = ("median", "low", "high", "draws")
        values = {name: self.per * getattr(self, name) for name in names}
        unit = {"unit": self.shown_unit or self.unit, "per": 1.0, "shown_unit": ""}
        if self.shown_grid is not None:
            grid = {"grid": self.shown_grid, "grid_unit": self.shown_grid_unit}
            unit = {**unit, **grid, "shown_grid": None, "shown_grid_unit": ""}
        return replace(self, **values, **unit)

    def to_json(self) -> dict[str, Any]:
        """Median and interval as plain data, infinite times as ``null``; also in display units."""
        return {**self._plain(), "written": self.shown._plain()}

    def _plain(self) -> dict[str, Any]:
        data = {"unit": self.unit, "median": self.median, "low": self.low, "high": self.high}
        if self.grid is not None:
            data["grid"] = {"name": self.grid_name, "unit": self.grid_unit, "values": self.grid}
        return data


def summarised(
    name: str, unit: str, values: np.ndarray, level: float, *grid: Any
) -> DerivedQuantity:
    """Summarise values by draw, ``(n,)``, or ``(n, m)`` over a grid."""
    # a missing response counts as infinitely late, which cannot be interpolated
    method: Any = "linear" if np.all(np.isfinite(values)) else "inverted_cdf"
    ends = [0.5, 0.5 * (1 - level), 0.5 * (1 + level)]
    median, low, high = np.quantile(values, ends, axis=0, method=method)
    if values.ndim == 1:
        median, low, high = float(median), float(low), float(high)
    return DerivedQuantity(name, unit, median, low, high, values, *grid)
