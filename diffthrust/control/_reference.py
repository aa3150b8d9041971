"""What a loop is to follow: a value with its rate and acceleration over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.results import Brief
from diffthrust._support.validation import finite

Followed = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Value, rate and acceleration at some instants, ``(n,)`` each."""


@dataclass(frozen=True)
class Sinusoid:
    """offset + amplitude sin(frequency t + phase).

    With ``phase=-math.pi / 2`` and ``offset=amplitude`` it begins at rest at zero.

    Args:
        amplitude: in the unit of the channel that follows (m, or rad/s).
        frequency: [rad/s].
        offset: the middle.
        phase: at the start [rad].

    Raises:
        InputError: an amplitude or frequency that is not a positive number.

    Example:
        >>> value, rate, acceleration = dft.control.Sinusoid(0.2, frequency=2.0).at(np.array([0.0]))
        >>> value, rate
        (array([0.]), array([0.4]))
    """

    amplitude: float
    frequency: float
    offset: float = 0.0
    phase: float = 0.0

    def __post_init__(self) -> None:
        for name in ("amplitude", "frequency"):
            finite(f"Sinusoid, {name}", getattr(self, name), lambda x: x > 0, "a positive number")
        for name in ("offset", "phase"):
            finite(f"Sinusoid, {name}", getattr(self, name), lambda x: True, "a number")

    def at(self, time: np.ndarray) -> Followed:
        """Value, rate and acceleration at instants [s]."""
        angle, w = self.frequency * time + self.phase, self.frequency
        value = self.amplitude * np.sin(angle)
        return self.offset + value, self.amplitude * w * np.cos(angle), -(w**2) * value


@dataclass(frozen=True)
class Step:
    """From one value to another at an instant; rate and acceleration are zero.

    Args:
        value: from the instant on, in the unit of the channel that follows.
        time: the instant [s].
        before: the value until then.

    Example:
        >>> value, rate, acceleration = dft.control.Step(100.0, time=0.5).at(np.array([0.0, 1.0]))
        >>> value
        array([  0., 100.])
    """

    value: float
    time: float = 0.0
    before: float = 0.0

    def __post_init__(self) -> None:
        for name in ("value", "time", "before"):
            finite(f"Step, {name}", getattr(self, name), lambda x: True, "a number")

    def at(self, time: np.ndarray) -> Followed:
        """Value, rate and acceleration at instants [s]."""
        # a billionth of a second: an instant on the grid counts, whatever its rounding
        value = np.where(time >= self.time - 1e-9, float(self.value), float(self.before))
        return value, np.zeros_like(time), np.zeros_like(time)


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Brief):
    """Given by samples, straight between them and constant beyond their ends.

    Args:
        time: increasing instants [s], ``(n,)``.
        value: ``(n,)``, in the unit of the channel that follows.
        rate: its derivative, ``(n,)``; by central differences where not given.
        acceleration: the derivative of the rate, likewise.

    Raises:
        InputError: lengths that differ, numbers that are not finite, a time that does not increase.

    Example:
        >>> ramp = dft.control.Trajectory([0.0, 5.0, 10.0], [0.0, 1.0, 1.0], rate=[0.0, 0.1, 0.0])
        >>> ramp.at(np.array([2.5]))[0]
        array([0.5])
    """

    time: Sequence[float] | np.ndarray
    value: Sequence[float] | np.ndarray
    rate: Sequence[float] | np.ndarray | None = None
    acceleration: Sequence[float] | np.ndarray | None = None

    def __post_init__(self) -> None:
        time = self._series("time", self.time, None)
        if time.size < 2 or np.any(np.diff(time) <= 0):
            raise InputError(
                "Trajectory, time: expected two or more increasing instants [s].", "Sort them."
            )
        value = self._series("value", self.value, time)
        rate = np.gradient(value, time) if self.rate is None else self.rate
        rate = self._series("rate", rate, time)
        curve = np.gradient(rate, time) if self.acceleration is None else self.acceleration
        curve = self._series("acceleration", curve, time)
        for name, series in zip(("time", "value", "rate", "acceleration"),
                                (time, value, rate, curve), strict=True):  # fmt: skip
            object.__setattr__(self, name, series)

    @staticmethod
    def _series(name: str, values: Any, time: np.ndarray | None) -> np.ndarray:
        try:
            series = np.asarray(values, float)
        except (TypeError, ValueError):
            series = np.empty((0, 0))
        wanted = series.ndim == 1 and (time is None or series.shape == time.shape)
        if not wanted or not np.all(np.isfinite(series)):
            length = "" if time is None else f" {time.size}"
            missing = f"{int(np.sum(~np.isfinite(series)))} of them not finite" if wanted else ""
            raise InputError(
                f"Trajectory, {name}: expected{length} finite numbers in one row, found "
                f"{missing or f'an array {np.shape(series)}'}.",
                "Give one number for each instant.",
            )
        return series

    def at(self, time: np.ndarray) -> Followed:
        """Value, rate and acceleration at instants [s]."""
        rows = (np.asarray(row) for row in (self.value, self.rate, self.acceleration))
        value, rate, curve = (np.interp(time, np.asarray(self.time), row) for row in rows)
        # constant beyond its ends: a rate there would drive a controller's feed-forward on
        within = (time >= self.time[0]) & (time <= self.time[-1])
        return value, np.where(within, rate, 0.0), np.where(within, curve, 0.0)


Reference = Sinusoid | Step | Trajectory
