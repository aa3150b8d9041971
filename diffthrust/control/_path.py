"""Where a vessel is to be at each instant: paths over the water that are run at constant speed."""

from __future__ import annotations

import abc
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.validation import finite

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
        _check(self, positive=("speed",), finite_fields=("course", "north", "east"))

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
        # arc length has no closed form (an elliptic integral): one wave is tabulated, whole waves
        # repeat
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


def _check(path: Path, positive: tuple[str, ...], finite_fields: tuple[str, ...]) -> None:
    kind = type(path).__name__
    for name in positive:
        finite(f"{kind}, {name}", getattr(path, name), lambda x: x > 0, "a number above zero")
    for name in finite_fields:
        finite(f"{kind}, {name}", getattr(path, name), lambda x: True, "a number")


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
