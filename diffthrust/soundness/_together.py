"""Channels that do not hang together, and the single mistake that explains it.

A tie is broken where it can be so by no noise: the two oppose each other, or what must be equal is
several times as large. Every single mistake is undone in turn; one is named if it mends a broken
tie, and breaks none. So a log that random forces shake, or that lacks physics, is not doubted: no
change of a sign or a unit would mend it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from diffthrust.soundness._doubt import Doubt, Reading
from diffthrust.soundness._mends import STEPS, clocks, exchanges, rescaled, signs
from diffthrust.soundness._record import Record
from diffthrust.soundness._ties import DRIVE, GEOMETRY, Tie, ties

_OPPOSED = -0.6
"""Correlation of a channel with what it must follow from which on it is taken to oppose it. Of 67
sound logs, measured ones, the lowest was -0.2; of 53 whose heading stood for the yaw rate -0.26."""
_FIRM = 0.8
"""Correlation from which on the two are taken to agree, and their ratio to mean something."""
_OFF = 1.4
"""Ratio from which on equal quantities are not taken to be so; measured ones were 0.64 to 1.06."""
_RIGHT = 1.15
"""Ratio within which a mend must bring them."""


def misplaced(r: Record, tied: Sequence[Tie]) -> Iterator[Doubt]:
    """Doubts on signs, exchanged channels and units, from the ties of one log."""
    broken = [tie for tie in tied if _is_broken(tie)]
    if not broken:
        return
    rated = []
    # a ratio that several equal quantities share, or a step that no log has: the clock's
    shared = [tie.gain for tie in tied if tie.equal and tie.together > _FIRM]
    similar = len(shared) > 1 and max(shared) < _RIGHT * min(shared)
    odd = not STEPS[0] <= r.step <= STEPS[1]
    timed = [*clocks(r, 1 / float(np.median(shared)))] if shared and (similar or odd) else []
    for kind, reading in (*timed, *signs(r), *exchanges(r), *rescaled(r)):
        if not any(c in tie.powers or c in tie.others for tie in broken for c in reading.sources):
            continue
        after = _by_key(ties(r.under(reading)))
        mended = [tie for tie in broken if _holds(after.get(_key(tie)))]
        spoilt = [t for t in tied if not _is_broken(t) and _worse(t, after.get(_key(t)))]
        if kind == "unit" and all(tie.kind == DRIVE for tie in mended):
            continue  # a drive tells the direction only
        if mended and not spoilt:
            quality = sum(after[_key(tie)].together for tie in tied if _key(tie) in after)
            rated.append((len(mended), quality, kind, reading, mended, after))
    if not rated:
        return
    most = max(count for count, *_ in rated)
    best = [row for row in rated if row[0] == most]
    best = [row for row in best if row[1] > max(quality for _, quality, *_ in best) - 0.1]
    _, _, kind, reading, mended, after = best[0]
    improved = [_improvement(tie, after[_key(tie)]) for tie in mended[:2]]
    evidence, line = f"{r.name}: {'; '.join(improved)}.", reading.line
    rivals = [(row[2], row[3]) for row in best[1:]]
    if rivals:
        named = [_named(*rival) for rival in rivals[:2]]
        evidence += f" The same would follow from {' or '.join(named)}."
        line += f" Or: {rivals[0][1].line}"
    readings = (reading, *(rival for _, rival in rivals))
    yield Doubt(next(iter(reading.sources)), kind, evidence, line, readings)


def contradicts(r: Record, tied: Sequence[Tie], reading: Reading) -> bool:
    """Whether a log speaks against a reading that other logs ask for: what holds in it breaks."""
    if not {source for source, _ in reading.sources.values()} <= set(r.values):
        return True  # the time, or a channel it lacks
    after = _by_key(ties(r.under(reading)))
    return any(_holds(tie) and _worse(tie, after.get(_key(tie))) for tie in tied)


def _improvement(tie: Tie, after: Tie) -> str:
    if tie.together > _FIRM:
        return (
            f"{tie.channel} is {abs(tie.gain):.3g} times {tie.words} "
            f"(with the mend {abs(after.gain):.3g} times)"
        )
    verb = "opposes" if tie.together < 0 else "does not follow"
    turning = tie.kind == DRIVE and tie.channel == "heading"
    channel = "the rate of the heading" if turning else tie.channel
    return (
        f"{channel} {verb} {tie.words} (correlation {tie.together:+.2f}, with the mend "
        f"{after.together:+.2f})"
    )


def _named(kind: str, reading: Reading) -> str:
    if kind == "exchanged":
        return reading.words
    return f"the {'sign' if kind == 'sign' else 'unit'} of {next(iter(reading.sources))}"


def _key(tie: Tie) -> tuple[str, str]:
    return tie.channel, tie.words


def _by_key(tied: Sequence[Tie]) -> dict[tuple[str, str], Tie]:
    return {_key(tie): tie for tie in tied}


def _is_broken(tie: Tie) -> bool:
    """Whether a tie is broken in a way that no noise explains."""
    if tie.together < _OPPOSED:
        return True
    if tie.kind == GEOMETRY and tie.together < 0.5:
        return True
    return tie.equal and tie.together > _FIRM and not 1 / _OFF < tie.gain < _OFF


def _holds(tie: Tie | None) -> bool:
    if tie is None:
        return False
    if tie.kind == DRIVE:
        return tie.together > -_OPPOSED
    fits = not tie.equal or 1 / _RIGHT < tie.gain < _RIGHT
    return tie.together > _FIRM and fits


def _worse(baseline: Tie, tie: Tie | None) -> bool:
    """Whether a tie that held is broken, or no longer says what it said."""
    if tie is None or _is_broken(tie) or tie.together < baseline.together - 0.2:
        return True
    off = abs(np.log(abs(tie.gain))) - abs(np.log(abs(baseline.gain)))
    return baseline.equal and off > 0.1
