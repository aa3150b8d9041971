"""Gaps in the time base of a log, bridged by further samples."""

from __future__ import annotations

import numpy as np

from diffthrust.logs._log import Log

_GAP = 1.5
"""A step of more than this times the median is a gap. Uneven clocks jitter by less; one lost sample
makes a step of two."""
_MOST = 9.0
"""A log grows by at most this times its own length. A log of two bursts a day apart would otherwise
be simulated through the night; its steps in between are longer instead."""


def bridged(log: Log) -> tuple[Log, np.ndarray]:
    """A log without gaps in time, and the places of its own samples there, ``(n,)``.

    A gap is divided evenly into steps of at most the median. An integration step over the whole of
    it would be coarse, and padding that is cut short there would change what follows. Inputs run on
    in a gap as their ``hold`` says; nothing is measured.
    """
    if log.even:
        return log, np.arange(len(log))
    steps = np.diff(log.time)
    usual = log.step if steps.size else 1.0
    # 1e-6: a gap of ten steps that rounding makes 10.0000001 gets nine samples, not ten.
    missing = np.where(steps > _GAP * usual, np.ceil(steps / usual - 1e-6) - 1.0, 0.0)
    if not missing.any():
        return log, np.arange(len(log))
    pieces = 1 + np.floor(missing * min(1.0, _MOST * len(log) / missing.sum())).astype(int)
    original = np.concatenate([[0], np.cumsum(pieces)])
    previous = np.append(np.repeat(np.arange(steps.size), pieces), steps.size)
    share = (np.arange(previous.size) - original[previous]) / np.append(pieces, 1)[previous]
    following = np.minimum(previous + 1, steps.size)

    def straight(values: np.ndarray) -> np.ndarray:
        return values[previous] + share * (values[following] - values[previous])

    def sparse(values: np.ndarray) -> np.ndarray:
        return np.where(share == 0.0, values[previous], np.nan)

    longer = log.replaced(
        time=straight(log.time),
        inputs={
            name: straight(values) if log.hold[name] == "linear" else values[previous]
            for name, values in log.inputs.items()
        },
        measured={name: sparse(values) for name, values in log.measured.items()},
    )
    return longer, original
