"""The commands of the papers' tests: staircases, and noise through a low-pass."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.validation import finite


def staircase(
    levels: Sequence[float], dwell: float, step: float, *, rest: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Each level held for a while, one after the other.

    Args:
        levels: in the unit of the input.
        dwell: how long each is held [s].
        step: time between samples [s].
        rest: how long zero is held before the first level [s].

    Returns:
        Time [s] and values, ``(n,)`` each.

    Raises:
        InputError: no level, or a time that is not positive.

    Example:
        >>> time, command = dft.papers.staircase([1, 2, 3, 4], dwell=10.0, step=0.05)
        >>> time.shape, float(command.max())
        ((801,), 4.0)
    """
    finite("staircase, dwell", dwell, lambda x: x > 0, "seconds, above zero")
    finite("staircase, step", step, lambda x: 0 < x <= dwell, "seconds, above zero, up to dwell")
    finite("staircase, rest", rest, lambda x: x >= 0, "seconds, zero or more")
    heights = np.asarray(levels, float).ravel()
    if not heights.size or not np.all(np.isfinite(heights)):
        raise InputError(
            f"staircase, levels: expected finite numbers, found {levels!r}.", "Give [1, 2, 3]."
        )
    each, pause = round(dwell / step), round(rest / step)
    # one more sample at the end: the last level is held for its full dwell
    values = np.concatenate([np.zeros(pause), np.repeat(heights, each), heights[-1:]])
    return step * np.arange(values.size), values


def lowpass_noise(
    duration: float, step: float, peak: float, *, cutoff: float = 1.0, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """White noise through a second-order Butterworth low-pass, to a given largest value.

    The paper names the cut-off of 1 Hz, not the order of the filter.

    Args:
        duration: [s].
        step: time between samples [s].
        peak: largest absolute value, in the unit of the input.
        cutoff: of the filter [Hz].
        seed: of the noise.

    Returns:
        Time [s] and values, ``(n,)`` each.

    Raises:
        InputError: a number that is not positive, a cut-off beyond half the sample rate.

    Source: Yoerger, Cooke & Slotine 1990, section III.

    Example:
        >>> time, command = dft.papers.lowpass_noise(duration=10.0, step=0.05, peak=3.0, cutoff=1.0)
        >>> time.shape, float(np.abs(command).max())
        ((201,), 3.0)
    """
    from scipy.signal import butter, sosfilt  # takes a while

    for name, value in (("duration", duration), ("step", step), ("peak", peak)):
        finite(f"lowpass_noise, {name}", value, lambda x: x > 0, "a number above zero")
    finite("lowpass_noise, cutoff", cutoff, lambda x: 0 < x < 0.5 / step,
           f"Hz, above zero and below half the sample rate, {0.5 / step:g} Hz")  # fmt: skip
    time = step * np.arange(round(duration / step) + 1)
    white = np.random.default_rng(seed).standard_normal(time.size)
    values = sosfilt(butter(2, cutoff, fs=1.0 / step, output="sos"), white)
    return time, np.asarray(values) * (peak / np.max(np.abs(values)))
