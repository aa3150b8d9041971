"""A log as its checks see it: unbroken series on an even grid, short enough to be quick."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from diffthrust.logs._log import Log
from diffthrust.soundness._doubt import Reading

_POINTS = 2048
"""Largest number of points on which relations are examined (means of longer logs)."""
_FEW = 40
"""Fewer samples tell nothing of how channels hang together."""
TURNS = {"rad": 2 * np.pi, "deg": 360.0, "shrunk": np.pi**2 / 90}
"""A full turn in stored numbers: of an angle in rad, in deg that was called rad, and in rad that
was called deg."""
ANGLES = ("heading", "wind_direction")
"""Channels that jump by a full turn."""


@dataclass(frozen=True)
class Record:
    """Channels of one log on an even grid of ``step`` [s], ``(n,)`` each; angles in rad, unwrapped.

    ``turns`` are the sizes of the jumps of angles, as words of ``TURNS``, and ``scales`` what
    columns were multiplied by.
    """

    name: str
    step: float
    values: Mapping[str, np.ndarray]
    inputs: frozenset[str]
    unsigned: frozenset[str]
    turns: Mapping[str, str]
    scales: Mapping[str, float]

    @property
    def size(self) -> int:
        """Number of points."""
        return next(iter(self.values.values())).size

    def has(self, *channels: str) -> bool:
        """Whether all these channels are there, and move."""
        return all(c in self.values and np.ptp(self.values[c]) > 0 for c in channels)

    def under(self, reading: Reading) -> Record:
        """The record where channels are read so."""
        sources = dict(reading.sources)
        _, clock = sources.pop("time", ("time", 1.0))
        values = {name: factor * self.values[source] for name, (source, factor) in sources.items()}
        return replace(self, step=clock * self.step, values={**self.values, **values})


def stretch(log: Log) -> Log:
    """The middle of a long log, every sample of it; a shorter log as it is."""
    spare = (len(log) - _POINTS) // 2
    if spare <= 0:
        return log
    return log.slice(log.time[spare] - log.time[0], log.time[-1 - spare] - log.time[0])


def record(log: Log) -> Record | None:
    """A log on an even grid; ``None`` where it is too short to tell anything."""
    count = min(len(log), _POINTS)
    if count < _FEW:
        return None
    grid = np.linspace(log.time[0], log.time[-1], count)
    values, turns = {}, {}
    for name, samples in {**log.inputs, **log.measured}.items():
        finite = np.isfinite(samples)
        if finite.sum() < _FEW:
            continue
        time, here = log.time[finite], samples[finite]
        if name in ANGLES:
            turn = jumps(here)
            if turn:
                turns[name] = turn
                # the jumps show a wrong unit, which is corrected for the checks that follow
                here = np.unwrap(here, period=TURNS[turn]) * (TURNS["rad"] / TURNS[turn])
        if time.size > 2 * _POINTS:  # means, not samples, so that noise falls as it should
            kept = time.size // (time.size // _POINTS) * (time.size // _POINTS)
            blocks = (-1, time.size // _POINTS)
            time, here = (x[:kept].reshape(blocks).mean(axis=1) for x in (time, here))
        values[name] = np.interp(grid, time, here)
    if not values:
        return None
    return Record(
        name=log.name,
        step=float(grid[1] - grid[0]),
        values=values,
        inputs=frozenset(log.inputs),
        unsigned=frozenset(log.unsigned),
        turns=turns,
        scales={name: way.scale for name, way in log.written.items()},
    )


def jumps(values: np.ndarray) -> str:
    """By which full turn an angle jumps, a word of ``TURNS``; empty where it does not."""
    if values.size < 3:
        return ""
    steps = np.abs(np.diff(values))
    most, usual, span = float(steps.max()), float(np.median(steps)), float(np.ptp(values))
    for word, turn in TURNS.items():
        if 0.8 * turn < most <= span < 1.03 * turn and most > 20 * usual:
            return word
    return ""
