"""Periodic responses of many lanes, each with steps as fine as it needs.

Every lane begins with few steps to the period. They are multiplied until its first harmonic stays
where it is, and an effect with memory goes through stages until its series repeats. Then the orbit
is run through once more on a later clock: what has settled gives the same again. A lane that fails
one of these checks is marked with the reason, never passed on as an answer. A failed search is
retried from the solutions of its neighbours in amplitude and frequency.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from enum import IntEnum
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

import jax
import numpy as np

from diffthrust._support.progress import Progress, reporter
from diffthrust.describing._periodic.period import LANE_BLOCK, Cycle, Harmonics, Lane

_FINE = 2e-4
"""The error that is left in a first harmonic. It is judged by the change as the steps get finer, as
if it fell with their first power, which is so where an effect has corners; elsewhere it falls with
the second to the fourth and is far smaller."""
LONGEST_SERIES = 2**20
"""Instants of a series with all its periods, at most: what the memory holds."""
_REPEATED = 1e-6
"""An effect with memory has settled where its series changes less over a period, of its swing."""
_SAME = 1e-4
"""A further period may change the first harmonic and the mean by no more than this."""
STAGES = ((4, False), (4, True), (32, False), (256, False), (4, True))
"""What an effect with memory that has not settled gets, in this order: periods, and whether its
start is sought. A rate limit settles in the second, a long delay in the third or fourth; in the
last the steps get finer until a rate limit feels small offsets."""
_LONGEST = max(periods for periods, _ in STAGES)
_STILL = 1e-6
"""An output that swings less, of its mean, does not move."""
_LATER = 1e5
"""Clock [s] of the further period: a model that changes with the time of a log shows itself."""
_FAILURES = 3
"""Step lengths at which the search for an orbit may end without one: while the steps are too long
for the model, there may be none."""
_SWEEPS = 12
"""Solutions spread by at most this many points of the map."""


class Reason(IntEnum):
    """Why a lane has no answer, and this in ``words``.

    Example:
        >>> [reason.name for reason in dft.describing.Reason][:2]
        ['SETTLED', 'DIVERGES']
        >>> [reason.words for reason in dft.describing.Reason][:2]
        ['settled', 'the response diverges']
    """

    words: str

    SETTLED = 0, "settled"
    DIVERGES = 1, "the response diverges"
    NOT_CLOSED = 2, "no response that repeats was found"
    UNSTABLE = 3, "the response that repeats is unstable"
    COARSE = 4, "the first harmonic still moves as the steps get finer"
    MEMORY = 5, "an effect with memory does not forget how it began"
    CLOCK = 6, "the response drifts, or changes with the time of the log"
    FEW_HARMONICS = 7, "more harmonics would change the first one by more than it may err"

    def __new__(cls, value: int, words: str) -> Reason:
        member = int.__new__(cls, value)
        member._value_, member.words = value, words
        return member


class SolvedOrbits(NamedTuple):
    """What a search at one step length gave, by lane: orbits where the reason is ``SETTLED``."""

    x: np.ndarray
    harmonics: Harmonics
    reason: np.ndarray


class Solver(Protocol):
    """A way to find periodic orbits."""

    capacity: int  # lanes of one call
    coarsest: int  # steps to the period, from these
    finest: int  # to these
    growth: int  # multiplied by this

    def begin(self, cycle: Cycle, count: int, lanes: Lane) -> np.ndarray:
        """Where the search starts, by lane."""
        ...

    def solve(self, cycle: Cycle, count: int, lanes: Lane, x: np.ndarray) -> SolvedOrbits:
        """Search from ``x``."""
        ...

    def again(self, cycle: Cycle, count: int, lanes: Lane, x: np.ndarray) -> SolvedOrbits:
        """One further period of orbits that were found."""
        ...


@dataclass(frozen=True)
class PeriodicResponses:
    """Periodic responses by lane, ``(L,)`` each."""

    first: np.ndarray  # first harmonic of the output over the amplitude of the input, complex
    mean: np.ndarray
    distortion: np.ndarray
    reason: np.ndarray  # -1 where the search goes on
    samples: np.ndarray
    stage: np.ndarray  # of `STAGES`
    x: np.ndarray  # the orbits, as the solver knows them

    def alike(self, cycle: Cycle, who: np.ndarray) -> Iterator[tuple[np.ndarray, Cycle]]:
        """Lanes of equal steps and stage (of an effect with memory) together, with their cycle."""
        for n, k in sorted(set(zip(self.samples[who], self.stage[who], strict=True))):
            periods, sought = (1, False) if cycle.periods == 1 else STAGES[k]
            at = replace(cycle, samples=int(n), periods=periods, sought=sought)
            yield who[(self.samples[who] == n) & (self.stage[who] == k)], at


def respond(
    solver: Solver,
    cycle: Cycle,
    lanes: Lane,
    *,
    samples: int | None = None,
    guess: np.ndarray | None = None,
    progress: Progress | None = None,
) -> PeriodicResponses:
    """The periodic responses of all lanes, ``(L,)``.

    The search starts with the cycle's samples, unless the steps to the period are fixed by
    ``samples``; and with the guess in place of the model's own initial states.
    """
    tell, size = reporter(progress), lanes.amplitude.size
    origin = over(solver, cycle, lanes, np.arange(size), solver.begin) if guess is None else guess
    responses = PeriodicResponses(
        first=np.zeros(size, complex),
        mean=np.zeros(size),
        distortion=np.zeros(size),
        reason=np.full(size, -1),
        samples=np.full(size, samples or max(cycle.samples, solver.coarsest)),
        stage=np.zeros(size, int),
        x=np.array(origin),
    )
    previous = np.full(size, np.nan, complex)
    failed = np.zeros(size, int)
    while (active := np.flatnonzero(responses.reason < 0)).size:
        for who, at in responses.alike(cycle, active):
            orbits = over(solver, at, lanes, who, solver.solve, responses.x)
            h = orbits.harmonics
            n, k = at.samples, int(responses.stage[who[0]])
            first = first_harmonic(h, lanes.amplitude[who])
            responses.first[who], responses.mean[who] = first, h.mean
            responses.distortion[who] = h.distortion
            bad = orbits.reason != Reason.SETTLED
            # a failed search has left its point anywhere: the finer steps begin at the origin again
            responses.x[who] = np.where(_like(bad, responses.x), np.asarray(origin)[who], orbits.x)
            failed[who] += orbits.reason == Reason.NOT_CLOSED
            # all stages first, then finer steps; an output that does not move may still wait for
            # the end of a delay
            still = (at.periods > 1) & (h.swing <= _STILL * np.abs(h.mean))
            restless = ~bad & (~(h.unsettled <= _REPEATED) | still & (at.periods < _LONGEST))
            later = [i for i in range(k + 1, len(STAGES)) if 2 * n * STAGES[i][0] <= LONGEST_SERIES]
            responses.stage[who] = np.where(restless, later[0] if later else k, k)
            floor = 1e-3 * h.swing / lanes.amplitude[who]
            change = np.abs(first - previous[who])
            # a first-order error changes by (g - 1) times what is left of it from n to g n steps
            near = change <= _FINE * (solver.growth - 1) * np.maximum(np.abs(first), floor)
            near = near | still | (samples is not None)
            responses.reason[who[~bad & ~restless & near]] = Reason.SETTLED
            finer = bad | (~restless & ~near) | (restless & (not later))
            previous[who] = np.where(bad | restless, np.nan, first)
            last = min(samples or solver.finest, LONGEST_SERIES // (2 * at.periods))
            finished = finer & ((solver.growth * n > last) | (failed[who] >= _FAILURES))
            unclear = np.where(restless, Reason.MEMORY, Reason.COARSE)
            responses.reason[who[finished]] = np.where(bad, orbits.reason, unclear)[finished]
            responses.samples[who[finer & ~finished]] = solver.growth * n
            tell("periodic responses", float(np.mean(responses.reason >= 0)))
    _check_again(solver, cycle, lanes, responses)
    return responses


def _check_again(solver: Solver, cycle: Cycle, lanes: Lane, responses: PeriodicResponses) -> None:
    """Mark the lanes that a further period, on a later clock, shows not to have settled."""
    later = lanes._replace(clock=np.full_like(lanes.amplitude, _LATER))
    for who, at in responses.alike(cycle, np.flatnonzero(responses.reason == Reason.SETTLED)):
        orbits = over(solver, at, later, who, solver.again, responses.x)
        h, amplitude = orbits.harmonics, lanes.amplitude[who]
        first = np.abs(responses.first[who])
        change = np.abs(first_harmonic(h, amplitude) - responses.first[who])
        swing = np.maximum(h.swing / amplitude, first)
        moved = np.abs(h.mean - responses.mean[who]) / amplitude
        same = (change <= _SAME * np.maximum(first, 1e-3 * swing)) & (moved <= _SAME * swing)
        settled = orbits.reason == Reason.SETTLED
        responses.reason[who] = np.where(settled, responses.reason[who], orbits.reason)
        responses.reason[who[settled & ~same]] = Reason.CLOCK


def first_harmonic(output: Harmonics, amplitude: np.ndarray) -> np.ndarray:
    """The first harmonic of the output over that of the input, complex ``(L,)``."""
    return (output.in_phase + 1j * output.ahead) / amplitude


def _like(by_lane: np.ndarray, x: np.ndarray) -> np.ndarray:
    return by_lane.reshape(-1, *([1] * (x.ndim - 1)))


def over(
    solver: Solver,
    cycle: Cycle,
    lanes: Lane,
    who: np.ndarray,
    act: Callable[..., Any],
    x: Any = None,
) -> Any:
    """An act of the solver on some lanes, in portions that the cores of the machine share."""
    least = -(-who.size // LANE_BLOCK) if who.size else 1
    count = max(-(-who.size // solver.capacity), min(os.cpu_count() or 1, least))
    # of equal work: neighbours, who are equally slow, are dealt out in turn
    portions = [who[i::count] for i in range(count)]

    def acted(lanes_at: np.ndarray) -> Any:
        guesses = () if x is None else (_padded(x[lanes_at], solver.capacity),)
        return act(cycle, lanes_at.size, some(lanes, _padded(lanes_at, solver.capacity)), *guesses)

    # threads, for XLA computes without the interpreter's lock
    parts = [acted(portions[0])] if len(portions) == 1 else [*pool().map(acted, portions)]
    order = np.argsort(np.concatenate(portions), kind="stable")
    return jax.tree.map(lambda *values: np.concatenate(values)[order], *parts)


def _padded(values: np.ndarray, size: int) -> np.ndarray:
    """Filled up to ``size`` with the last lane, which is worked out again at most."""
    return np.concatenate([values, np.repeat(values[-1:], size - values.shape[0], axis=0)])


def some(of_lanes: Any, who: np.ndarray) -> Any:
    """Some of the lanes, of a tree of arrays by lane."""
    return jax.tree.map(lambda values: np.asarray(values)[who], of_lanes)


def front(lanes: Lane, x: np.ndarray, who: np.ndarray) -> tuple[Lane, np.ndarray]:
    """Some lanes moved to the front, the last of them repeated behind."""
    order = _padded(who, x.shape[0])
    return some(lanes, order), x[order]


def merged(kept: Any, new: Any, who: np.ndarray, count: int) -> Any:
    """The kept values of all lanes, with those of ``who`` updated; a tree of arrays by lane."""
    if kept is None:
        kept = jax.tree.map(lambda a: np.zeros((count, *a.shape[1:])), new)
    for old, now in zip(jax.tree.leaves(kept), jax.tree.leaves(new), strict=True):
        old[who] = now
    return kept


@lru_cache(maxsize=1)
def pool() -> ThreadPoolExecutor:
    """The threads that share the portions."""
    return ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="diffthrust-map")


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
    starts; without one, that of the neighbour in frequency. ``shape`` counts draws, amplitudes and
    frequencies.
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
        guess = responses.x[source] * _like(ratio, responses.x)
        more = respond(solver, cycle, some(lanes, retried), samples=samples, guess=guess)
        better = more.reason == Reason.SETTLED
        if not better.any():
            break
        for field in fields(PeriodicResponses):
            getattr(responses, field.name)[retried[better]] = getattr(more, field.name)[better]
    return responses


def _neighbours(settled: np.ndarray) -> np.ndarray:
    """For each lane one beside it that settled, or -1; ``(D * A * F,)``."""
    index = np.where(settled, np.arange(settled.size).reshape(settled.shape), -1)
    beside = np.full(settled.shape, -1)
    for axis in (2, 1):  # a neighbour in amplitude overrides one in frequency
        for shift in (-1, 1):
            at = np.roll(index, shift, axis)
            np.moveaxis(at, axis, 0)[0 if shift == 1 else -1] = -1  # beyond the map
            beside = np.where(at >= 0, at, beside)
    return beside.reshape(-1)
