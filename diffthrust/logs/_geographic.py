"""Latitude and longitude as metres to the north and to the east of the first fix."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.logs._units import convert, convert_scale, same_quantity
from diffthrust.logs._validate import PlaceOf

if TYPE_CHECKING:
    from diffthrust.logs._columns import Column

_EQUATORIAL_RADIUS = 6_378_137.0  # m, WGS 84
_ECCENTRICITY_SQUARED = 6.694_379_990_14e-3  # of the ellipsoid of WGS 84


def positions_of_fixes(
    columns: Mapping[str, Column], values: Mapping[str, np.ndarray], at: PlaceOf
) -> tuple[dict[str, Column], dict[str, np.ndarray], tuple[str, ...]]:
    """Channels ``north`` and ``east``, where they are written as angles, in metres.

    The plane touches the ellipsoid at the first fix, with its two radii of curvature: within 1 cm
    at 1 km, and 1 m at 10 km.

    Args:
        columns: the column of each channel.
        values: its numbers as the file has them, ``(n,)``.
        at: names a place of the file for a message.

    Returns:
        The same, with these two channels in metres, and a note where they were converted.

    Raises:
        InputError: one of the two is an angle and the other is not, or a latitude is beyond a pole.
    """
    angles = [name for name in ("north", "east") if name in columns and _angle(columns[name])]
    if not angles:
        return dict(columns), dict(values), ()
    if len(angles) < 2:
        partner = "east" if angles == ["north"] else "north"
        raise InputError.at(
            at(angles[0], None),
            f"{angles[0]!r} is an angle, so a latitude or longitude, and {partner!r} is none.",
            "name both columns, the latitude as north and the longitude as east, with their unit.",
        )
    latitude, longitude = (_radians(columns[name], values[name], at, name) for name in angles)
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
    scales = {"north": to_north, "east": to_east}
    metres = {"north": to_north * (latitude - latitude[first]), "east": to_east * eastward}
    plain = {name: np.where(fixed, numbers, np.nan) for name, numbers in metres.items()}
    at_first = f"{np.rad2deg(latitude[first]):.7f}, {np.rad2deg(longitude[first]):.7f} degrees"
    return (
        {**columns, **{name: _in_metres(columns[name], scales[name], at) for name in angles}},
        {**values, **plain},
        (f"north and east are in metres from the first fix, at {at_first}.",),
    )


def _angle(column: Column) -> bool:
    return bool(column.kept_unit) and same_quantity(column.kept_unit, "rad")


def _radians(column: Column, values: np.ndarray, at: PlaceOf, channel: str) -> np.ndarray:
    written = values * float(column.scale) + float(column.offset)
    return convert(written, column.unit, "rad", where=at(channel, None))


def _in_metres(column: Column, scale: float, at: PlaceOf) -> Column:
    noise = column.noise
    if noise is not None:
        noise = scale * convert_scale(noise, column.unit, "rad", where=at("north", None))
    return replace(column, unit="m", scale=1.0, offset=0.0, noise=noise)


def _metres_per_radian(latitude: float) -> tuple[float, float]:
    """Radii by which a small change of latitude and of longitude [rad] become metres."""
    flattened = 1.0 - _ECCENTRICITY_SQUARED * np.sin(latitude) ** 2
    meridian = _EQUATORIAL_RADIUS * (1.0 - _ECCENTRICITY_SQUARED) / flattened**1.5
    parallel = _EQUATORIAL_RADIUS / flattened**0.5 * np.cos(latitude)
    return float(meridian), float(parallel)
