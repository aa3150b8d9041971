"""Edits of a log by whoever knows the test: a stretch left out, channels moved in time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.logs._resampled import unwrapped
from diffthrust.logs._validate import is_finite, window


def without_stretch(
    name: str, time: np.ndarray, measured: Mapping[str, np.ndarray], start: float, stop: float
) -> dict[str, np.ndarray]:
    """Measured channels with a stretch missing; what drove the system goes on through it.

    Args:
        name: of the log, for messages.
        time: its time stamps [s], ``(n,)``.
        measured: its measured channels, ``(n,)`` each.
        start: first moment to leave out, in seconds after the first time stamp.
        stop: last moment to leave out, likewise.

    Raises:
        InputError: the two ends are no numbers in order, no sample lies between them, or no other
            is left of a channel.
    """
    if not (is_finite(start) and is_finite(stop)) or not start < stop:
        raise InputError(
            f"log {name!r}: expected a stretch from a first to a later second, found {start!r} to "
            f"{stop!r}.",
            "give both in seconds after the first sample, the earlier one first.",
        )
    inside = window(time, start, stop)
    if not inside.any():
        raise InputError(
            f"log {name!r}: expected samples between {start:g} and {stop:g} s, found none; it "
            f"lasts {time[-1] - time[0]:.6g} s.",
            "choose a stretch inside the log.",
        )
    emptied = {channel: np.where(inside, np.nan, values) for channel, values in measured.items()}
    for channel, values in emptied.items():
        if np.isfinite(measured[channel]).any() and not np.isfinite(values).any():
            raise InputError(
                f"log {name!r}: without {start:g} to {stop:g} s nothing is left of {channel!r}.",
                "leave out less, or take the log out of the spec.",
            )
    return emptied


def moved(
    time: np.ndarray, values: np.ndarray, seconds: float, *, held: bool, unit: str
) -> np.ndarray:
    """A channel later by some seconds: at each time stamp what it read that long before.

    Args:
        time: time stamps [s], ``(n,)``.
        values: ``(n,)``; NaN where nothing was measured.
        seconds: by how much; below zero for earlier.
        held: it keeps its last value between samples; straight lines otherwise.
        unit: its unit: angles are moved across their jumps.

    Returns:
        ``(n,)``; NaN where it would lie outside the log.
    """
    at = time - seconds
    if held:
        # the slack keeps a shift by whole samples exact although the stamps are rounded
        index = np.searchsorted(time, at + 1e-6 * float(np.median(np.diff(time))), "right") - 1
        read = values[np.clip(index, 0, time.size - 1)]
        outside = index < 0
    else:
        read, outside = np.interp(at, time, unwrapped(values, unit)), at < time[0] - 1e-9
    return np.where(outside | (at > time[-1] + 1e-9), np.nan, read)


def check_shift(name: str, seconds: float, channels: Sequence[str], has: Sequence[str]) -> None:
    """Raise `InputError` for a shift that is no number, or of a channel that is not in the log."""
    if not is_finite(seconds):
        raise InputError(
            f"log {name!r}: expected a shift in seconds, found {seconds!r}.", "give a number."
        )
    unknown = [channel for channel in channels if channel not in has]
    if unknown or not channels:
        found = repr(unknown[0]) if unknown else "none"
        raise InputError(
            f"log {name!r}: expected channels to shift, found {found}; it has {', '.join(has)}.",
            "name one or several of them.",
        )
