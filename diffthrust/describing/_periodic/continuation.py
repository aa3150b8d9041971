"""Failed searches are retried from the solutions of their neighbours in amplitude and frequency."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from diffthrust._support.progress import Progress
from diffthrust.describing._periodic.period import Cycle, Lane
from diffthrust.describing._periodic.respond import PeriodicResponses, Reason, Solver, respond, some

_SWEEPS = 12
"""Solutions spread by at most this many points of the map."""
# where Newton's method led astray; other marks are answers of their own
_LOST = (Reason.NOT_CLOSED, Reason.DIVERGES)


def respond_with_neighbours(
    solver: Solver,
    cycle: Cycle,
    lanes: Lane,
    shape: tuple[int, int, int],
    *,
    samples: int | None = None,
    progress: Progress | None = None,
) -> PeriodicResponses:
    """`respond`, and again for lanes that found nothing beside some that did.

    The orbit of the neighbour in amplitude, scaled by the ratio of both, is where such a lane
    starts; without one, that of the neighbour in frequency.

    Args:
        solver: how orbits are found.
        cycle: as for `respond`.
        lanes: all lanes, of the shape of ``shape`` made flat.
        shape: draws, amplitudes and frequencies.
        samples: as for `respond`.
        progress: as for `respond`.
    """
    responses = respond(solver, cycle, lanes, samples=samples, progress=progress)
    for _ in range(_SWEEPS):
        lost = np.isin(responses.reason, _LOST)
        beside = _neighbours((responses.reason == Reason.SETTLED).reshape(shape))
        retried = np.flatnonzero(lost & (beside >= 0))
        if not retried.size:
            break
        source = beside[retried]
        ratio = lanes.amplitude[retried] / lanes.amplitude[source]
        guess = responses.x[source] * ratio.reshape(-1, *([1] * (responses.x.ndim - 1)))
        more = respond(solver, cycle, some(lanes, retried), samples=samples, guess=guess)
        better = more.reason == Reason.SETTLED
        if not better.any():
            break
        for field in fields(PeriodicResponses):
            getattr(responses, field.name)[retried[better]] = getattr(more, field.name)[better]
    return responses


def _neighbours(settled: np.ndarray) -> np.ndarray:
    """For each lane one beside it that settled, or -1; ``(D * A * F,)``."""
    index = np.arange(settled.size).reshape(settled.shape)
    beside = np.full(settled.shape, -1)
    for axis in (2, 1):  # a neighbour in amplitude overrides one in frequency
        for shift in (-1, 1):
            at = np.roll(index, shift, axis)
            neighbour_settled = np.roll(settled, shift, axis)
            edge = [slice(None)] * 3
            edge[axis] = slice(0, 1) if shift == 1 else slice(-1, None)
            neighbour_settled[tuple(edge)] = False
            beside = np.where(neighbour_settled, at, beside)
    return beside.reshape(-1)
