"""What a harmonic balance leaves out: how much more harmonics would change the first one.

From the coefficients that were found, one step of Newton's method is taken with at least twice as
many harmonics, and with the equations seen at far more instants. A corner of the equations (a dead
band, a saturation, dry friction) has harmonics without end, and only harmonics beyond those kept
show the size of what was dropped. Where that step is not short, the balance is solved again first.
The change is enlarged by the remainder of a series that falls with the first power of the number of
harmonics; as a rule it falls faster.

Source: Krack & Gross 2019, Harmonic Balance for Nonlinear Vibration Problems, chapter 2.
"""

from __future__ import annotations

import numpy as np

from diffthrust.describing._periodic.harmonic_balance import HarmonicBalance
from diffthrust.describing._periodic.period import TINY, Cycle, Harmonics, Lane
from diffthrust.describing._periodic.respond import (
    PeriodicResponses,
    Reason,
    first_harmonic,
    over,
    staged,
)

GAIN_ERROR, PHASE_ERROR = 1e-3, 0.1
"""Error of the gain (relative) and of the phase [deg] that an answer may have."""
_DOUBTFUL = 10.0
"""One step is enough where it shows an error this many times smaller."""
_LEAST = 15
"""Fewer harmonics would not do to judge others: between three and seven the change may be nothing
by chance."""


def more_than(harmonics: int) -> int:
    """Harmonics of the reference solution, for a balance of this many."""
    return max(2 * harmonics + 1, _LEAST)


def left_out(
    richer: HarmonicBalance, cycle: Cycle, lanes: Lane, responses: PeriodicResponses
) -> np.ndarray:
    """The error of each first harmonic, relative to it, complex ``(L,)``.

    Args:
        richer: a balance with more harmonics.
        cycle: names, as for `respond`.
        lanes: amplitudes, frequencies and parameters, ``(L,)`` each.
        responses: what was found with fewer harmonics.

    Returns:
        The real part is that of the gain, the imaginary one that of the phase [rad]. NaN where
        there is no answer, infinite where more harmonics lead nowhere.
    """
    error = np.full(lanes.amplitude.size, np.nan, complex)
    more = 2 * richer.harmonics + 1 - responses.x.shape[-1]
    share = more / (2 * richer.harmonics)  # of the error, if that falls with the first power
    x = np.pad(responses.x, ((0, 0), (0, 0), (0, more)))

    def judged(who: np.ndarray, at: Cycle) -> np.ndarray:
        reference = over(richer, at, lanes, who, richer.judge, x)
        change = _relative_change(reference.harmonics, lanes.amplitude[who], responses.first[who])
        return np.where(reference.reason == Reason.SETTLED, change / share, np.inf)

    settled = np.flatnonzero(responses.reason == Reason.SETTLED)
    for n, k in sorted(set(zip(responses.samples[settled], responses.stage[settled], strict=True))):
        who = settled[(responses.samples[settled] == n) & (responses.stage[settled] == k)]
        at = staged(cycle, max(n, richer.coarsest), k)
        error[who] = judged(who, at)
        doubtful = who[too_few(_DOUBTFUL * error[who])]
        if doubtful.size:
            solved = over(richer, at, lanes, doubtful, richer.solve, x)
            x[doubtful] = solved.x
            error[doubtful] = judged(doubtful, at)
            error[doubtful[solved.reason != Reason.SETTLED]] = np.inf
    return error


def too_few(error: np.ndarray) -> np.ndarray:
    """Whether an error of `left_out` is beyond what an answer may have, ``(L,)``."""
    with np.errstate(invalid="ignore"):
        gain, phase = np.abs(np.real(error)), np.degrees(np.abs(np.imag(error)))
        return (gain > GAIN_ERROR) | (phase > PHASE_ERROR)


def _relative_change(current: Harmonics, amplitude: np.ndarray, previous: np.ndarray) -> np.ndarray:
    """From a first harmonic to that of ``current``, over its size, turned into its direction."""
    size = np.maximum(np.abs(previous), 1e-3 * current.swing / amplitude)
    along = np.where(np.abs(previous) > 0, previous, 1.0) / np.maximum(np.abs(previous), TINY)
    change = (first_harmonic(current, amplitude) - previous) * along.conj()
    # an output that does not move has no error
    return np.where(size > 0, change / np.where(size > 0, size, 1.0), 0.0)
