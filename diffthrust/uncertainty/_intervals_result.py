"""A table of intervals, by parameter and method."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from diffthrust._support.figures import showing
from diffthrust._support.report import Report
from diffthrust._support.results import Result, report_of
from diffthrust.uncertainty._directions import Directions
from diffthrust.uncertainty._intervals_row import Row
from diffthrust.uncertainty._profile_result import Profiles

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from diffthrust._support.tables import Renderable

_METHODS = ("covariance", "sandwich", "profile", "posterior")


@dataclass(frozen=True, eq=False, repr=False)
class Intervals(Result):
    """Intervals of all free parameters of a fit: ``intervals["alpha"].best``.

    Args:
        rows: by parameter.
        level: of all intervals.
        correlation: lag-one correlation of the residuals assumed white; zero if within chance.
        notes: remarks on all intervals, the recommendation first.
        directions: combinations of parameters, by how well the logs determine them.
        profiles: the profiles behind the intervals.

    Example:
        >>> found = dft.intervals(fit, log)
        >>> found.methods, found.level, len(found.sentences), found.table() is not None
        (('covariance', 'sandwich', 'profile'), 0.95, 1, True)
        >>> list(found.to_json())
        ['schema', 'level', 'correlation', 'notes', 'parameters', 'directions']
        >>> figure = found.plot()
    """

    rows: Mapping[str, Row]
    level: float
    correlation: float
    notes: tuple[str, ...]
    directions: Directions
    profiles: Profiles = field(repr=False)

    def __getitem__(self, name: str) -> Row:
        return self.rows[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.rows)

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def methods(self) -> tuple[str, ...]:
        """The methods for which any parameter has an interval."""
        return tuple(m for m in _METHODS if any(m in row.intervals for row in self.rows.values()))

    @property
    def sentences(self) -> list[str]:
        """Why methods disagree, over all parameters."""
        return [s for row in self.rows.values() for s in row.sentences]

    def _line(self) -> str:
        each = ", ".join(f"{row.name} by {row.recommended}" for row in self.rows.values())
        return f"{100 * self.level:g} %: {each}"

    def table(self) -> Renderable:
        """The report as a renderable of rich."""
        from diffthrust._support.tables import renderable

        return renderable(self._report())

    def _report(self) -> Report:
        from diffthrust.uncertainty._tables import intervals_report

        rows = [row.shown for row in self.rows.values()]
        directions = report_of(self.directions)
        return intervals_report(rows, self.methods, self.level, self.notes, directions)

    def to_json(self) -> dict[str, Any]:
        """Plain data; ``None`` for an open end."""
        return {
            "schema": 1,
            "level": self.level,
            "correlation": self.correlation,
            "notes": list(self.notes),
            "parameters": {name: row.to_json() for name, row in self.rows.items()},
            "directions": self.directions.to_json(),
        }

    @showing
    def plot(self) -> Figure:
        """Plot the intervals as stacked bars, one panel for each parameter."""
        from diffthrust.uncertainty._figures import intervals_figure

        return intervals_figure([row.shown for row in self.rows.values()], self.methods, self.level)
