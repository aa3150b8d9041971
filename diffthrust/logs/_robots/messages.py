"""The samples of all fields of a robot's log, collected message by message."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from diffthrust.logs._field import Field

LONGEST = 16
"""Longer arrays are pictures, spectra or scans: their elements are not channels."""


@dataclass
class Gathered:
    """The messages of one kind from one sender.

    Args:
        name: name in `Column`, such as ``"/odom"`` or ``"ESC[0]"``.
        ticks: time stamps [ns], a list or an array of integers.
        values: numbers by field, one per message, each a list or an array.
        units: units of fields stated in the file.
    """

    name: str
    ticks: Any = field(default_factory=list)
    values: dict[str, Any] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)


class RobotContents(NamedTuple):
    """Everything in a robot's log.

    Args:
        gathered: the messages.
        notes: sentences on damage.
        parameters: settings of an autopilot by name, as they were last written.
    """

    gathered: list[Gathered]
    notes: list[str]
    parameters: Mapping[str, float] = {}


def fields_of(gathered: Iterable[Gathered]) -> tuple[tuple[Field, ...], list[str]]:
    """The fields of all messages, by time from the first on, and notes on clocks that step back."""
    with_samples = [g for g in gathered if len(g.ticks) and g.values]
    if not with_samples:
        return (), []
    stamps = [np.asarray(g.ticks, dtype=np.int64) for g in with_samples]
    origin = min(int(ticks.min()) for ticks in stamps)
    fields, notes = [], []
    for messages, ticks in zip(with_samples, stamps, strict=True):
        time = (ticks - origin) / 1e9
        back = np.diff(time)
        order: slice | np.ndarray = slice(None)
        if back.size and back.min() < 0:
            order = np.argsort(ticks, kind="stable")
            # Messages of parallel tasks arrive out of order by milliseconds, which sorting mends; a
            # step of more than a second is a restart or a corrected clock.
            if back.min() < -1.0:
                where = time[int(np.argmin(back))]
                notes.append(
                    f"the clock of {messages.name!r} steps back by {-back.min():.3g} s "
                    f"after {where:.6g} s: the recording should be split there."
                )
        time = time[order]
        for key, values in messages.values.items():
            numbers = np.asarray(values, dtype=np.float64)[order]
            # Drivers publish infinity for "no echo": a log takes only missing samples.
            numbers[~np.isfinite(numbers)] = np.nan
            unit = messages.units.get(key, "")
            fields.append(Field(f"{messages.name}.{key}", numbers, time, unit))
    return tuple(fields), notes
