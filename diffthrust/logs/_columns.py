"""How columns of a file become the channels of a log."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError, Place
from diffthrust.logs._units import convert, convert_scale, is_finite, same_quantity
from diffthrust.logs._validate import PlaceOf, check_hold, checked_fields
from diffthrust.logs._written import FURTHEST, PWM, Written

_SHARES = ("", "%", "percent", "pct", "dimensionless", "1", "effort")


@dataclass(frozen=True)
class Column:
    """How a column of a file becomes a channel of a log.

    Args:
        column: name of the column, exactly as in the file; in a MATLAB struct as ``a.b``, in a
            robot's log as ``MESSAGE.FIELD``.
        unit: unit in which the column is written; empty where it is the model's unit. A ``north``
            and an ``east`` in deg are a latitude and a longitude, and become metres from the first
            fix.
        unsigned: the sensor reports the absolute value.
        noise: known standard deviation, in the unit of the column.
        hold: for an input, ``"zero"`` (keeps its last value) or ``"linear"``.
        scale: multiplies the numbers, such as -1 for a sensor that is mounted backward.
        offset: added after scaling; the result is in ``unit``.
        pwm: the numbers are widths of pulses: ``{"stop": 1500, "full": 1900}``, and ``"reverse"``
            where full astern is at another distance from the stop. They become an effort, 1 at
            full; those of a servo become an angle by ``scale=35, unit="deg"``, the angle at full.
        effort: the numbers are a share of the full effort: 1 (or 100 with ``unit="%"``) at full.
        dates: for the time, the format of dates that do not begin with the year, in the notation
            of Python's ``strptime``: ``"%d.%m.%Y %H:%M:%S"``.
        rails: where the range of the sensor ends, ``(low, high)`` in ``unit``, as in `Log`.
        censored: samples at a rail count as "at least" or "at most" it, as in `Log`.

    Example:
        >>> dft.Column("rpm", unit="rpm", unsigned=True).scale
        1.0
    """

    column: str
    unit: str = ""
    unsigned: bool = False
    noise: float | None = None
    hold: str = "zero"
    scale: float = 1.0
    offset: float = 0.0
    pwm: PWM | Mapping[str, float] | None = None
    effort: bool = False
    dates: str = ""
    rails: Sequence[float] | None = None
    censored: bool = False

    @property
    def kept_unit(self) -> str:
        """The unit of the numbers after reading; an effort has its own unit.

        Example:
            >>> dft.Column("RCOU.C1", pwm={"stop": 1500, "full": 1900}).kept_unit
            'effort'
        """
        # A width stays an effort only while its unit is a time: with unit="deg" and a scale it is a
        # servo's angle, which has that unit.
        pulses = self.pwm is not None and self.unit in ("", "us", "ms", "s")
        return "effort" if pulses or self.effort else self.unit

    def checked(self, place: Place) -> "Column":
        """The checked column, its widths of pulses as a `PWM`.

        Raises:
            InputError: a field is invalid.

        Example:
            >>> dft.Column("rpm", unit="rpm").checked("fit.toml").unit
            'rpm'
        """
        problem = mend = ""
        if not is_finite(self.scale) or self.scale == 0:
            problem = f"expected a scale other than zero, found {self.scale!r}."
            mend = "give the factor that multiplies the numbers."
        elif not is_finite(self.offset):
            problem = f"expected a finite offset, found {self.offset!r}."
            mend = "give the number to add once the numbers are scaled."
        elif self.effort and self.unit not in _SHARES:
            problem = (
                f"expected an effort as a share of the full one, found the unit {self.unit!r}."
            )
            mend = "write unit='%' or leave the unit out; scale brings other numbers to 1 at full, "
            mend += "and widths of pulses are declared by pwm."
        if problem:
            raise InputError.at(place, problem, mend)
        check_hold(self.hold, place)
        if self.effort and self.pwm is not None:
            problem = "expected pwm or effort, found both."
            raise InputError.at(place, problem, "leave effort out: pwm implies it.")
        return self if self.pwm is None else replace(self, pwm=PWM.of(self.pwm, place))

    def read(self, numbers: np.ndarray, place: Place) -> tuple[np.ndarray, Written, str | None]:
        """Convert numbers of a file to those of the channel, in `kept_unit`.

        Returns:
            The numbers, how the user wrote them, and a sentence to keep with the log, or None.

        Raises:
            InputError: widths of pulses out of range.

        Example:
            >>> dft.Column("u", unit="V", scale=0.1).read(np.array([10.0, 20.0]), "run1.csv")
            (array([1., 2.]), Written(unit='V', column='u', pwm=None, scale=0.1), None)
        """
        note = None
        if isinstance(self.pwm, PWM):
            numbers, note = self.pwm.read(numbers, place)
        # A wrong scale may overflow; `checked_fields` then reports the infinite number with its
        # place.
        with np.errstate(all="ignore"):
            numbers = numbers * float(self.scale) + float(self.offset)
        if self.effort and self.unit not in ("", "effort"):
            numbers = convert(numbers, self.unit, "dimensionless", where=place)
        if self.kept_unit == "effort":
            _check_effort(numbers, place)
        return numbers, self.written, note

    @property
    def written(self) -> Written:
        """How the user writes the channel, of a checked column.

        Example:
            >>> dft.Column("thrust_kgf", unit="kgf").written.unit
            'kgf'
        """
        plain = (self.scale, self.offset) == (1.0, 0.0)
        if isinstance(self.pwm, PWM) and self.kept_unit == "effort" and plain:
            return Written(self.unit or "us", self.column, self.pwm)
        return Written(self.unit or self.kept_unit, self.column, scale=float(self.scale))


def _check_effort(numbers: np.ndarray, place: Place) -> None:
    """Raise InputError for numbers that are far beyond a full command."""
    finite = numbers[np.isfinite(numbers)]
    low, high = np.min(finite, initial=0.0), np.max(finite, initial=0.0)
    if max(-low, high) <= FURTHEST:
        return
    # The widest pulses that servos and ESCs take [us]: numbers of this size are pulses by mistake.
    pulses = 700 <= high <= 2300
    raise InputError.at(
        place,
        f"expected an effort, 1 at the full command, found numbers from {np.min(finite):g} to "
        f"{high:g}.",
        "these look like widths of pulses: declare them by pwm = {'stop': 1500, 'full': 1900}."
        if pulses
        else "give the scale that brings the full command to 1, such as scale=0.01 of per cent.",
    )


def channel_columns(
    file: str,
    inputs: Mapping[str, str | Column] | None,
    measured: Mapping[str, str | Column] | None,
) -> tuple[dict[str, Column], dict[str, Column]]:
    """The column of each input and of each measured channel."""
    driving, sensed = each_column(inputs, file, "inputs"), each_column(measured, file, "measured")
    twice = sorted(driving.keys() & sensed.keys())
    twice += {"time"} & (driving.keys() | sensed.keys())
    if twice:
        raise InputError.at(
            Place(file, channel=twice[0]),
            f"the channel {twice[0]!r} is named twice, expected once among time, inputs and "
            "measured.",
            "give it under one of them.",
        )
    if not driving and not sensed:
        raise InputError(
            f"{file}: expected the columns to read, found none named.",
            "name at least one input or measured channel.",
        )
    return driving, sensed


def each_column(
    channels: Mapping[str, str | Column] | None, file: str, what: str
) -> dict[str, Column]:
    """The column of each channel of one kind; ``what`` names the argument for the message."""
    columns = {}
    for key, column in (channels or {}).items():
        column = Column(column) if isinstance(column, str) else column
        place = Place(f"{file}, channel {key!r}", channel=key)
        if not isinstance(column, Column) or not isinstance(column.column, str):
            problem = f"expected the name of a column or a Column, found {column!r}."
            mend = f"write {what} = {{{key!r}: 'name of the column'}}."
            raise InputError.at(place, problem, mend)
        if column.dates and key != "time":
            raise InputError.at(
                place,
                f"expected a format of dates for the time only, found dates = {column.dates!r}.",
                "leave dates out, or give it with the time.",
            )
        columns[key] = column.checked(place)
    return columns


def fields_of_columns(
    inputs: Mapping[str, Column],
    measured: Mapping[str, Column],
    *,
    time: np.ndarray,
    values: Mapping[str, np.ndarray],
    name: str,
    interpolate_inputs: bool,
    notes: Iterable[str],
    static: bool,
    at: PlaceOf,
) -> dict[str, Any]:
    """The fields of a log, from the numbers of each channel as the file has them, ``(n,)``.

    Time stamps are in seconds; ``at`` names places of the file for messages.
    """
    columns, values, moved = _from_fixes({**inputs, **measured}, values, at)
    read = {key: column.read(values[key], at(key, None)) for key, column in columns.items()}
    scaled = {key: numbers for key, (numbers, _, _) in read.items()}
    return checked_fields(
        time=time,
        inputs={key: scaled[key] for key in inputs},
        measured={key: scaled[key] for key in measured},
        units={key: column.kept_unit for key, column in columns.items()},
        unsigned=[key for key in measured if columns[key].unsigned],
        noise={key: columns[key].noise for key in measured},
        hold={key: columns[key].hold for key in inputs},
        name=name,
        interpolate_inputs=interpolate_inputs,
        notes=(*notes, *moved, *(note for _, _, note in read.values() if note)),
        written={key: written for key, (_, written, _) in read.items()},
        rails={key: columns[key].rails for key in measured},
        censored=[key for key in measured if columns[key].censored],
        static=static,
        at=at,
    )


_EQUATORIAL_RADIUS = 6_378_137.0  # m, WGS 84
_ECCENTRICITY_SQUARED = 6.694_379_990_14e-3  # of the ellipsoid of WGS 84


def _from_fixes(
    columns: Mapping[str, Column], values: Mapping[str, np.ndarray], at: PlaceOf
) -> tuple[Mapping[str, Column], Mapping[str, np.ndarray], list[str]]:
    """Columns and numbers with ``north`` and ``east`` in metres, and a note if they were angles.

    Those of a sensor, ``gps.north`` and ``gps.east``, as well.
    """
    columns, values, notes = dict(columns), dict(values), []
    for scope in dict.fromkeys(n.rpartition(".")[0] for n in columns if "." in n) | {"": None}:
        names = [f"{scope}{'.' * bool(scope)}{side}" for side in ("north", "east")]
        units = {n: columns[n].kept_unit for n in names if n in columns}
        angles = [n for n, unit in units.items() if unit and same_quantity(unit, "rad")]
        if not angles:
            continue
        if len(angles) < 2:
            (partner,) = set(names) - set(angles)
            raise InputError.at(
                at(angles[0], None),
                f"{angles[0]!r} is an angle, so a latitude or longitude, and {partner!r} is none.",
                "name both columns, the latitude as north and the longitude as east, with their "
                "unit.",
            )
        latitude, longitude = (_radians(columns[n], values[n], at(n, None)) for n in names)
        first, *metres = _metres_from_first(latitude, longitude, names[0], at)
        for name, series, radius in zip(names, metres, _radii(first[0]), strict=True):
            noise, unit = columns[name].noise, columns[name].unit
            if noise is not None:
                noise = radius * convert_scale(noise, unit, "rad", where=at(name, None))
            columns[name] = replace(columns[name], unit="m", scale=1.0, offset=0.0, noise=noise)
            values[name] = series
        place = ", ".join(f"{angle:.7f}" for angle in np.rad2deg(first))
        notes.append(
            f"{names[0]} and {names[1]} are in metres from the first fix, at {place} degrees."
        )
    return columns, values, notes


def _radians(column: Column, numbers: np.ndarray, place: Place) -> np.ndarray:
    scaled = numbers * float(column.scale) + float(column.offset)
    return convert(scaled, column.unit, "rad", where=place)


def _metres_from_first(
    latitude: np.ndarray, longitude: np.ndarray, north: str, at: PlaceOf
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The first fix [rad], and metres to its north and east, of fixes [rad], ``(n,)`` each.

    The plane touches the ellipsoid at the first fix, with its two radii of curvature: within 1 cm
    at 1 km, and 1 m at 10 km.
    """
    beyond = np.flatnonzero(np.abs(latitude) > np.pi / 2)
    if beyond.size:
        raise InputError.at(
            at(north, int(beyond[0])),
            f"expected a latitude of -90 to 90 degrees, found {np.rad2deg(latitude[beyond[0]]):g}.",
            "exchange the two columns, or correct their unit or scale.",
        )
    # A receiver without a fix writes zeros, which would be the first fix, in the Gulf of Guinea.
    fixed = np.isfinite(latitude) & np.isfinite(longitude) & ((latitude != 0) | (longitude != 0))
    if not fixed.any():
        raise InputError.at(
            at(north, None), "expected fixes, found none.", "leave north and east out."
        )
    first = np.array([latitude, longitude])[:, np.argmax(fixed)]
    to_north, to_east = _radii(first[0])
    eastward = (longitude - first[1] + np.pi) % (2 * np.pi) - np.pi  # across 180 degrees
    metres = to_north * (latitude - first[0]), to_east * eastward
    return first, np.where(fixed, metres[0], np.nan), np.where(fixed, metres[1], np.nan)


def _radii(latitude: float) -> tuple[float, float]:
    """Radii by which a small change of latitude and of longitude [rad] become metres."""
    flattened = 1.0 - _ECCENTRICITY_SQUARED * np.sin(latitude) ** 2
    meridian = _EQUATORIAL_RADIUS * (1.0 - _ECCENTRICITY_SQUARED) / flattened**1.5
    parallel = _EQUATORIAL_RADIUS / flattened**0.5 * np.cos(latitude)
    return float(meridian), float(parallel)
