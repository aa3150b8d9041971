"""How columns of a file become the channels of a log."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from diffthrust._support.errors import InputError, Place
from diffthrust.logs._units import convert, convert_scale, same_quantity
from diffthrust.logs._validate import PlaceOf, check_hold, checked_fields, is_finite
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
        if not is_finite(self.scale) or self.scale == 0:
            raise InputError.at(
                place,
                f"expected a scale other than zero, found {self.scale!r}.",
                "give the factor that multiplies the numbers.",
            )
        if not is_finite(self.offset):
            raise InputError.at(
                place,
                f"expected a finite offset, found {self.offset!r}.",
                "give the number to add once the numbers are scaled.",
            )
        if self.effort and self.unit not in _SHARES:
            raise InputError.at(
                place,
                f"expected an effort as a share of the full one, found the unit {self.unit!r}.",
                "write unit='%' or leave the unit out; scale brings other numbers to 1 at full, "
                "and widths of pulses are declared by pwm.",
            )
        check_hold(self.hold, place)
        if self.pwm is None:
            return self
        if self.effort:
            raise InputError.at(
                place, "expected pwm or effort, found both.", "leave effort out: pwm implies it."
            )
        return replace(self, pwm=PWM.of(self.pwm, place))

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
    file: Path,
    inputs: Mapping[str, str | Column] | None,
    measured: Mapping[str, str | Column] | None,
) -> dict[str, Column]:
    """The column of each channel."""
    columns = {
        **each_column(inputs, file, "inputs"),
        **each_column(measured, file, "measured"),
    }
    both = set(inputs or {}) & set(measured or {})
    if both or "time" in columns:
        channel = sorted(both)[0] if both else "time"
        raise InputError.at(
            Place(file.name, channel=channel),
            f"the channel {channel!r} is named twice, expected once among time, inputs and "
            "measured.",
            "give it under one of them.",
        )
    if not columns:
        raise InputError(
            f"{file.name}: expected the columns to read, found none named.",
            "name at least one input or measured channel.",
        )
    return columns


def each_column(
    channels: Mapping[str, str | Column] | None, file: Path, what: str
) -> dict[str, Column]:
    """The column of each channel of one kind; ``what`` names the argument for the message."""
    columns = {}
    for key, column in (channels or {}).items():
        column = Column(column) if isinstance(column, str) else column
        place = Place(f"{file.name}, channel {key!r}", channel=key)
        if not isinstance(column, Column) or not isinstance(column.column, str):
            raise InputError.at(
                place,
                f"expected the name of a column or a Column, found {column!r}.",
                f"write {what} = {{{key!r}: 'name of the column'}}.",
            )
        if column.dates and key != "time":
            raise InputError.at(
                place,
                f"expected a format of dates for the time only, found dates = {column.dates!r}.",
                "leave dates out, or give it with the time.",
            )
        columns[key] = column.checked(place)
    return columns


def fields_of_columns(
    columns: Mapping[str, Column],
    inputs: Collection[str],
    measured: Collection[str],
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
    columns, values, moved = _from_fixes(columns, values, at)
    read = {key: column.read(values[key], at(key, None)) for key, column in columns.items()}
    scaled = {key: numbers for key, (numbers, _, _) in read.items()}
    return checked_fields(
        time=time,
        inputs={key: scaled[key] for key in inputs},
        measured={key: scaled[key] for key in measured},
        units={key: column.kept_unit for key, column in columns.items()},
        unsigned=[key for key in measured if columns[key].unsigned],
        noise={key: sigma for key in measured if (sigma := columns[key].noise) is not None},
        hold={key: columns[key].hold for key in inputs},
        name=name,
        interpolate_inputs=interpolate_inputs,
        notes=(*notes, *moved, *(note for _, _, note in read.values() if note)),
        written={key: written for key, (_, written, _) in read.items()},
        rails={key: ends for key in measured if (ends := columns[key].rails) is not None},
        censored=[key for key in measured if columns[key].censored],
        static=static,
        at=at,
    )


def _from_fixes(
    columns: Mapping[str, Column], values: Mapping[str, np.ndarray], at: PlaceOf
) -> tuple[Mapping[str, Column], Mapping[str, np.ndarray], tuple[str, ...]]:
    """Columns and numbers with ``north`` and ``east`` in metres, and a note if they were angles.

    Those of a sensor, ``gps.north`` and ``gps.east``, as well.
    """
    notes: tuple[str, ...] = ()
    for scope in dict.fromkeys(n.rpartition(".")[0] for n in columns if "." in n) | {"": None}:
        columns, values, note = _of_receiver(f"{scope}." * bool(scope), columns, values, at)
        notes += note
    return columns, values, notes


def _of_receiver(
    scope: str, columns: Mapping[str, Column], values: Mapping[str, np.ndarray], at: PlaceOf
) -> tuple[Mapping[str, Column], Mapping[str, np.ndarray], tuple[str, ...]]:
    """The same of the two channels whose names begin with ``scope``."""
    place = [name for name in (f"{scope}north", f"{scope}east") if name in columns]
    angles = [n for n in place if (u := columns[n].kept_unit) and same_quantity(u, "rad")]
    if not angles:
        return columns, values, ()
    if len(angles) < 2:
        partner = f"{scope}east" if angles == [f"{scope}north"] else f"{scope}north"
        raise InputError.at(
            at(angles[0], None),
            f"{angles[0]!r} is an angle, so a latitude or longitude, and {partner!r} is none.",
            "name both columns, the latitude as north and the longitude as east, with their unit.",
        )
    written = {n: values[n] * float(columns[n].scale) + float(columns[n].offset) for n in angles}
    latitude, longitude = (
        convert(written[n], columns[n].unit, "rad", where=at(n, None)) for n in angles
    )
    fixes = _positions_of_fixes(latitude, longitude, lambda n, i: at(scope + n, i))
    metres = {scope + n: series for n, series in fixes.metres.items()}
    scales = {scope + n: scale for n, scale in fixes.scales.items()}
    plain = {}
    for name in angles:
        noise, unit = columns[name].noise, columns[name].unit
        if noise is not None:
            noise = scales[name] * convert_scale(noise, unit, "rad", where=at(name, None))
        plain[name] = replace(columns[name], unit="m", scale=1.0, offset=0.0, noise=noise)
    note = fixes.note.replace("north and east", f"{scope}north and {scope}east")
    return {**columns, **plain}, {**values, **metres}, (note,)


_EQUATORIAL_RADIUS = 6_378_137.0  # m, WGS 84
_ECCENTRICITY_SQUARED = 6.694_379_990_14e-3  # of the ellipsoid of WGS 84


class _Positions(NamedTuple):
    """North and east of the first fix [m], ``(n,)``; metres per radian of each; a note."""

    metres: dict[str, np.ndarray]
    scales: dict[str, float]
    note: str


def _positions_of_fixes(latitude: np.ndarray, longitude: np.ndarray, at: PlaceOf) -> _Positions:
    """Metres from the first fix, of latitudes and longitudes [rad], ``(n,)`` each.

    The plane touches the ellipsoid at the first fix, with its two radii of curvature: within 1 cm
    at 1 km, and 1 m at 10 km.
    """
    beyond = np.flatnonzero(np.abs(latitude) > np.pi / 2)
    if beyond.size:
        raise InputError.at(
            at("north", int(beyond[0])),
            f"expected a latitude of -90 to 90 degrees, found {np.rad2deg(latitude[beyond[0]]):g}.",
            "exchange the two columns, or correct their unit or scale.",
        )
    # A receiver without a fix writes zeros, which would be the first fix, in the Gulf of Guinea.
    fixed = np.isfinite(latitude) & np.isfinite(longitude) & ((latitude != 0) | (longitude != 0))
    if not fixed.any():
        raise InputError.at(
            at("north", None), "expected fixes, found none.", "leave north and east out."
        )
    first = int(np.flatnonzero(fixed)[0])
    to_north, to_east = _metres_per_radian(latitude[first])
    eastward = (longitude - longitude[first] + np.pi) % (2 * np.pi) - np.pi  # across 180 degrees
    north = np.where(fixed, to_north * (latitude - latitude[first]), np.nan)
    east = np.where(fixed, to_east * eastward, np.nan)
    place = f"{np.rad2deg(latitude[first]):.7f}, {np.rad2deg(longitude[first]):.7f} degrees"
    return _Positions(
        {"north": north, "east": east},
        {"north": to_north, "east": to_east},
        f"north and east are in metres from the first fix, at {place}.",
    )


def _metres_per_radian(latitude: float) -> tuple[float, float]:
    """Radii by which a small change of latitude and of longitude [rad] become metres."""
    flattened = 1.0 - _ECCENTRICITY_SQUARED * np.sin(latitude) ** 2
    meridian = _EQUATORIAL_RADIUS * (1.0 - _ECCENTRICITY_SQUARED) / flattened**1.5
    parallel = _EQUATORIAL_RADIUS / flattened**0.5 * np.cos(latitude)
    return float(meridian), float(parallel)
