"""Command generators: series on a time grid, seeded where they are random."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

Array = np.ndarray


def grid(duration: float, step: float) -> Array:
    """Sample instants from 0 to ``duration`` inclusive [s]."""
    return np.arange(round(duration / step) + 1) * step


def staircase(time: Array, levels: Sequence[float], dwell: float) -> Array:
    """Each level held for ``dwell`` seconds, the last one to the end."""
    # A small lead keeps rounding in the grid from shifting a step by one sample.
    at = np.floor((time - time[0]) / dwell + 1e-9).astype(int)
    return np.asarray(levels, float)[np.minimum(at, len(levels) - 1)]


def step(time: Array, level: float, at: float = 0.0) -> Array:
    """Zero, then ``level`` from the instant ``at`` on."""
    return np.where(time >= at - 1e-9, level, 0.0)


def chirp(time: Array, amplitude: float, low: float, high: float) -> Array:
    """Sine whose frequency grows linearly from ``low`` to ``high`` [Hz]."""
    t = time - time[0]
    return amplitude * np.sin(2.0 * np.pi * (low + 0.5 * (high - low) * t / t[-1]) * t)


def multisine(
    time: Array, amplitude: float, frequencies: Sequence[float], rng: np.random.Generator
) -> Array:
    """Sum of sines at ``frequencies`` [Hz] with random phases, its peak set to ``amplitude``."""
    f = np.asarray(frequencies, float)
    phase = rng.uniform(0.0, 2.0 * np.pi, len(f))
    total = np.sin(2.0 * np.pi * np.outer(time - time[0], f) + phase).sum(axis=1)
    return amplitude * total / np.max(np.abs(total))


def low_passed_random(
    time: Array, std: float, rng: np.random.Generator, cutoff: float = 1.0
) -> Array:
    """White noise through a first-order low-pass of ``cutoff`` [Hz], standard deviation ``std``.

    The command of the dynamic test of Yoerger, Cooke and Slotine 1990, figure 10 (1 Hz). Starts
    at zero.
    """
    keep = np.exp(-2.0 * np.pi * cutoff * np.diff(time))
    drive = std * np.sqrt(1.0 - keep**2) * rng.standard_normal(len(keep))
    out = np.zeros(len(time))
    for k in range(len(keep)):
        out[k + 1] = keep[k] * out[k] + drive[k]
    return out


def zigzag(time: Array, amplitude: float, dwell: float, start: float = 0.0) -> Array:
    """Straight until ``start``, then sides of ``dwell`` seconds in turn; the first is halved.

    The first side is half as long so that the heading swings about its first value.
    """
    side = np.floor((time - time[0] - start) / dwell + 0.5 + 1e-9).astype(int)
    out = np.where(side % 2 == 0, amplitude, -amplitude)
    return np.where(time - time[0] < start - 1e-9, 0.0, out)


def turning_circle(time: Array, angle: float, straight: float = 5.0) -> Array:
    """Straight for ``straight`` seconds, then a constant angle (Siramdasu 2013, section 3.2)."""
    return step(time - time[0], angle, straight)
