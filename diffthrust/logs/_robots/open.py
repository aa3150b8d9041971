"""Robots' logs, opened by their kind."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from diffthrust._support.errors import InputError
from diffthrust.logs._field import Field
from diffthrust.logs._kinds import BAG, BAG_1, DATAFLASH, MCAP, TELEMETRY, ULOG, Kind
from diffthrust.logs._largest import Room
from diffthrust.logs._robots.ardupilot import read_ardupilot
from diffthrust.logs._robots.ardupilot_fields import dataflash_fields, telemetry_fields
from diffthrust.logs._robots.gathered import fields_of
from diffthrust.logs._robots.rosbag import read_bag
from diffthrust.logs._robots.rosbag_fields import bag_fields
from diffthrust.logs._robots.series import Series
from diffthrust.logs._robots.ulog import read_ulog, ulog_fields


def series_in(
    path: Path, kind: Kind, wanted: Sequence[str], header: bool, missing: Sequence[float]
) -> dict[str, Series]:
    """What the wanted fields of a robot's log held.

    Args:
        path: the file or folder.
        kind: of it.
        wanted: names of the fields.
        header: take the stamp of the message's header where it has one (ROS).
        missing: numbers that mean missing.

    Raises:
        InputError: the file is damaged, or a field is absent or holds no numbers.
    """
    _check_file(path, kind)
    if kind in (DATAFLASH, TELEMETRY, ULOG):
        if header:
            raise InputError(
                f"{path.name}: stamps of headers are known in ROS bags only.",
                "leave stamps at 'recorder'.",
            )
        if kind is ULOG:
            return read_ulog(path, wanted, missing)
        return read_ardupilot(path, kind is DATAFLASH, wanted, missing)
    return read_bag(path, wanted, header, missing)


def all_fields(path: Path, kind: Kind) -> tuple[tuple[Field, ...], tuple[str, ...]]:
    """All numbers of a robot's log, and sentences on what is damaged or left out.

    Raises:
        InputError: the file cannot be read at all.
    """
    _check_file(path, kind)
    read = {DATAFLASH: dataflash_fields, TELEMETRY: telemetry_fields, ULOG: ulog_fields}
    gathered, notes = read.get(kind, bag_fields)(path)
    fields, more = fields_of(gathered)
    if not fields:
        raise InputError(
            f"{path.name}: expected messages with numbers, found none.",
            "check that the recording was saved.",
        )
    return fields, (*notes, *more)


def _check_file(path: Path, kind: Kind) -> None:
    """Raise InputError for a file that is too large, or a bag whose name its reader refuses."""
    if kind in (DATAFLASH, TELEMETRY, ULOG):  # which are read whole
        Room(path).take(path.stat().st_size)
    bag = path.is_file() and kind in (BAG, BAG_1, MCAP)
    if bag and path.suffix.lower() not in kind.endings:
        raise InputError(
            f"{path.name}: found {kind.article}, expected a name that ends in {kind.endings[0]}.",
            f"rename it to {path.with_suffix(kind.endings[0]).name!r}.",
        )
