"""What a profile of the likelihood found."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from diffthrust._support.tables import number, with_error

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LOPSIDED = 1.15
"""An interval is called lopsided where one arm is longer than the other by this factor."""


@dataclass(frozen=True, eq=False)
class Profile:
    """The profile likelihood of one parameter or quantity.

    Args:
        name: of the parameter or quantity.
        unit: of all its values.
        value: the best value.
        low: lower end of the interval; ``None`` where it is open, and ``open_low`` says why.
        high: upper end; ``None`` where it is open, and ``open_high`` says why.
        open_low: reason in words, or ``None``.
        open_high: reason in words, or ``None``.
        level: of the interval.
        threshold: what twice the drop of the log-likelihood reaches at the ends.
        grid: values that were tried, increasing, ``(n,)``.
        drop: drop of the log-likelihood at them, with all else at its best, ``(n,)``.
        std_error: that of the fit's covariance, for comparison; ``None`` where it has none.
        quantity: it follows from parameters and is none itself.
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

    @property
    def lopsided(self) -> float | None:
        """Length of the upper arm over that of the lower one; ``None`` where an end is open."""
        if self.low is None or self.high is None or self.low >= self.value:
            return None
        return (self.high - self.value) / (self.value - self.low)

    @property
    def sentence(self) -> str:
        """The interval in words."""
        unit, percent = f" {self.unit}".rstrip(), f"{100 * self.level:g} %"
        low, high = (self._told(end) for end in (self.low, self.high))
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

    def _told(self, end: float | None) -> str:
        if end is None:
            return "-"
        return with_error(end, 0.5 * abs(end - self.value))[0]

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "value": self.value,
            "unit": self.unit,
            "low": self.low,
            "high": self.high,
            "open_low": self.open_low,
            "open_high": self.open_high,
            "std_error": self.std_error,
            "grid": self.grid.tolist(),
            "drop": self.drop.tolist(),
        }


@dataclass(frozen=True)
class Better:
    """An optimum that a walk came upon and that the fit had missed.

    Args:
        values: of all parameters, by full name.
        gain: in log-likelihood over the fit.
    """

    values: Mapping[str, float]
    gain: float


@dataclass(frozen=True, eq=False)
class Profiles:
    """Profiles by the name of the parameter or quantity: ``profiles["alpha"].low``.

    Args:
        profiles: by name.
        level: of their intervals.
        better: a better optimum found on the way, to which the profiles then belong, or ``None``.
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
        told = [p.sentence for p in self.profiles.values()]
        if self.better is not None:
            values = ", ".join(f"{n} = {number(v)}" for n, v in self.better.values.items())
            told.append(
                f"A better optimum than the fit's was found on the way, by {self.better.gain:.3g} "
                f"in log-likelihood, and the profiles belong to it: {values}. Fit again from there."
            )
        return told

    def report(self) -> str:
        """A table and the sentences, as text for people."""
        from rich.console import Group
        from rich.markup import escape
        from rich.text import Text

        from diffthrust._support.tables import plain_table, rendered

        percent = f"{100 * self.level:g} %"
        table = plain_table("Profile", "Value", f"{percent} from", "to", "Unit", numbers=(1, 2, 3))
        for name, p in self.profiles.items():
            arms = [abs(e - p.value) for e in (p.low, p.high) if e is not None and e != p.value]
            error = 0.5 * min(arms) if arms else p.std_error
            ends = [("open" if e is None else with_error(e, error)[0]) for e in (p.low, p.high)]
            table.add_row(escape(name), with_error(p.value, error)[0], *ends, escape(p.unit))
        return rendered(Group(table, Text(), *(Text(s) for s in self.sentences)))

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        better = self.better
        return {
            "schema": 1,
            "level": self.level,
            "profiles": {name: p.to_json() for name, p in self.profiles.items()},
            "better": None
            if better is None
            else {"values": dict(better.values), "gain": better.gain},
        }

    def plot(self) -> Figure:
        """Each profile beside the quadratic of the covariance, with the threshold and the ends."""
        from diffthrust.uncertainty._profile_figure import profile_figure

        return profile_figure(self)
