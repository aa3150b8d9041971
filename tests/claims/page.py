"""What is known besides a diagnosis: its logs and equations written once more, and the plant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from reference import equations
from reference import whole_runs as wr

NOISE = 1.5
"""Where the truth reaches so many times the error of the sensors, no random force is at work."""


@dataclass
class Page:
    """The logs as plain arrays, and what is true of them.

    Attributes:
        train: as `whole_runs.Run`; ``unseen`` likewise.
        hidden: names of the effects that the plant has; ``None`` where nobody knows (measured).
        law: port and signal (a regular expression) of what no effect of the catalogue names.
        true: the plant's equations, where they are known.
        truth: the plant's numbers.
        noise: standard deviation of each channel's sensor.
        mistaken: whether a channel of the logs does not mean what its name says.
        starts: of each least squares.
    """

    train: Sequence[wr.Run]
    unseen: Sequence[wr.Run]
    hidden: frozenset[str] | None = None
    law: tuple[str, str] | None = None
    true: wr.System | None = None
    truth: dict[str, float] = field(default_factory=dict)
    noise: dict[str, float] = field(default_factory=dict)
    mistaken: bool = False
    starts: int = 2
    _fits: dict[Any, wr.Found] = field(default_factory=dict)

    @property
    def judged(self) -> Sequence[wr.Run]:
        """The logs that errors are told of."""
        return self.unseen or self.train

    def modelled(self, fit: Any) -> dict[str, float]:
        """NRMSE on the judged logs of a fit of the package, simulated here."""
        name, effects, numbers, _ = numbers_of(fit)
        system = equations.system_of(name, effects)
        return wr.errors(system, self.judged, equations.values_of(name, effects, numbers))

    def plain(self, fit: Any, without: str = "") -> wr.Found:
        """A plain least squares of the equations of a fit, or of these without an effect."""
        name, effects, numbers, fixed = numbers_of(fit)
        effects = tuple(effect for effect in effects if effect != without)
        numbers = {n: value for n, value in numbers.items() if n.partition(".")[0] != without}
        fixed = [n for n in fixed if n in numbers]
        key = (name, effects)
        if key not in self._fits:
            self._fits[key] = equations.fit_of(
                name, effects, numbers, fixed, self.train, starts=self.starts, most=25, ftol=1e-6
            )
        return self._fits[key]

    @cached_property
    def best(self) -> dict[str, float]:
        """Errors of the truth on the judged logs; empty where nobody knows it."""
        return wr.errors(self.true, self.judged, self.truth) if self.true else {}

    @cached_property
    def quiet(self) -> bool:
        """Whether the truth reaches the noise of every sensor: then no random force is at work."""
        spread = wr.spreads(self.true, self.judged) if self.true else {}
        return bool(self.best) and all(
            self.best[c] * spread[c] <= NOISE * self.noise[c] for c in spread
        )


def numbers_of(fit: Any) -> tuple[str, tuple[str, ...], dict[str, float], list[str]]:
    numbers = {n: e.value for n, e in fit.parameters.items()}
    fixed = [n for n, e in fit.parameters.items() if e.fixed]
    return fit.model.name, tuple(e.name for e in fit.model.effects), numbers, fixed
