"""Profiles of the likelihood, by parameter and quantity."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from diffthrust._support.figures import showing
from diffthrust._support.report import Report, Section
from diffthrust._support.results import Result
from diffthrust._support.words import number
from diffthrust.uncertainty._profile_curve import Profile

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Better:
    """A better optimum found by a walk, which the fit had missed.

    Args:
        values: of all parameters, by full name.
        gain: in log-likelihood over the fit.
    """

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
        from diffthrust.uncertainty._tables import profile_rows

        rows = profile_rows(self.profiles.values(), self.level)
        return Report(Section("", rows), Section("", *self.sentences))

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

    @showing
    def plot(self) -> Figure:
        """Plot each profile with the quadratic of the covariance, the threshold and the ends."""
        from diffthrust.uncertainty._figures import profile_figure

        return profile_figure(list(self.profiles.values()))

    def _line(self) -> str:
        return f"{100 * self.level:g} %: {', '.join(self.profiles)}"
