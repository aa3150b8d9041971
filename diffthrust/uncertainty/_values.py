"""Intervals and the profile of one parameter, in its unit and in that of the logs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from diffthrust._support.files import plain
from diffthrust._support.results import Brief
from diffthrust._support.words import with_error

LOPSIDED = 1.15
"""An interval is called lopsided if one arm is longer than the other by this factor."""


class Interval(NamedTuple):
    """An interval; an end that is ``None`` is open."""

    low: float | None
    high: float | None

    def holds(self, value: float) -> bool:
        """Whether a value lies within."""
        above = self.low is None or value >= self.low
        return above and (self.high is None or value <= self.high)


def scaled(value: Any, per: float) -> Any:
    """Multiply a number, an array, an interval or a mapping of these; no open end, and no word."""
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, Mapping):
        return {name: scaled(item, per) for name, item in value.items()}
    if isinstance(value, tuple):
        return Interval(*(scaled(end, per) for end in value))
    return per * value


def shortest_half_arm(value: float, ends: Iterable[float | None]) -> float | None:
    """Half the distance to the nearest end, which sets the number of digits."""
    arms = [abs(end - value) for end in ends if end is not None and end != value]
    return 0.5 * min(arms) if arms else None


def central(
    values: np.ndarray, level: float, axis: int | None = None, method: Any = "linear"
) -> np.ndarray:
    """Lower end, median and upper end of an interval of equal tails."""
    shares = [0.5 * (1 - level), 0.5, 0.5 * (1 + level)]
    return np.quantile(values, shares, axis=axis, method=method)


class Shown:
    """A dataclass with values in ``unit``; times ``per`` they are in the display unit.

    ``shown_unit`` is the display unit, ``unit`` if empty.
    """

    _in_unit: ClassVar[tuple[str, ...]]
    """Fields that are in the unit."""

    @property
    def shown(self) -> Self:
        """The same in the display unit."""
        own: Any = self
        if not own.shown_unit:
            return self
        sizes = {name: scaled(getattr(self, name), own.per) for name in self._in_unit}
        return replace(own, **sizes, unit=own.shown_unit, per=1.0, shown_unit="")

    def _json(self, *names: str) -> dict[str, Any]:
        """These fields as plain data, and as "written" in the display unit."""
        plain_data, written = (
            {name: plain(getattr(item, name)) for name in names} for item in (self, self.shown)
        )
        return {**plain_data, "written": written}


@dataclass(frozen=True)
class Row(Shown):
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

    _in_unit = ("value", "intervals", "bounds")

    name: str
    unit: str
    value: float
    intervals: Mapping[str, Interval]
    recommended: str
    sentences: tuple[str, ...] = ()
    bounds: tuple[float | None, float | None] = (None, None)
    per: float = 1.0
    shown_unit: str = ""

    def to_json(self) -> dict[str, Any]:
        """Plain data, in the parameter's unit and in the display unit."""
        choice = {"recommended": self.recommended, "sentences": list(self.sentences)}
        return self._json("value", "unit", "intervals") | choice

    @property
    def best(self) -> Interval:
        """The recommended interval."""
        return self.intervals[self.recommended]


@dataclass(frozen=True, eq=False, repr=False)
class Profile(Brief, Shown):
    """The profile likelihood of one parameter or quantity.

    Args:
        name: of the parameter or quantity.
        unit: of all its values.
        value: the best value.
        low: lower end of the interval; ``None`` if open, for the reason in ``open_low``.
        high: upper end; ``None`` if open, for the reason in ``open_high``.
        open_low: reason in words, or ``None``.
        open_high: reason in words, or ``None``.
        level: of the interval.
        threshold: twice the drop of the log-likelihood at the ends.
        grid: evaluated values, increasing, ``(n,)``.
        drop: drop of the log-likelihood there, all other parameters optimised, ``(n,)``.
        std_error: from the fit's covariance, for comparison; ``None`` if it has none.
        quantity: whether it is derived from parameters.
        bounds: lower and upper bound of the parameter if the profile reaches it, else ``None``.
        per: number of ``shown_unit`` per ``unit``.
        shown_unit: display unit; ``unit`` if empty.

    Example:
        >>> alpha = dft.uncertainty.profile(fit, log, "alpha")["alpha"]
        >>> alpha.low < alpha.value < alpha.high, alpha.unit, alpha.lopsided < 1.1
        (True, '1/rad', True)
        >>> alpha.shown.unit, "alpha" in alpha.sentence, sorted(alpha.to_json())[:3]
        ('1/rad', True, ['drop', 'grid', 'high'])
    """

    _in_unit = ("value", "low", "high", "grid", "std_error", "bounds")

    name: str
    unit: str
    value: float
    low: float | None
    high: float | None
    open_low: str | None
    open_high: str | None
    level: float
    threshold: float
    grid: np.ndarray = field(repr=False)
    drop: np.ndarray = field(repr=False)
    std_error: float | None
    quantity: bool = False
    bounds: tuple[float | None, float | None] = (None, None)
    per: float = 1.0
    shown_unit: str = ""

    @property
    def lopsided(self) -> float | None:
        """Ratio of the upper to the lower arm; ``None`` if an end is open."""
        if self.low is None or self.high is None or self.low >= self.value:
            return None
        return (self.high - self.value) / (self.value - self.low)

    @property
    def sentence(self) -> str:
        """The interval in words, in the display unit."""
        p = self.shown
        low, high = (
            "" if end is None else with_error(end, 0.5 * abs(end - p.value))[0]
            for end in (p.low, p.high)
        )
        unit = f" {p.unit}".rstrip() + f" ({100 * p.level:g} %)"
        if low and high:
            longer = longer_arm(p)
            reaching = f", reaching {longer}" if longer else ""
            return f"{p.name} lies between {low} and {high}{unit}{reaching}."
        if low:
            return f"{p.name} is at least {low}{unit}; upwards {p.open_high}."
        if high:
            return f"{p.name} is at most {high}{unit}; downwards {p.open_low}."
        return (
            f"{p.name} is not bounded by these logs: downwards {p.open_low}, upwards {p.open_high}."
        )

    def to_json(self) -> dict[str, Any]:
        """Plain data, the interval in the parameter's unit and in the display unit."""
        also = ("open_low", "open_high", "grid", "drop")
        return {
            **self._json("value", "unit", "low", "high", "std_error"),
            **{name: plain(getattr(self, name)) for name in also},
        }


def longer_arm(profile: Profile) -> str:
    """How much further an interval reaches to one side, in words; empty if hardly."""
    ratio = profile.lopsided
    if ratio is None or 1 / LOPSIDED < ratio < LOPSIDED:
        return ""
    way, size = ("up", ratio) if ratio > 1 else ("down", 1 / ratio)
    return f"{size:.2g} times as far {way} as the other way"
