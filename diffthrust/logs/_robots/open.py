"""Open robots' logs, by format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from diffthrust._support.errors import InputError
from diffthrust.logs._field import Field
from diffthrust.logs._kinds import BAG, BAG_1, DATAFLASH, MCAP, TELEMETRY, ULOG, Kind
from diffthrust.logs._largest import MemoryBudget
from diffthrust.logs._robots.ardupilot import dataflash_fields, read_ardupilot, telemetry_fields
from diffthrust.logs._robots.gathered import fields_of
from diffthrust.logs._robots.rosbag import bag_fields, read_bag
from diffthrust.logs._robots.series import Series
from diffthrust.logs._robots.ulog import read_ulog, ulog_fields


def series_in(
    path: Path, kind: Kind, wanted: Sequence[str], header: bool, missing: Sequence[float]
) -> dict[str, Series]:
    """The samples of the wanted fields of a robot's log.

    With ``header`` by the stamp of the message's header if it has one (ROS); ``missing`` are
    numbers that mean missing.
    """
    _check_file(path, kind)
    if kind in (DATAFLASH, TELEMETRY, ULOG):
        if header:
            raise InputError(
                f"{path.name}: only ROS bags have stamps in headers.",
                "leave stamps at 'recorder'.",
            )
        if kind is ULOG:
            return read_ulog(path, wanted, missing)
        return read_ardupilot(path, kind is DATAFLASH, wanted, missing)
    return read_bag(path, wanted, header, missing)


def all_fields(
    path: Path, kind: Kind
) -> tuple[tuple[Field, ...], tuple[str, ...], Mapping[str, float]]:
    """All numbers of a robot's log, notes on what is damaged or left out, and its parameters."""
    _check_file(path, kind)
    read = {DATAFLASH: dataflash_fields, TELEMETRY: telemetry_fields, ULOG: ulog_fields}
    gathered, notes, parameters = read.get(kind, bag_fields)(path)
    fields, more = fields_of(gathered)
    if not fields:
        raise InputError(
            f"{path.name}: expected messages with numbers, found none.",
            "check that the recording was saved.",
        )
    return fields, (*notes, *more), parameters


def _check_file(path: Path, kind: Kind) -> None:
    """Raise InputError for a file that is too large, or a bag with the wrong suffix."""
    if kind in (DATAFLASH, TELEMETRY, ULOG):  # these are read into memory at once
        MemoryBudget(path).take(path.stat().st_size)
    bag = path.is_file() and kind in (BAG, BAG_1, MCAP)
    if bag and path.suffix.lower() not in kind.endings:
        raise InputError(
            f"{path.name}: found {kind.article}, expected a name that ends in {kind.endings[0]}.",
            f"rename it to {path.with_suffix(kind.endings[0]).name!r}.",
        )
