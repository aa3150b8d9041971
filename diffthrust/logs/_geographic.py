"""Latitude and longitude as metres to the north and to the east of the first fix."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.logs._validate import PlaceOf

_EQUATORIAL_RADIUS = 6_378_137.0  # m, WGS 84
_ECCENTRICITY_SQUARED = 6.694_379_990_14e-3  # of the ellipsoid of WGS 84


class Positions(NamedTuple):
    """North and east of the first fix [m], ``(n,)``; metres per radian of each; a note."""

    metres: dict[str, np.ndarray]
    scales: dict[str, float]
    note: str


def positions_of_fixes(latitude: np.ndarray, longitude: np.ndarray, at: PlaceOf) -> Positions:
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
    return Positions(
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
