"""How columns of a file become the channels of a log."""

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from diffthrust._support.errors import InputError, Place
from diffthrust.logs._log import Log
from diffthrust.logs._validate import PlaceOf, check_hold, checked_fields


@dataclass(frozen=True)
class Column:
    """How a column of a file becomes a channel of a log.

    Args:
        column: name of the column, exactly as in the file; in a MATLAB struct as ``a.b``, in a
            robot's log as ``MESSAGE.FIELD``.
        unit: unit in which the column is written; empty where it is the model's unit.
        unsigned: the sensor reports the absolute value.
        noise: known standard deviation, in the unit of the column.
        hold: for an input, ``"zero"`` (keeps its last value) or ``"linear"``.
        scale: multiplies the numbers, such as -1 for a sensor that is mounted backward.

    Example:
        >>> Column("rpm", unit="rpm", unsigned=True).scale
        1.0
    """

    column: str
    unit: str = ""
    unsigned: bool = False
    noise: float | None = None
    hold: str = "zero"
    scale: float = 1.0


def is_finite(value: object) -> bool:
    """Whether a value is a finite number."""
    return isinstance(value, (int, float, np.number)) and math.isfinite(value)


def channel_columns(
    file: Path,
    inputs: Mapping[str, str | Column] | None,
    measured: Mapping[str, str | Column] | None,
) -> dict[str, Column]:
    """Give the column of each channel.

    Raises:
        InputError: a channel is named twice or ``"time"``, none is named, or one is ill described.
    """
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
        if not is_finite(column.scale) or column.scale == 0:
            raise InputError.at(
                place,
                f"expected a scale other than zero, found {column.scale!r}.",
                "give the factor by which the numbers are to be multiplied.",
            )
        check_hold(column.hold, place)
        columns[key] = column
    return columns


def log_of_columns(
    columns: Mapping[str, Column],
    inputs: Collection[str],
    measured: Collection[str],
    *,
    time: np.ndarray,
    values: Mapping[str, np.ndarray],
    name: str,
    interpolate_inputs: bool,
    notes: Iterable[str],
    at: PlaceOf,
) -> Log:
    """The log of channels that were read from a file.

    Args:
        columns: the column of each channel.
        inputs: which channels are inputs.
        measured: which are measured.
        time: time stamps [s], ``(n,)``.
        values: numbers of each channel as the file has them, ``(n,)``.
        name: of the log.
        interpolate_inputs: fill missing samples of inputs instead of refusing them.
        notes: sentences to keep with the log.
        at: names a place of the file for a message.

    Raises:
        InputError: as in `Log`.
    """
    with np.errstate(all="ignore"):
        scaled = {key: values[key] * float(column.scale) for key, column in columns.items()}
    return Log.of_checked(
        checked_fields(
            time=time,
            inputs={key: scaled[key] for key in inputs},
            measured={key: scaled[key] for key in measured},
            units={key: column.unit for key, column in columns.items()},
            unsigned=[key for key in measured if columns[key].unsigned],
            noise={key: sigma for key in measured if (sigma := columns[key].noise) is not None},
            hold={key: columns[key].hold for key in inputs},
            name=name,
            interpolate_inputs=interpolate_inputs,
            notes=tuple(notes),
            at=at,
        )
    )
