"""What a full simulation makes of a cycle: does it stay, and where does it go if not?"""

from __future__ import annotations

import math
from dataclasses import dataclass

from diffthrust._support.transfer import Transfer
from diffthrust.cycles._element import Nonlinearity, NotSimulated
from diffthrust.cycles._oscillation import CycleSeries, LoopCourse, Oscillation, envelope, measured

# few lengths, so that few programs are compiled: the number of steps is part of the program
_LENGTHS = (16, 32, 64, 128, 256)
_FACTORS = (1.0, 0.9, 1.1)
_BACK, _AWAY = 0.05, 0.15


@dataclass(frozen=True)
class Verification:
    """What simulations from near the cycle did.

    Args:
        oscillation: the course that began on the cycle, in numbers; ``None`` if it is no
            oscillation, or nothing was simulated.
        lasts: simulations from 10 % below and above came back (``True``) or left (``False``);
            ``None`` where they were still under way, differed, or nothing was simulated.
        words: the same as a sentence.
    """

    oscillation: Oscillation | None
    lasts: bool | None
    words: str


def verified(
    transfer: Transfer, element: Nonlinearity, cycle: CycleSeries, growth: float
) -> Verification:
    """Simulate the whole loop from a cycle and from 10 % below and above it.

    Args:
        transfer: the linear part.
        element: the nonlinear element.
        cycle: the cycle.
        growth: of a deviation [1/s], which sets how long to simulate.
    """
    period = cycle.oscillation.period
    # four time constants of the deviation: 10 % falls below 0.2 %, or has grown fifty-fold
    wanted = 4.0 / max(abs(growth) * period, 1e-9)
    periods = next((n for n in _LENGTHS if n >= wanted), _LENGTHS[-1])
    try:
        runs = element.courses(transfer, cycle, _FACTORS, periods)
    except NotSimulated as reason:
        return Verification(None, None, f"not simulated: {reason}")
    return _judged(runs, cycle.oscillation, periods)


def _judged(runs: list[LoopCourse], cycle: Oscillation, periods: int) -> Verification:
    on, *sides = runs
    ends = [_end(run, cycle) for run in sides]
    back = [abs(end - 1.0) < _BACK for end in ends]
    away = [abs(end - 1.0) > _AWAY for end in ends]
    lasts = True if all(back) else False if all(away) else None
    # an unstable cycle is left sooner or later: only its first turns show it
    count = on.time.size if lasts else math.ceil(3.5 * cycle.period / on.time[1]) + 1
    oscillation = measured(on.time[:count], on.input[:count], turns=4 if lasts else 2)
    if oscillation and not lasts and abs(oscillation.peak / cycle.peak - 1.0) > 0.1:
        oscillation = None  # it had left already: these would be the figures of something else
    if lasts:
        words = "simulations from 10 % below and above come back to it"
    else:
        sides_said = [
            f"from 10 % {side} it {_fate(run, end, cycle, periods)}"
            for side, run, end in zip(("below", "above"), sides, ends, strict=True)
        ]
        words = ("the simulation leaves it: " if lasts is False else "") + ", ".join(sides_said)
    return Verification(oscillation, lasts, words)


def _end(run: LoopCourse, cycle: Oscillation) -> float:
    """Height of the last two turns over that of the cycle; inf where it fled."""
    if run.fled:
        return math.inf
    return float(envelope(run.time, run.input, cycle.period)[-2:].mean()) / cycle.peak


def _fate(run: LoopCourse, end: float, cycle: Oscillation, periods: int) -> str:
    if run.fled:
        return "grows a thousandfold"
    if end < 0.1:
        return "dies out"
    if abs(end - 1.0) < _BACK:
        return "comes back"
    height = envelope(run.time, run.input, cycle.period)
    settled = abs(height[-1] / height[-3] - 1.0) < 1e-3
    if settled:
        return f"goes to a peak of {height[-1]:.4g}"
    return f"has a peak of {height[-1]:.4g} after {periods} periods"
