"""The intervals of one parameter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple


class Interval(NamedTuple):
    """An interval; an end that is ``None`` is open."""

    low: float | None
    high: float | None

    def holds(self, value: float) -> bool:
        """Whether a value lies within."""
        above = self.low is None or value >= self.low
        return above and (self.high is None or value <= self.high)


def scaled(
    ends: tuple[float | None, float | None], per: float
) -> tuple[float | None, float | None]:
    """Scale both ends of an interval by a positive number; open ends stay open."""
    low, high = (None if end is None else per * end for end in ends)
    return low, high


@dataclass(frozen=True)
class Row:
    """The intervals of one parameter.

    Args:
        name: full name of the parameter.
        unit: of the value and all intervals.
        value: the estimate.
        intervals: available intervals by method.
        recommended: the method to use.
        sentences: why methods disagree; empty if they agree.
        bounds: lower and upper bound of the parameter if the profile reaches it, else ``None``.
        per: number of ``shown_unit`` per ``unit``.
        shown_unit: display unit; ``unit`` if empty.
    """

    name: str
    unit: str
    value: float
    intervals: Mapping[str, Interval]
    recommended: str
    sentences: tuple[str, ...] = ()
    bounds: tuple[float | None, float | None] = (None, None)
    per: float = 1.0
    shown_unit: str = ""

    @property
    def shown(self) -> Row:
        """The same in the display unit."""
        if not self.shown_unit:
            return self
        return replace(
            self,
            unit=self.shown_unit,
            value=self.per * self.value,
            intervals={m: Interval(*scaled(i, self.per)) for m, i in self.intervals.items()},
            bounds=scaled(self.bounds, self.per),
            per=1.0,
            shown_unit="",
        )

    def to_json(self) -> dict[str, Any]:
        """Plain data, in the parameter's unit and in the display unit."""
        return {
            **self._sizes(),
            "recommended": self.recommended,
            "sentences": list(self.sentences),
            "written": self.shown._sizes(),
        }

    def _sizes(self) -> dict[str, Any]:
        intervals = {method: list(interval) for method, interval in self.intervals.items()}
        return {"value": self.value, "unit": self.unit, "intervals": intervals}

    @property
    def best(self) -> Interval:
        """The recommended interval."""
        return self.intervals[self.recommended]
