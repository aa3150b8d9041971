"""Bring a log to an even rate: one sample for each step, of all that was recorded in it.

Rows of a log that was merged from messages come as often as any of them: 91 Hz of three channels
with 25 to 33 Hz each, every row with one new number. A simulation takes a step for each row. The
log at an even rate keeps what was measured as means, and what drove the system as its mean over
the step that follows, so that a step of a command neither comes early nor lasts longer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.logs._validate import is_finite

_LEAST = 3
"""Numerics: steps that a log must last; fewer say nothing of a motion."""
_TURN = {"rad": 2 * np.pi, "deg": 360.0}


@dataclass(frozen=True)
class EvenSteps:
    """Equal steps over a log, without those in which nothing was recorded.

    Args:
        time: middle of each step [s], ``(n,)``.
        width: of a step [s].
        of_row: the step of each row, ``(m,)``.
    """

    time: np.ndarray
    width: float
    of_row: np.ndarray

    @classmethod
    def of(cls, stamps: np.ndarray, rate: float, name: str) -> EvenSteps:
        """The steps of a log.

        Args:
            stamps: its time [s], ``(m,)``.
            rate: steps a second.
            name: of the log, for messages.

        Raises:
            InputError: the rate is no positive number, above that of the log, or below that of
                three samples.
        """
        if not is_finite(rate) or rate <= 0:
            raise InputError(
                f"log {name!r}: expected a rate above zero in Hz, found {rate!r}.",
                "give the samples a second, such as rate = 10.",
            )
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
        numbers, of_row = np.unique(step, return_inverse=True)
        if numbers.size < _LEAST:
            raise InputError(
                f"log {name!r}: at {rate:g} Hz, its {stamps[-1] - stamps[0]:.3g} s hold fewer than "
                f"{_LEAST} samples.",
                "give a higher rate, in samples a second.",
            )
        return cls(first + (numbers + 0.5) / rate, 1.0 / rate, of_row)

    def _totals(self, weights: np.ndarray) -> np.ndarray:
        return np.bincount(self.of_row, weights, minlength=self.time.size)

    def samples(self, values: np.ndarray) -> float:
        """Samples of a channel in a step, as a rule."""
        counts = self._totals(np.isfinite(values))
        return float(np.median(counts[counts > 0])) if counts.any() else 1.0

    def means(self, stamps: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Means of the samples in each step, at its middle; NaN where there are none."""
        filled = self.filled_means(stamps, values)
        return np.where(self._totals(np.isfinite(values)) > 0, filled, np.nan)

    def filled_means(self, stamps: np.ndarray, values: np.ndarray) -> np.ndarray:
        """As `means`, interpolated over steps without samples."""
        finite = np.isfinite(values)
        counts = self._totals(finite)
        if not counts.any():
            return np.full(self.time.size, np.nan)
        at, least = counts > 0, np.maximum(counts, 1)
        centres = (self._totals(np.where(finite, stamps, 0.0)) / least)[at]
        means = (self._totals(np.where(finite, values, 0.0)) / least)[at]
        # The only sample of a step may stand at its beginning: moved to the middle as it is, it
        # would be late by half a step, always.
        return np.interp(self.time, centres, means)

    def held_means(self, stamps: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Means of a held signal from the middle of each step to that of the next."""
        ends = np.append(stamps, self.time[-1] + self.width)
        integral = np.append(0.0, np.cumsum(np.diff(ends) * values))
        until = np.interp(self.time + self.width, ends, integral)
        return (until - np.interp(self.time, ends, integral)) / self.width


def unwrapped(values: np.ndarray, unit: str) -> np.ndarray:
    """Angles across their jumps: a heading from 359 to 1 degree would average to 180."""
    if unit not in _TURN:
        return values
    finite = np.isfinite(values)
    out = values.copy()
    out[finite] = np.unwrap(values[finite], period=_TURN[unit])
    return out
