"""A log whose clock runs at another rate than those of its companions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from diffthrust._support.words import number
from diffthrust.soundness._doubt import Doubt
from diffthrust.soundness._mends import clock_line
from diffthrust.soundness._record import Record
from diffthrust.soundness._ties import DRIVE, Tie, less, trailing

_OTHER = 1.5
"""Ratio of a log's step to that of its companions from which on its rate is another one."""
_SAME = 0.03
"""How far their own steps may differ (as a logarithm) to be one rate."""
_FIRM = 0.8
"""Correlation of a channel with its drive that a time constant is taken from."""
_NEAR = 0.3
"""A log's response must be slower by the ratio of the steps, within this share of its logarithm,
and the companions' own must agree so well."""
_DENSE = np.geomspace(0.7, 300.0, 48)
"""Time constants that are tried, in points."""


def misrated(
    steps: Sequence[float], records: Sequence[Record], tied: Sequence[Sequence[Tie]]
) -> Iterator[tuple[int, Doubt]]:
    """Doubts on single clocks of three logs and more, each with the place of its log.

    A log may well be taken at another rate. But then what is driven answers in as many seconds;
    if it answers in as many samples as in the other logs, the clock is wrong.
    """
    if len(records) < 3:
        return
    logs = np.log(steps)
    for i, r in enumerate(records):
        other_steps = np.delete(logs, i)
        ratio = float(np.exp(logs[i] - np.median(other_steps)))
        if max(ratio, 1 / ratio) < _OTHER or np.ptp(other_steps) > _SAME:
            continue
        for tie in tied[i]:
            took = _took(r, tie)
            peers = [
                _took(records[j], peer)
                for j, each in enumerate(tied)
                for peer in each
                if j != i and (peer.channel, peer.words) == (tie.channel, tie.words)
            ]
            finite = np.log([peer for peer in peers if np.isfinite(peer)])
            if finite.size < 2 or not np.isfinite(took):
                continue
            margin, middle = _NEAR * abs(np.log(ratio)), float(np.median(finite))
            off = np.log(took) - middle - np.log(ratio)
            if abs(off) < margin and np.abs(finite - middle).max() < margin:
                yield i, _doubt(r, tie, steps[i], ratio, took, float(np.exp(middle)))
                break


def _doubt(r: Record, tie: Tie, step: float, ratio: float, took: float, usual: float) -> Doubt:
    return Doubt(
        "time",
        "time_base",
        f"{r.name}: samples are {number(step, 3)} s apart, in the other logs "
        f"{number(step / ratio, 3)} s, and {tie.channel} answers {tie.words} with a time constant "
        f"of {number(took, 2)} s, in the others of {number(usual, 2)} s: as many samples.",
        clock_line(1 / ratio),
    )


def _took(r: Record, tie: Tie) -> float:
    """Time constant [s] with which a channel follows its drive; not a number if none shows."""
    if tie.kind != DRIVE or not tie.together > _FIRM:
        return np.nan
    lags = tuple(_DENSE[tie.seen.size / 6 > _DENSE])
    mean = np.ones((tie.seen.size, 1)) / tie.seen.size**0.5
    y = less(mean, tie.seen)
    fits = np.array([_together(less(mean, x), y) for x in trailing(tie.drive, lags)])
    best = int(np.argmax(fits))
    if not 0 < best < fits.size - 1 or not fits[best] > _FIRM:
        return np.nan
    lower, middle, upper = fits[best - 1 : best + 2]
    offset = 0.5 * (lower - upper) / (lower - 2 * middle + upper)
    return float(lags[best] * (lags[1] / lags[0]) ** offset * r.step)


def _together(x: np.ndarray, y: np.ndarray) -> float:
    xx, yy = float(x @ x), float(y @ y)
    return float(x @ y) / np.sqrt(xx * yy) if xx > 0 and yy > 0 else -1.0
