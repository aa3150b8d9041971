"""The intervals of one parameter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple


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
        intervals: by method, those that there are.
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
