"""What a loop is to follow: a value over time, or a path over the water."""

from __future__ import annotations

import abc
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

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
        _check(self, ("amplitude", "frequency"), ("offset", "phase"), "a positive number")

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
        _check(self, (), ("value", "time", "before"))

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
        series = {"time": time, "value": value, "rate": rate, "acceleration": curve}
        for name, values in series.items():
            object.__setattr__(self, name, values)

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


_FINE = 2048
"""Points in one wave of a harmonic path, between which its arc length is linear."""


class Wanted(NamedTuple):
    """Where to be at some instants, ``(n,)`` each.

    Args:
        north: [m].
        east: [m].
        course: direction in which the point moves [rad], clockwise from north.

    Example:
        >>> dft.control.Wanted(np.zeros(2), np.zeros(2), np.zeros(2))._fields
        ('north', 'east', 'course')
    """

    north: np.ndarray
    east: np.ndarray
    course: np.ndarray


class Path(abc.ABC):
    """Something to follow over the water; a subclass says where to be, and when.

    Example:
        >>> class Hold(dft.control.Path):
        ...     def at(self, time):
        ...         return dft.control.Wanted(0.0 * time, 0.0 * time, 0.0 * time)
        >>> Hold().at(np.zeros(2)).north
        array([0., 0.])
    """

    @abc.abstractmethod
    def at(self, time: np.ndarray) -> Wanted:
        """Where to be at instants [s], ``(n,)``, counted from the start of the run."""


@dataclass(frozen=True)
class StraightPath(Path):
    """A straight line at constant speed.

    Args:
        speed: [m/s].
        course: [rad], clockwise from north.
        north: where the line begins [m].
        east: likewise [m].

    Raises:
        InputError: a speed that is not above zero, another number that is not finite.

    Example:
        >>> dft.control.StraightPath(0.8).at(np.array([0.0, 10.0])).north
        array([0., 8.])
    """

    speed: float
    course: float = 0.0
    north: float = 0.0
    east: float = 0.0

    def __post_init__(self) -> None:
        _check(self, ("speed",), ("course", "north", "east"))

    def at(self, time: np.ndarray) -> Wanted:
        """Where to be at instants [s]."""
        run = self.speed * np.asarray(time, float)
        return _turned(self, run, 0.0 * run, 0.0 * run)


@dataclass(frozen=True)
class HarmonicPath(Path):
    """A sine wave about a straight axis, run at constant speed along the curve.

    Args:
        speed: along the curve [m/s].
        amplitude: to either side of the axis [m]; the first swing goes to starboard.
        wavelength: along the axis [m].
        course: of the axis [rad], clockwise from north.
        north: where the axis begins [m].
        east: likewise [m].

    Raises:
        InputError: a speed, amplitude or wavelength that is not above zero, another number that is
            not finite.

    Example:
        >>> path = dft.control.HarmonicPath(0.8, amplitude=1.5, wavelength=20.0)
        >>> path.at(np.array([0.0, 5.0])).north.round(2)
        array([0.  , 3.74])
    """

    speed: float
    amplitude: float
    wavelength: float
    course: float = 0.0
    north: float = 0.0
    east: float = 0.0

    def __post_init__(self) -> None:
        _check(self, ("speed", "amplitude", "wavelength"), ("course", "north", "east"))

    def at(self, time: np.ndarray) -> Wanted:
        """Where to be at instants [s]."""
        wave = 2.0 * math.pi / self.wavelength
        along = np.linspace(0.0, self.wavelength, _FINE + 1)
        slope = self.amplitude * wave * np.cos(wave * along)
        pace = np.hypot(1.0, slope)
        arc = np.concatenate([[0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]) * np.diff(along))])
        # arc length, an elliptic integral, has no closed form: one wave is tabulated, and repeats
        waves, remaining = np.divmod(self.speed * np.asarray(time, float), arc[-1])
        x = waves * self.wavelength + np.interp(remaining, arc, along)
        aside = self.amplitude * np.sin(wave * x)
        return _turned(self, x, aside, np.arctan(self.amplitude * wave * np.cos(wave * x)))


def wanted_at(path: Path, time: np.ndarray) -> Wanted:
    """Where a path says to be, checked."""
    kind, wanted = type(path).__name__, path.at(time)
    if not isinstance(wanted, Wanted):
        raise InputError(
            f"{kind}.at: expected a Wanted(north, east, course), found {type(wanted).__name__}.",
            "Write return dft.control.Wanted(north, east, course).",
        )
    rows = [np.asarray(row, float) for row in wanted]
    for name, row in zip(Wanted._fields, rows, strict=True):
        if row.shape != time.shape:
            raise InputError(
                f"{kind}.at, {name}: expected {time.size} numbers, one for each instant, found an "
                f"array {row.shape}.",
                "Work elementwise on the time that is given: 0.0 * time, not 0.0.",
            )
        if not np.all(np.isfinite(row)):
            bad = float(time[np.argmin(np.isfinite(row))])
            raise InputError(
                f"{kind}.at, {name}: not finite at {bad:g} s.",
                "Let the path be defined for all times.",
            )
    return Wanted(*rows)


def _check(
    reference: Any,
    positive: tuple[str, ...],
    any_sign: tuple[str, ...],
    expected: str = "a number above zero",
) -> None:
    """Raise `InputError` for fields out of range; a subclass may have others of any kind."""
    kind = type(reference).__name__
    for name in positive:
        finite(f"{kind}, {name}", getattr(reference, name), lambda x: x > 0, expected)
    for name in any_sign:
        finite(f"{kind}, {name}", getattr(reference, name), lambda x: True, "a number")


def _turned(
    path: StraightPath | HarmonicPath, along: np.ndarray, aside: np.ndarray, turn: np.ndarray
) -> Wanted:
    """From the axis of a path to north and east."""
    cos, sin = math.cos(path.course), math.sin(path.course)
    return Wanted(
        path.north + along * cos - aside * sin,
        path.east + along * sin + aside * cos,
        path.course + turn,
    )
