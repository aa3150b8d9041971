"""The results: profiles of the likelihood, and a table of intervals by parameter and method."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from diffthrust._support.figures import showing
from diffthrust._support.report import Report, Section
from diffthrust._support.results import Result, report_of
from diffthrust._support.words import number
from diffthrust.uncertainty._directions import Directions
from diffthrust.uncertainty._tables import intervals_report, profile_rows
from diffthrust.uncertainty._values import Profile, Row

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from diffthrust._support.tables import Renderable

_METHODS = ("covariance", "sandwich", "profile", "posterior")


class Better(NamedTuple):
    """A better optimum found by a walk: all parameters, and the gain in log-likelihood."""

    values: Mapping[str, float]
    gain: float


@dataclass(frozen=True, eq=False, repr=False)
class Profiles(Result):
    """Profiles by the name of the parameter or quantity: ``profiles["alpha"].low``.

    Args:
        profiles: by name.
        level: of their intervals.
        better: a better optimum found on the way, which the profiles then belong to, or ``None``.

    Example:
        >>> found = dft.uncertainty.profile(fit, log, "alpha")
        >>> found["alpha"].level, len(found.sentences), list(found.to_json())
        (0.95, 1, ['schema', 'level', 'profiles', 'better'])
        >>> figure = found.plot()
    """

    profiles: Mapping[str, Profile]
    level: float
    better: Better | None = None

    def __getitem__(self, name: str) -> Profile:
        return self.profiles[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.profiles)

    def __len__(self) -> int:
        return len(self.profiles)

    @property
    def sentences(self) -> list[str]:
        """One for each profile, and one on a better optimum."""
        sentences = [p.sentence for p in self.profiles.values()]
        if self.better is not None:
            values = ", ".join(f"{n} = {number(v)}" for n, v in self.better.values.items())
            sentences.append(
                f"A better optimum than the fit's was found on the way, by {self.better.gain:.3g} "
                f"in log-likelihood, and the profiles belong to it: {values}. Fit again from there."
            )
        return sentences

    def _report(self) -> Report:
        rows = profile_rows(self.profiles.values(), self.level)
        return Report(Section("", rows), Section("", *self.sentences))

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "schema": 1,
            "level": self.level,
            "profiles": {name: p.to_json() for name, p in self.profiles.items()},
            "better": self.better and self.better._asdict(),
        }

    @showing
    def plot(self) -> Figure:
        """Plot each profile with the quadratic of the covariance, the threshold and the ends."""
        from diffthrust.uncertainty._figures import profile_figure

        return profile_figure(list(self.profiles.values()))

    def _line(self) -> str:
        return f"{100 * self.level:g} %: {', '.join(self.profiles)}"


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
