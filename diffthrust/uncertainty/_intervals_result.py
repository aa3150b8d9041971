"""A table of intervals: by parameter and by the way they were found."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from diffthrust.uncertainty._directions import Directions
from diffthrust.uncertainty._profile_result import Profiles
from diffthrust.uncertainty._sandwich import Sandwich

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import RenderableType

METHODS = ("covariance", "sandwich", "profile", "posterior")


class Interval(NamedTuple):
    """An interval; an end that is ``None`` is open."""

    low: float | None
    high: float | None

    def holds(self, value: float) -> bool:
        """Whether a value lies within."""
        above = self.low is None or value >= self.low
        return above and (self.high is None or value <= self.high)


@dataclass(frozen=True)
class Row:
    """The intervals of one parameter.

    Args:
        name: full name of the parameter.
        unit: of the value and all intervals.
        value: the estimate.
        intervals: by method, of `METHODS` those that there are.
        recommended: the method to take.
        sentences: why methods disagree; empty where they do not.
        bounds: lower and upper bound of the parameter where the profile reaches it, else ``None``.
    """

    name: str
    unit: str
    value: float
    intervals: Mapping[str, Interval]
    recommended: str
    sentences: tuple[str, ...] = ()
    bounds: tuple[float | None, float | None] = (None, None)

    @property
    def best(self) -> Interval:
        """The recommended interval."""
        return self.intervals[self.recommended]


@dataclass(frozen=True, eq=False)
class Intervals:
    """Intervals of all free parameters of a fit: ``intervals["alpha"].best``.

    Args:
        rows: by parameter.
        level: of all intervals.
        correlation: of the residuals that the fit took as white, from sample to sample; zero within
            what chance gives.
        notes: what holds for all of them, the recommendation first.
        directions: which combinations of parameters the logs know well.
        profiles: the profiles behind the intervals.
        sandwich: the sandwich behind them.
    """

    rows: Mapping[str, Row]
    level: float
    correlation: float
    notes: tuple[str, ...]
    directions: Directions
    profiles: Profiles = field(repr=False)
    sandwich: Sandwich = field(repr=False)

    def __getitem__(self, name: str) -> Row:
        return self.rows[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.rows)

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def methods(self) -> tuple[str, ...]:
        """The methods that some parameter has an interval of."""
        return tuple(m for m in METHODS if any(m in row.intervals for row in self.rows.values()))

    @property
    def sentences(self) -> list[str]:
        """Why methods disagree, over all parameters."""
        return [s for row in self.rows.values() for s in row.sentences]

    def report(self) -> str:
        """One table, the recommended intervals marked by a star, and what there is to say."""
        from diffthrust._support.tables import rendered

        return rendered(self.table(), width=120)

    def table(self) -> RenderableType:
        """The report as a renderable of rich."""
        from rich.console import Group
        from rich.markup import escape
        from rich.text import Text

        from diffthrust._support.tables import plain_table, with_error

        headings = ("Parameter", "Value", *self.methods)
        table = plain_table(*headings, numbers=range(1, len(headings)))
        for column in table.columns[1:]:
            column.no_wrap = True
        for name, row in self.rows.items():
            error = _error(row)
            cells = []
            for method in self.methods:
                found = row.intervals.get(method)
                ends = "-"
                if found is not None:
                    ends = " to ".join(
                        with_error(end, error)[0]
                        if end is not None
                        else "open"
                        if bound is None
                        else "bound"
                        for end, bound in zip(found, row.bounds, strict=True)
                    )
                cells.append(("* " if method == row.recommended else "") + ends)
            told = escape(f"{name} [{row.unit}]" if row.unit else name)
            table.add_row(told, with_error(row.value, error)[0], *cells)
        percent = f"Intervals of {100 * self.level:g} %; the recommended one has a star."
        parts = [
            Text(percent, style="bold"),
            *(Text(note) for note in self.notes),
            Text(),
            table,
            Text(),
        ]
        if self.sentences:
            parts += [Text("Where they disagree", style="bold")]
            parts += [Text(f"- {s}") for s in self.sentences]
        else:
            parts += [Text("They agree.")]
        parts += [Text(), Text("What the logs know", style="bold"), self.directions.table()]
        return Group(*parts)

    def to_json(self) -> dict[str, Any]:
        """Plain data; ``None`` for an open end."""
        return {
            "schema": 1,
            "level": self.level,
            "correlation": self.correlation,
            "notes": list(self.notes),
            "parameters": {
                name: {
                    "value": row.value,
                    "unit": row.unit,
                    "recommended": row.recommended,
                    "intervals": {m: list(i) for m, i in row.intervals.items()},
                    "sentences": list(row.sentences),
                }
                for name, row in self.rows.items()
            },
            "directions": self.directions.to_json(),
        }

    def plot(self) -> Figure:
        """The intervals as bars below each other, one panel for each parameter."""
        from diffthrust.uncertainty._intervals_figure import intervals_figure

        return intervals_figure(self)


def _error(row: Row) -> float | None:
    """What sets the number of digits of a row: half of the shortest arm."""
    ends = [e for found in row.intervals.values() for e in found if e is not None]
    arms = [abs(e - row.value) for e in ends if e != row.value]
    return 0.5 * min(arms) if arms else None
