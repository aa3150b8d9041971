"""A channel whose clock runs behind that of the others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from diffthrust._support.correlation import covariance
from diffthrust._support.words import number
from diffthrust.soundness._doubt import Doubt
from diffthrust.soundness._record import Record
from diffthrust.soundness._ties import DRIVE, GEOMETRY, Tie

_OPEN = 0.03
"""Share that two channels must leave open of each other before a lag between them is looked for."""
_HALVED = 0.5
"""Largest share of the unexplained variance that may remain: missing physics leaves more."""
_CLEAR = 0.9
"""Correlation that the two must reach once the lag is taken out."""
_LEAST = 6
"""Samples; the measured logs have lags of up to 5 between sensors, by filters and alignment."""


def lagging(r: Record, tied: Sequence[Tie]) -> Iterator[Doubt]:
    """Doubts on the clock of a channel, where a shift halves what two channels leave open."""
    late: dict[str, list[tuple[Tie, int, float]]] = {}
    shifts = [(tie, *_shift(tie)) for tie in tied]
    for tie, shift, after in shifts:
        if shift > 0 and tie.kind != DRIVE:  # what is driven follows: that alone is no lag
            late.setdefault(tie.channel, []).append((tie, shift, after))
        elif shift < 0:
            for driver in tie.others:
                late.setdefault(driver, []).append((tie, -shift, after))
    if not late:
        return
    timely = [c for tie, shift, _ in shifts if not shift for c in (tie.channel, *tie.others)]
    channel = max(late, key=lambda c: (len(late[c]), -timely.count(c)))
    tie, samples, after = late[channel][0]
    seconds = number(samples * r.step, 2)
    # what is driven lags by itself, which hides a part of a late drive
    least = "at least " if tie.kind == DRIVE else ""
    against = tie.words if channel == tie.channel else tie.channel
    yield Doubt(
        channel,
        "lag",
        f"{r.name}: {channel} comes {least}{seconds} s after {against}, with which it "
        f"must move (correlation {tie.together:.2f}, without the lag {after:.2f}): its clock "
        "is behind, or a filter delays it.",
        f"shift {channel} by -{seconds} s{' or more' if least else ''} before the log is made, or "
        "take the stamps of one clock.",
    )


def _shift(tie: Tie) -> tuple[int, float]:
    """By how many samples the channel follows what is due, and the correlation then; 0 if none."""
    explained = tie.together**2
    if tie.together < (0.2 if tie.kind == DRIVE else -0.5) or 1 - explained < _OPEN:
        return 0, tie.together
    reach = min(tie.seen.size // 6, 400)
    crossed = covariance([tie.seen], [tie.due], reach)
    shift = int(np.argmax(crossed)) - reach
    if abs(shift) < _LEAST or abs(shift) == reach:
        return 0, tie.together
    late, early = max(shift, 0), max(-shift, 0)
    measured, due = tie.seen[late : tie.seen.size - early], tie.due[early : tie.due.size - late]
    after = float(np.corrcoef(measured, due)[0, 1])
    baseline = float(np.corrcoef(tie.seen, tie.due)[0, 1]) if tie.kind == DRIVE else tie.together
    clear = after > (_CLEAR if tie.kind != GEOMETRY else 0.95)
    halved = 1 - after**2 < _HALVED * (1 - max(baseline, tie.together) ** 2)
    return (shift, after) if clear and halved else (0, tie.together)
