"""Open robots' logs, by format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from diffthrust._support.errors import InputError
from diffthrust.logs._field import Field
from diffthrust.logs._kinds import BAG, BAG_1, DATAFLASH, MCAP, TELEMETRY, ULOG, Kind
from diffthrust.logs._largest import MemoryBudget
from diffthrust.logs._robots.dataflash import read_dataflash
from diffthrust.logs._robots.messages import Reader, fields_of, wanted_series
from diffthrust.logs._robots.rosbag import bag_fields, read_bag
from diffthrust.logs._robots.series import Series
from diffthrust.logs._robots.telemetry import read_telemetry
from diffthrust.logs._robots.ulog import read_ulog

_READERS: Mapping[Kind, Reader] = {
    DATAFLASH: read_dataflash,
    TELEMETRY: read_telemetry,
    ULOG: read_ulog,
}


def series_in(
    path: Path, kind: Kind, wanted: Sequence[str], header: bool, missing: Sequence[float]
) -> dict[str, Series]:
    """The samples of the wanted fields of a robot's log.

    With ``header`` by the stamp of the message's header if it has one (ROS); ``missing`` are
    numbers that mean missing.
    """
    _check_file(path, kind)
    if kind not in _READERS:
        return read_bag(path, wanted, header, missing)
    if header:
        raise InputError(
            f"{path.name}: only ROS bags have stamps in headers.", "leave stamps at 'recorder'."
        )
    return wanted_series(path, _READERS[kind], wanted, missing)


def all_fields(
    path: Path, kind: Kind
) -> tuple[tuple[Field, ...], tuple[str, ...], Mapping[str, float]]:
    """All numbers of a robot's log, notes on what is damaged or left out, and its parameters."""
    _check_file(path, kind)
    contents = _READERS[kind](path, None) if kind in _READERS else bag_fields(path)
    fields, notes = fields_of(contents.gathered)
    if not fields:
        raise InputError(
            f"{path.name}: expected messages with numbers, found none.",
            "check that the recording was saved.",
        )
    return fields, (*contents.notes, *notes), contents.parameters


def _check_file(path: Path, kind: Kind) -> None:
    """Raise InputError for a file that is too large, or a bag with the wrong suffix."""
    if kind in _READERS:  # these are read into memory at once
        MemoryBudget(path).take(path.stat().st_size)
    bag = path.is_file() and kind in (BAG, BAG_1, MCAP)
    if bag and path.suffix.lower() not in kind.endings:
        raise InputError(
            f"{path.name}: found {kind.article}, expected a name that ends in {kind.endings[0]}.",
            f"rename it to {path.with_suffix(kind.endings[0]).name!r}.",
        )
