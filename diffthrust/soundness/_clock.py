"""The time of a log: gaps, and a step that no such system could be logged with."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from diffthrust._support.words import number
from diffthrust.logs._log import Log
from diffthrust.models._base.model import Model
from diffthrust.soundness._doubt import Doubt
from diffthrust.soundness._mends import STEPS, unit_line

_GAP = 20.0
"""Times the median step from which on a step is a gap; of samples at random times one in 1e6 is."""


def misclocked(log: Log, model: Model | None) -> Iterator[Doubt]:
    """Doubts on the time stamps, and on stretches where a channel is missing."""
    if len(log) < 20:
        return
    steps = np.diff(log.time)
    yield from _base(log, model)
    gaps = np.flatnonzero(steps > _GAP * log.step)
    if gaps.size and gaps.size < 0.02 * steps.size + 1:
        longest = int(gaps[np.argmax(steps[gaps])])
        yield Doubt(
            "time",
            "gap",
            f"{log.name}: {gaps.size} {'gap' if gaps.size == 1 else 'gaps'} in time, the longest "
            f"of {number(float(steps[longest]), 3)} s after t = {number(float(log.time[longest]))}"
            f" s, where samples are otherwise {number(log.step, 3)} s apart.",
            "cut the log there (log.slice, or start and stop under [logs]) and give both parts.",
        )
    for channel, values in log.measured.items():
        lost = ~np.isfinite(values)
        if not lost.any():
            continue
        edges = np.flatnonzero(np.diff(np.concatenate([[0], lost.astype(int), [0]])))
        lengths = edges[1::2] - edges[::2]
        inside = lengths[(edges[::2] > 0) & (edges[1::2] < values.size)]
        usual = float(np.median(lengths)) if lengths.size > 4 else 1.0
        if inside.size and inside.max() > max(20, 10 * usual, 0.03 * values.size):
            yield Doubt(
                channel,
                "gap",
                f"{log.name}: {channel} is missing for {int(inside.max())} samples in a row.",
                f"cut the log there, or do without {channel}.",
            )


def _base(log: Log, model: Model | None) -> Iterator[Doubt]:
    """Milliseconds called seconds, or the reverse."""
    if model is not None and all(name in log.inputs for name in model.states):
        return  # nothing is integrated, so any rate will do
    fastest, slowest = model.time_scales if model else (0.0, np.inf)
    shortest, longest = (fastest / 50, slowest / 4) if model else STEPS
    if log.step >= longest:
        unit, limit = "ms", f"at most {number(longest, 2)} s"
    elif log.step < shortest or log.duration < fastest:
        unit, limit = "s", f"at least {number(shortest, 2)} s"
    else:
        return
    system = f"a '{model.name}'" if model else "a thruster or a vessel"
    yield Doubt(
        "time",
        "time_base",
        f"{log.name}: samples are {number(log.step, 3)} s apart over {number(log.duration, 3)} s, "
        f"where {system} is logged with {limit}.",
        unit_line("time", unit),
    )
