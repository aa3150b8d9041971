"""How much of a planned band a recorded input excites."""

from __future__ import annotations

import numpy as np

from diffthrust.logs._log import Log

_PARTS = 8
"""Parts of the band, evenly spaced in the logarithm of frequency."""
_ENOUGH = 0.1
"""Share of the planned power in a part; a tenth is a third of the amplitude."""


def excited(
    log: Log, plan: Log, channel: str, unit: str, band: tuple[float, float]
) -> tuple[float, float] | None:
    """The widest part of a band in which a log's input has as good as the planned power.

    Args:
        log: recorded.
        plan: the run as planned.
        channel: the input.
        unit: in which both are compared.
        band: lowest and highest frequency [Hz].

    Returns:
        Lowest and highest frequency [Hz], or ``None`` where no part is excited.
    """
    edges = np.geomspace(*band, _PARTS + 1)
    wanted, found = (_power(one, channel, unit, edges) for one in (plan, log))
    good = [*(found >= _ENOUGH * wanted), False]
    best, start = (0, 0), 0
    for k, here in enumerate(good):
        if not here:
            best, start = max(best, (start, k), key=lambda part: part[1] - part[0]), k + 1
    return (float(edges[best[0]]), float(edges[best[1]])) if best[1] > best[0] else None


def _power(log: Log, channel: str, unit: str, edges: np.ndarray) -> np.ndarray:
    """Mean square of a channel between frequencies; zero where the samples do not reach."""
    values, steps = log.values(channel, unit), np.diff(log.time)
    step = float(np.median(steps))
    even = np.arange(log.time[0], log.time[-1] + 0.5 * step, step)
    held = values[np.clip(np.searchsorted(log.time, even + 1e-9, side="right") - 1, 0, None)]
    lines = np.abs(np.fft.rfft(held - held.mean())) ** 2 / held.size**2
    total = np.concatenate([[0.0], np.cumsum(lines)])
    frequency = np.fft.rfftfreq(held.size, step)
    ends = np.searchsorted(frequency, edges * (1.0 + 1e-9))
    return np.diff(total[ends])
