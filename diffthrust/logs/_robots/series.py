"""The samples of one field of a robot's log, with separate time stamps."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from diffthrust._support.errors import InputError, Place
from diffthrust._support.names import listing, nearest

# A clock that steps back by more than this [s] was restarted; smaller steps are late arrivals.
_RESTART = 1.0


@dataclass(frozen=True)
class Series:
    """The samples of one field, message by message.

    Args:
        place: file and field, for messages.
        time: time stamps [s], strictly increasing, shape (n,).
        values: numbers as the file has them, shape (n,).
        notes: sentences on what was left out.
    """

    place: Place | str
    time: np.ndarray
    values: np.ndarray
    notes: tuple[str, ...] = ()

    @property
    def period(self) -> float:
        """Median time between messages [s]; infinite for a single message."""
        return float(np.median(np.diff(self.time))) if self.time.size > 1 else float("inf")

    @property
    def largest_gap(self) -> tuple[float, float]:
        """Largest time between messages, and its start [s]; zero for a single message."""
        steps = np.diff(self.time)
        where = int(np.argmax(steps)) if steps.size else 0
        return (float(steps[where]) if steps.size else 0.0), float(self.time[where])

    @property
    def jitter(self) -> float:
        """95 % quantile of the deviation of the period from its median [s]."""
        if self.time.size < 2:
            return 0.0
        return float(np.quantile(np.abs(np.diff(self.time) - self.period), 0.95))


def column_place(file: str, column: str, detail: str = "") -> Place:
    """Name a place as ``run.mcap, column '/odom.twist.twist.linear.x'``, plus a detail."""
    return Place(f"{file}, column {column!r}{detail}", column)


def split_column(file: str, column: str) -> tuple[str, str]:
    """Split ``MESSAGE.FIELD`` at its first dot."""
    message, _, field = column.partition(".")
    if not message or not field:
        raise InputError.at(
            column_place(file, column),
            "expected a message and its field with a dot between.",
            "write it as '/odom.twist.twist.linear.x', 'RCOU.C1' or 'ATTITUDE.yaw'.",
        )
    return message, field


def absent(file: str, column: str, what: str, name: str, names: Iterable[str]) -> InputError:
    """The error for a topic or message that is not in the file, or a field not in a message."""
    names = list(names)
    near = nearest(name, names)
    return InputError.at(
        column_place(file, column),
        f"expected the {what} {name!r}, found {listing(names)}.",
        f"name a {what} that is there{'; ' + near if near else ''}.",
    )


def lacking(file: str, library: str, extra: str, error: ImportError) -> InputError:
    """The error for a library that is not installed."""
    return InputError(
        f"{file}: reading this kind of log needs {library}, which cannot be imported ({error}).",
        f"pip install 'diffthrust[{extra}]'",
    )


def series_of(
    file: str,
    column: str,
    nanoseconds: ArrayLike,
    values: ArrayLike,
    origin: int,
    missing: Iterable[float] = (),
) -> Series:
    """Clean the samples of one field: sorted by time, one per time stamp, none missing.

    Time stamps and their ``origin`` are integers [ns]: a float64 resolves a date only to 0.2 us.
    """
    place = column_place(file, column)
    ticks = np.asarray(nanoseconds, np.int64) - origin
    numbers = np.array(values, np.float64)  # a copy: missing values are marked in it
    notes = []
    for number in missing:
        numbers[numbers == number] = np.nan
    keep = ~np.isnan(numbers)
    if not keep.any():
        raise InputError.at(
            place,
            f"expected numbers, found none in {numbers.size} messages.",
            "choose another field, or check that the recording was complete.",
        )
    bad = np.flatnonzero(np.isinf(numbers))
    if bad.size:
        raise InputError.at(
            column_place(file, column, f", message {bad[0] + 1}"),
            f"expected a finite number, found {numbers[bad[0]]}.",
            "choose another field; a missing sample is written as nan.",
        )
    if not keep.all():
        notes.append(f"{int((~keep).sum())} of {keep.size} messages held no number")
        ticks, numbers = ticks[keep], numbers[keep]
    back = np.diff(ticks)
    if (back < -_RESTART * 1e9).any():
        index = int(np.argmax(back < -_RESTART * 1e9)) + 1
        raise InputError.at(
            column_place(file, column, f", message {index + 1}"),
            f"the clock steps back by {-back[index - 1] / 1e9:.6g} s "
            f"at {ticks[index - 1] / 1e9:.6g} s.",
            "the clock was restarted: split the recording there.",
        )
    if (back < 0).any():
        notes.append(f"{int((back < 0).sum())} messages were not in order and were sorted")
        order = np.argsort(ticks, kind="stable")
        ticks, numbers = ticks[order], numbers[order]
    last = np.append(np.diff(ticks) > 0, True)  # of several at one time stamp, keep the last
    if not last.all():
        count = int((~last).sum())
        notes.append(f"{count} messages had the stamp of the next one, which was taken")
        ticks, numbers = ticks[last], numbers[last]
    return Series(place, ticks / 1e9, numbers, tuple(notes))
