"""The user's notation of a channel: its unit, and pulse widths as an effort."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np

from diffthrust._support.errors import InputError, Place
from diffthrust._support.names import listing, nearest
from diffthrust.logs._units import convert, convert_scale, is_finite

FURTHEST = 3.0
"""Multiple of a full command: numbers beyond are no effort, or pulses with other widths."""


@dataclass(frozen=True)
class PWM:
    """Map from pulse widths to the effort of a motor controller.

    Below ``stop`` the effort is scaled by ``reverse``, which by default is as far from the stop as
    ``full``. A width of zero means no pulse, as an autopilot logs while disarmed: the motor stands
    still.

    Args:
        stop: width at which the motor stands, such as 1500.
        full: width at full effort ahead, such as 1900; below ``stop`` where the channel is
            reversed.
        reverse: width at full effort astern, such as 1100.

    Example:
        >>> widths = dft.logs.PWM(stop=1500, full=1900)
        >>> dft.logs.PWM.of({"stop": 1500, "full": 1900}, "fit.toml") == widths
        True
        >>> widths.effort([1500, 1700, 1100, 0]), widths.widths([0.5]), widths.astern
        (array([ 0. ,  0.5, -1. ,  0. ]), array([1700.]), 1100)
    """

    stop: float
    full: float
    reverse: float | None = None

    @classmethod
    def of(cls, widths: Any, place: Place | str) -> PWM:
        """The widths that a user gave, as a `PWM` or a mapping.

        Raises:
            InputError: a width is missing, unknown or not a number, or two widths coincide.
        """
        if not isinstance(widths, PWM):
            names = [f.name for f in fields(cls)]
            example = "write pwm = {'stop': 1500, 'full': 1900}."
            if not isinstance(widths, Mapping) or not {"stop", "full"} <= set(widths):
                raise InputError.at(
                    place, f"expected pwm with a stop and a full width, found {widths!r}.", example
                )
            for key in widths:
                if key not in names:
                    near = nearest(str(key), names, "; ")
                    raise InputError.at(
                        place, f"pwm knows {listing(names)}, found {key!r}{near}.", example
                    )
            widths = cls(**widths)
        numbers = {}
        for name, width in vars(widths).items():
            if width is None and name == "reverse":
                continue
            # Python's own numbers: a np.uint16 of 1100 minus 1500 is 65136.
            number = width.item() if isinstance(width, np.number) else width
            if isinstance(number, bool) or not is_finite(number):
                raise InputError.at(
                    place, f"expected a width of pulses, found {width!r}.", "write it as in 1500."
                )
            numbers[name] = number
        widths = cls(**numbers)
        ahead, astern = widths.full - widths.stop, widths.astern - widths.stop
        if ahead == 0 or ahead * astern >= 0:
            raise InputError.at(
                place,
                f"expected the stop ({widths.stop:g}) between full ahead ({widths.full:g}) and "
                f"full astern ({widths.astern:g}).",
                "correct the widths; reverse may be left out where it is as far from the stop.",
            )
        return widths

    @property
    def astern(self) -> float:
        """The width at full effort astern."""
        return 2 * self.stop - self.full if self.reverse is None else self.reverse

    def effort(self, widths: Any) -> np.ndarray:
        """The effort of each width: 1 at full ahead, -1 at full astern, 0 without a pulse."""
        beyond = np.asarray(widths, np.float64) - self.stop
        ahead = beyond * (self.full - self.stop) >= 0
        # Thrusters are often trimmed unequally: 1500 to 1900 ahead, 1500 to 1100 or less astern.
        effort = beyond / np.where(ahead, self.full - self.stop, self.stop - self.astern)
        return np.where(np.asarray(widths) == 0, 0.0, effort)

    def widths(self, effort: Any) -> np.ndarray:
        """The width of each effort."""
        effort = np.asarray(effort, np.float64)
        span = np.where(effort >= 0, self.full - self.stop, self.stop - self.astern)
        return self.stop + effort * span

    def read(self, widths: np.ndarray, place: Place) -> tuple[np.ndarray, str | None]:
        """The efforts of recorded widths, and a note on samples without a pulse.

        Raises:
            InputError: widths that do not fit this map.
        """
        effort = self.effort(widths)
        furthest = np.nanmax(np.abs(effort), initial=0.0)
        if not furthest <= FURTHEST:
            raise InputError.at(
                place,
                f"expected widths of pulses around {self.stop:g}, found numbers from "
                f"{np.nanmin(widths):g} to {np.nanmax(widths):g}.",
                "choose the column with the widths, or correct stop and full.",
            )
        silent = int(np.sum(np.asarray(widths) == 0))
        if not silent:
            return effort, None
        return effort, f"{place}: {silent} samples have no pulse (0) and count as the stop."


@dataclass(frozen=True)
class Written:
    """How the user wrote a channel, and the conversion back to it.

    Args:
        unit: the unit to read the channel in; empty where none was given.
        column: the column that it came from; empty without a file.
        pwm: what its widths of pulses mean, where it was one.
        scale: what the numbers of the column were multiplied by.

    Example:
        >>> dft.logs.Written("rpm").values([1.0], "rev/s", "channel 'propeller_speed'")
        array([60.])
        >>> dft.logs.Written("rpm").width(1.0, "rev/s", "channel 'propeller_speed'")
        60.0
    """

    unit: str = ""
    column: str = ""
    pwm: PWM | None = None
    scale: float = 1.0

    def values(self, numbers: Any, unit: str, where: Place | str) -> np.ndarray:
        """Convert numbers of this channel from ``unit`` to the user's notation."""
        if self.pwm is not None:
            return self.pwm.widths(numbers)
        return convert(numbers, self._share(unit), self.unit, where=where)

    def width(self, number: float, unit: str, where: Place | str) -> float:
        """Convert a difference of two numbers, such as an error, to the user's notation."""
        if self.pwm is not None:
            return number * abs(self.pwm.full - self.pwm.stop)
        return convert_scale(number, self._share(unit), self.unit, where=where)

    def _share(self, unit: str) -> str:
        # Before it was declared as an effort, the column held plain numbers or per cent.
        return "dimensionless" if unit == "effort" else unit


class Size(NamedTuple):
    """A number with its unit, as shown to the user."""

    value: float
    unit: str


class ShownUnits:
    """The units in which results are shown: those in which the logs were written.

    If logs wrote a channel in several units, that of the first log.

    Args:
        logs: how each channel was written, of every log.

    Example:
        >>> units = ShownUnits(log.written for log in logs)
        >>> units.unit("speed", "rad/s")
        'rpm'
    """

    def __init__(self, logs: Iterable[Mapping[str, Written]] = ()) -> None:
        self.written: dict[str, Written] = {}
        for channels in logs:
            for name, way in channels.items():
                if way.unit:
                    self.written.setdefault(name, way)

    def _way(self, channel: str, unit: str) -> Written | None:
        way = self.written.get(channel)
        return None if way is None or not unit or way.unit == unit else way

    def unit(self, channel: str, unit: str) -> str:
        """The unit in which a channel with numbers in ``unit`` is shown."""
        way = self._way(channel, unit)
        return unit if way is None else way.unit

    def values(self, channel: str, numbers: Any, unit: str) -> np.ndarray:
        """Convert numbers of a channel from ``unit`` to the shown unit."""
        way = self._way(channel, unit)
        plain = np.asarray(numbers, np.float64)
        return plain if way is None else way.values(plain, unit, f"channel {channel!r}")

    def size(self, channel: str, number: float, unit: str) -> Size:
        """Convert a difference of two numbers of a channel to the shown unit.

        Quantities counted from the stop, such as an effort or a dead band, are differences too.
        """
        way = self._way(channel, unit)
        if way is None:
            return Size(number, unit)
        return Size(way.width(number, unit, f"channel {channel!r}"), way.unit)
