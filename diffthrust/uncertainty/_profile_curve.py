"""The profile of one parameter or quantity."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from diffthrust._support.results import Brief
from diffthrust._support.words import with_error
from diffthrust.uncertainty._intervals_row import scaled

LOPSIDED = 1.15
"""An interval is called lopsided if one arm is longer than the other by this factor."""


@dataclass(frozen=True, eq=False, repr=False)
class Profile(Brief):
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
    def shown(self) -> Profile:
        """The same in the display unit."""
        if not self.shown_unit:
            return self
        low, high = scaled((self.low, self.high), self.per)
        return replace(
            self,
            unit=self.shown_unit,
            value=self.per * self.value,
            low=low,
            high=high,
            grid=self.per * self.grid,
            std_error=None if self.std_error is None else self.per * self.std_error,
            bounds=scaled(self.bounds, self.per),
            per=1.0,
            shown_unit="",
        )

    @property
    def lopsided(self) -> float | None:
        """Ratio of the upper to the lower arm; ``None`` if an end is open."""
        if self.low is None or self.high is None or self.low >= self.value:
            return None
        return (self.high - self.value) / (self.value - self.low)

    @property
    def sentence(self) -> str:
        """The interval in words, in the display unit."""
        return self.shown._sentence

    @property
    def _sentence(self) -> str:
        unit, percent = f" {self.unit}".rstrip(), f"{100 * self.level:g} %"
        low, high = (self._end_text(end) for end in (self.low, self.high))
        if self.low is not None and self.high is not None:
            words = f"{self.name} lies between {low} and {high}{unit} ({percent})"
            ratio = self.lopsided
            if ratio is not None and not 1 / LOPSIDED < ratio < LOPSIDED:
                longer, size = ("up", ratio) if ratio > 1 else ("down", 1 / ratio)
                words += f", reaching {size:.2g} times as far {longer} as the other way"
            return f"{words}."
        if self.low is not None:
            return f"{self.name} is at least {low}{unit} ({percent}); upwards {self.open_high}."
        if self.high is not None:
            return f"{self.name} is at most {high}{unit} ({percent}); downwards {self.open_low}."
        return (
            f"{self.name} is not bounded by these logs: downwards {self.open_low}, "
            f"upwards {self.open_high}."
        )

    def _end_text(self, end: float | None) -> str:
        if end is None:
            return "-"
        return with_error(end, 0.5 * abs(end - self.value))[0]

    def to_json(self) -> dict[str, Any]:
        """Plain data, the interval in the parameter's unit and in the display unit."""
        return {
            **self._ends(),
            "written": self.shown._ends(),
            "open_low": self.open_low,
            "open_high": self.open_high,
            "grid": self.grid.tolist(),
            "drop": self.drop.tolist(),
        }

    def _ends(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in ("value", "unit", "low", "high", "std_error")}
