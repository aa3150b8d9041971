"""What makes a log of a log: a part of it, channels moved in time, another rate."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Self

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.validation import finite
from diffthrust.logs._held import Hold, held_readings
from diffthrust.logs._units import is_finite
from diffthrust.logs._validate import window
from diffthrust.logs._written import Written


@dataclass(frozen=True, eq=False, init=False, repr=False)
class LogEdits(ABC):
    """The fields of a `Log`, and its edits: each gives a new log, and notes what was done."""

    time: np.ndarray
    inputs: Mapping[str, np.ndarray]
    measured: Mapping[str, np.ndarray]
    units: Mapping[str, str]
    unsigned: frozenset[str]
    noise: Mapping[str, float]
    hold: Mapping[str, str]
    written: Mapping[str, Written]
    rails: Mapping[str, tuple[float, float]]
    censored: frozenset[str]
    static: bool
    name: str
    notes: tuple[str, ...]
    left_out: tuple[tuple[float, float], ...]

    @abstractmethod
    def replaced(self, **fields: Any) -> Self: ...

    def _set(self, checked: Mapping[str, Any]) -> None:
        """Keep the fields; arrays become read-only, mappings immutable."""
        for key, value in checked.items():
            arrays = value.values() if isinstance(value, Mapping) else (value,)
            for array in arrays:
                if isinstance(array, np.ndarray):
                    array.flags.writeable = False
            kept = MappingProxyType(dict(value)) if isinstance(value, Mapping) else value
            object.__setattr__(self, key, kept)

    def __len__(self) -> int:
        """Number of samples."""
        return int(self.time.size)

    def _hold_of(self, channel: str) -> Hold | None:
        """How a sensor that repeats its last reading is read; None of any other channel."""
        if self.static or channel not in self.measured:  # of a static table equal points are equal
            return None
        return held_readings(self.measured[channel], self.inputs.values())

    def slice(self, start: float | None = None, stop: float | None = None) -> Self:
        """Cut a segment out of the log; time stamps are unchanged.

        Args:
            start: first moment to keep, in seconds after the first time stamp.
            stop: last moment to keep, in seconds after the first time stamp.

        Returns:
            A new log of the samples from ``start`` to ``stop``, both included.

        Raises:
            InputError: no sample lies between them.

        Example:
            >>> round(log.slice(2.0, 5.0).duration, 2)
            3.0
        """
        keep = window(self.time, start, stop, f"log {self.name!r}")
        return self._mapped(lambda _, values: values[keep], time=self.time[keep])

    def _mapped(self, made: Callable[[str, np.ndarray], np.ndarray], **fields: Any) -> Self:
        """A log with each series made anew, of the name of its channel and its values."""
        inputs = {name: made(name, values) for name, values in self.inputs.items()}
        measured = {name: made(name, values) for name, values in self.measured.items()}
        return self.replaced(inputs=inputs, measured=measured, **fields)

    def leave_out(self, start: float, stop: float, note: str = "") -> Self:
        """Leave a stretch out of fits and comparisons: nothing counts as measured there.

        What drove the system stays, so that the simulation goes through it.

        Args:
            start: first moment to leave out, in seconds after the first time stamp.
            stop: last moment to leave out, likewise.
            note: why, kept with the log.

        Returns:
            A new log, with a note.

        Raises:
            InputError: no sample lies between them, or no other is left of a channel.

        Example:
            >>> log.leave_out(2.0, 3.0, "weed in the propeller").notes
            ('2 to 3 s are left out: weed in the propeller.',)
        """
        if not (is_finite(start) and is_finite(stop)) or not start < stop:
            raise InputError(
                f"log {self.name!r}: expected a stretch from a first to a later second, found "
                f"{start!r} to {stop!r}.",
                "give both in seconds after the first sample, the earlier one first.",
            )
        inside = window(self.time, start, stop, f"log {self.name!r}")
        emptied = {n: np.where(inside, np.nan, values) for n, values in self.measured.items()}
        for channel, values in emptied.items():
            if np.isfinite(self.measured[channel]).any() and not np.isfinite(values).any():
                raise InputError(
                    f"log {self.name!r}: without {start:g} to {stop:g} s nothing is left of "
                    f"{channel!r}.",
                    "leave out less, or take the log out of the spec.",
                )
        why = f": {note}" if note else ""
        about = f"{start:g} to {stop:g} s are left out{why}".rstrip(".") + "."
        first, last = map(float, self.time[inside][[0, -1]])
        return self.replaced(
            measured=emptied,
            notes=(*self.notes, about),
            left_out=(*self.left_out, (first, last)),
        )

    def shifted(self, seconds: float, *channels: str) -> Self:
        """Move channels in time, of a recorder whose clocks disagree.

        Args:
            seconds: by how much they come later; below zero for earlier.
            *channels: inputs or measured channels; those named together move together.

        Returns:
            A new log, with a note. A measured channel is missing, and an input keeps its first or
            last value, where it would lie outside the log.

        Raises:
            InputError: no finite number, or no channel of the log.

        Example:
            >>> late = log.shifted(0.1, "speed", "thrust")  # by two samples
            >>> bool(late.measured["speed"][2] == log.measured["speed"][0])
            True
        """
        where = f"log {self.name!r}"
        seconds = finite(where, seconds, lambda _: True, "a shift in seconds", "give a number.")
        unknown = [channel for channel in channels if channel not in self.units]
        if unknown or not channels:
            named = repr(unknown[0]) if unknown else "none"
            raise InputError(
                f"{where}: expected channels to shift, found {named}; it has "
                f"{', '.join(self.units)}.",
                "name one or several of them.",
            )
        inputs, measured = dict(self.inputs), dict(self.measured)
        for channel in channels:
            series = inputs if channel in inputs else measured
            held = self.hold.get(channel) == "zero" or self._hold_of(channel) is not None
            unit = self.units[channel]
            series[channel] = _moved(self.time, series[channel], seconds, held=held, unit=unit)
        for channel, values in inputs.items():
            present = np.flatnonzero(np.isfinite(values))
            ends = np.clip(np.arange(len(self)), *present[[0, -1]]) if present.size else slice(None)
            inputs[channel] = values[ends]
        note = f"{listing(channels)} moved by {seconds:+g} s."
        return self.replaced(inputs=inputs, measured=measured, notes=(*self.notes, note))

    def averaged(self, samples: int) -> Self:
        """Average blocks of samples into one, for a log sampled faster than the system moves.

        Each mean is placed at the middle of its block; inputs are linear in between. Means skip
        missing samples, a known noise falls with the square root of ``samples``, and angles in rad
        or deg are averaged across their jumps. An incomplete block at the end is dropped.

        Args:
            samples: block length.

        Returns:
            A new log, with a note.

        Raises:
            InputError: not an integer, or more than the log has.

        Example:
            >>> log.averaged(4).time.shape
            (60,)
        """
        if not isinstance(samples, int) or not 1 <= samples <= len(self):
            raise InputError(
                f"log {self.name!r}: expected a whole number of samples from 1 to {len(self)}, "
                f"found {samples!r}.",
                "give the number of samples to average into one.",
            )
        used = len(self) // samples * samples

        def mean(name: str, values: np.ndarray) -> np.ndarray:
            blocks = unwrapped(values, self.units[name])[:used].reshape(-1, samples)
            finite = np.isfinite(blocks)
            counts = finite.sum(axis=1)
            sums = np.where(finite, blocks, 0.0).sum(axis=1)
            return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)

        return self._mapped(
            mean,
            time=self.time[:used].reshape(-1, samples).mean(axis=1),
            noise={key: value / samples**0.5 for key, value in self.noise.items()},
            # A mean stands at the middle of its block; kept until the next one, an input would lag
            # by half a block.
            hold=dict.fromkeys(self.hold, "linear"),
            notes=(*self.notes, f"{samples} samples each were averaged into one."),
        )

    def resampled(self, rate: float) -> Self:
        """Bring the log to an even rate, for one that was merged from messages, or is fast.

        Measured channels become means of their samples in each step, at its middle, and missing
        where there are none. A held input becomes its mean until the next step and stays held, so
        that its steps are not smeared. Angles in rad or deg are averaged across their jumps, and a
        known noise falls with the square root of the samples in a step. Steps without any row are
        left out.

        Args:
            rate: samples a second, at most those of the log.

        Returns:
            A new log, with a note.

        Raises:
            InputError: the rate is not a positive number, above the log's, or so low that fewer
                than three samples remain.

        Example:
            >>> even = log.resampled(10.0)
            >>> round(even.step, 6), even.hold["command"]
            (0.1, 'zero')
        """
        steps = _EvenSteps(self.time, rate, self.name)

        def mean(name: str, values: np.ndarray) -> np.ndarray:
            plain = unwrapped(values, self.units[name])
            if self.hold.get(name) == "zero":
                return steps.held_means(plain)
            if name in self.inputs:
                return steps.filled_means(plain)
            return steps.means(plain)

        counts = {name: steps.samples(self.measured[name]) for name in self.noise}
        note = f"{len(self)} rows were averaged to {steps.time.size} at {steps.rate:g} Hz."
        return self._mapped(
            mean,
            time=steps.time,
            noise={name: sigma / counts[name] ** 0.5 for name, sigma in self.noise.items()},
            notes=(*self.notes, note),
        )


def _moved(
    time: np.ndarray, values: np.ndarray, seconds: float, *, held: bool, unit: str
) -> np.ndarray:
    """A channel later by some seconds: at each time stamp what it read that long before.

    A held one keeps its last value between samples, and goes in straight lines otherwise; angles
    are moved across their jumps. NaN where it would lie outside the log.
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


_LEAST = 3
"""Numerics: steps that a log must last; fewer say nothing of a motion."""
_TURN = {"rad": 2 * np.pi, "deg": 360.0}


class _EvenSteps:
    """Equal steps over a log, without those in which nothing was recorded.

    Rows of a log that was merged from messages come as often as any of them: 91 Hz of three
    channels with 25 to 33 Hz each, every row with one new number, and a simulation takes a step for
    each row. What was measured becomes means, and what drove the system its mean over the step that
    follows, so that a step of a command neither comes early nor lasts longer.

    ``time`` is the middle of each step [s], ``(n,)``, of rows with ``stamps`` [s], ``(m,)``.
    """

    def __init__(self, stamps: np.ndarray, rate: float, name: str) -> None:
        mend = "give the samples a second, such as rate = 10."
        rate = finite(f"log {name!r}", rate, lambda hz: hz > 0, "a rate above zero in Hz", mend)
        row = float(np.median(np.diff(stamps))) if stamps.size > 1 else np.inf
        if rate * row > 1 + 1e-6:
            raise InputError(
                f"log {name!r}: its rows come at {1 / row:.3g} Hz, found rate = {rate:g}. "
                "Samples between them would add no information.",
                f"give a rate of at most {1 / row:.3g}, or leave it out.",
            )
        # Half a row before the first: the means of even rows stand at the middle of their step.
        first = stamps[0] - 0.5 * row
        step = np.floor((stamps - first) * rate + 1e-9).astype(np.int64)
        # Steps without a row are left out: a gap of the recorder stays one, and is reported.
        numbers, self._of_row = np.unique(step, return_inverse=True)
        if numbers.size < _LEAST:
            raise InputError(
                f"log {name!r}: at {rate:g} Hz, its {stamps[-1] - stamps[0]:.3g} s hold fewer than "
                f"{_LEAST} samples.",
                "give a higher rate, in samples a second.",
            )
        self.time, self._width = first + (numbers + 0.5) / rate, 1.0 / rate
        self.rate, self._stamps = rate, stamps

    def _totals(self, weights: np.ndarray) -> np.ndarray:
        return np.bincount(self._of_row, weights, minlength=self.time.size)

    def samples(self, values: np.ndarray) -> float:
        """Samples of a channel in a step, as a rule."""
        counts = self._totals(np.isfinite(values))
        return float(np.median(counts[counts > 0])) if counts.any() else 1.0

    def means(self, values: np.ndarray) -> np.ndarray:
        """Means of the samples in each step, at its middle; NaN where there are none."""
        return np.where(self._totals(np.isfinite(values)) > 0, self.filled_means(values), np.nan)

    def filled_means(self, values: np.ndarray) -> np.ndarray:
        """As `means`, interpolated over steps without samples."""
        finite = np.isfinite(values)
        counts = self._totals(finite)
        if not counts.any():
            return np.full(self.time.size, np.nan)
        at, least = counts > 0, np.maximum(counts, 1)
        centres = (self._totals(np.where(finite, self._stamps, 0.0)) / least)[at]
        means = (self._totals(np.where(finite, values, 0.0)) / least)[at]
        # The only sample of a step may stand at its beginning: moved to the middle as it is, it
        # would be late by half a step, always.
        return np.interp(self.time, centres, means)

    def held_means(self, values: np.ndarray) -> np.ndarray:
        """Means of a held signal from the middle of each step to that of the next."""
        ends = np.append(self._stamps, self.time[-1] + self._width)
        integral = np.append(0.0, np.cumsum(np.diff(ends) * values))
        until = np.interp(self.time + self._width, ends, integral)
        return (until - np.interp(self.time, ends, integral)) / self._width


def unwrapped(values: np.ndarray, unit: str) -> np.ndarray:
    """Angles across their jumps: a heading from 359 to 1 degree would average to 180."""
    if unit not in _TURN:
        return values
    finite = np.isfinite(values)
    out = values.copy()
    out[finite] = np.unwrap(values[finite], period=_TURN[unit])
    return out
