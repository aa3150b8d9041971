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
    """Why a lane has no answer.

    Example:
        >>> [reason.name for reason in dft.describing.Reason][:2]
        ['SETTLED', 'DIVERGES']
    """

    SETTLED = 0
    DIVERGES = 1
    NOT_CLOSED = 2
    UNSTABLE = 3
    COARSE = 4
    MEMORY = 5
    CLOCK = 6
    FEW_HARMONICS = 7

    @property
    def words(self) -> str:
        """The reason in words.

        Example:
            >>> [reason.words for reason in dft.describing.Reason][:2]
            ['settled', 'the response diverges']
        """
        return _WORDS[self]


_WORDS = {
    Reason.SETTLED: "settled",
    Reason.DIVERGES: "the response diverges",
    Reason.NOT_CLOSED: "no response that repeats was found",
    Reason.UNSTABLE: "the response that repeats is unstable",
    Reason.COARSE: "the first harmonic still moves as the steps get finer",
    Reason.MEMORY: "an effect with memory does not forget how it began",
    Reason.CLOCK: "the response drifts, or changes with the time of the log",
    Reason.FEW_HARMONICS: "more harmonics would change the first one by more than it may err",
}


class SolvedOrbits(NamedTuple):
    """What a search at one step length gave, by lane."""

    x: np.ndarray
    """What it searched for."""
    harmonics: Harmonics
    reason: np.ndarray
    """``SETTLED`` where it found an orbit."""


class Solver(Protocol):
    """A way to find periodic orbits."""

    capacity: int
    """Lanes of one call."""
    coarsest: int
    """Steps to the period at first."""
    finest: int
    growth: int
    """Finer steps are finer by this factor."""

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
    """Periodic responses by lane, ``(L,)`` each.

    Args:
        first: first harmonic of the output over the amplitude of the input, complex.
        mean: of the output.
        distortion: higher harmonics over the first.
        reason: see `Reason`.
        samples: steps to the period.
        stage: of `STAGES`, in which effects with memory settled.
        x: the orbits, as the solver knows them.
    """

    first: np.ndarray
    mean: np.ndarray
    distortion: np.ndarray
    reason: np.ndarray
    samples: np.ndarray
    stage: np.ndarray
    x: np.ndarray


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
    steps = np.full(size, samples or max(cycle.samples, solver.coarsest))
    last_steps = samples or solver.finest
    stage = np.zeros(size, int)
    without_guess = guess is None
    origin = over(solver, cycle, lanes, np.arange(size), solver.begin) if without_guess else guess
    x: np.ndarray = np.array(origin)
    mean, distortion, first = np.zeros(size), np.zeros(size), np.zeros(size, complex)
    previous = np.full(size, np.nan, complex)
    reason, failed = np.full(size, -1), np.zeros(size, int)
    while (active := np.flatnonzero(reason < 0)).size:
        for n, k in sorted(set(zip(steps[active], stage[active], strict=True))):
            who = active[(steps[active] == n) & (stage[active] == k)]
            at = staged(cycle, n, k)
            orbits = over(solver, at, lanes, who, solver.solve, x)
            h = orbits.harmonics
            first[who] = first_harmonic(h, lanes.amplitude[who])
            mean[who], distortion[who] = h.mean, h.distortion
            bad = orbits.reason != Reason.SETTLED
            # a failed search has left its point anywhere: the finer steps begin at the origin again
            x[who] = np.where(_like(bad, x), np.asarray(origin)[who], orbits.x)
            failed[who] += orbits.reason == Reason.NOT_CLOSED
            # all stages first, then finer steps; an output that does not move may still wait for
            # the end of a delay
            still = (at.periods > 1) & (h.swing <= _STILL * np.abs(h.mean))
            restless = ~bad & (~(h.unsettled <= _REPEATED) | still & (at.periods < _LONGEST))
            later = [i for i in range(k + 1, len(STAGES)) if 2 * n * STAGES[i][0] <= LONGEST_SERIES]
            stage[who] = np.where(restless, later[0] if later else k, k)
            floor = 1e-3 * h.swing / lanes.amplitude[who]
            change = np.abs(first[who] - previous[who])
            # for a first-order error the change from n to g n steps is (g - 1) times the error that
            # is left
            near = change <= _FINE * (solver.growth - 1) * np.maximum(np.abs(first[who]), floor)
            near = near | still | (samples is not None)
            reason[who[~bad & ~restless & near]] = Reason.SETTLED
            finer = bad | (~restless & ~near) | (restless & (not later))
            previous[who] = np.where(bad | restless, np.nan, first[who])
            finer_steps = solver.growth * n
            last = min(last_steps, LONGEST_SERIES // (2 * at.periods))
            finished = finer & ((finer_steps > last) | (failed[who] >= _FAILURES))
            unclear = np.where(restless, Reason.MEMORY, Reason.COARSE)
            reason[who[finished]] = np.where(bad, orbits.reason, unclear)[finished]
            steps[who[finer & ~finished]] = finer_steps
            tell("periodic responses", float(np.mean(reason >= 0)))
    _check_again(solver, cycle, lanes, x, first, mean, reason, steps, stage)
    return PeriodicResponses(first, mean, distortion, reason, steps, stage, x)


def _check_again(
    solver: Solver, cycle: Cycle, lanes: Lane, x: np.ndarray, first: np.ndarray, mean: np.ndarray,
    reason: np.ndarray, steps: np.ndarray, stage: np.ndarray,
) -> None:  # fmt: skip
    """Mark the lanes that a further period, on a later clock, shows not to have settled."""
    later = lanes._replace(clock=np.full_like(lanes.amplitude, _LATER))
    settled = np.flatnonzero(reason == Reason.SETTLED)
    for n, k in sorted(set(zip(steps[settled], stage[settled], strict=True))):
        who = settled[(steps[settled] == n) & (stage[settled] == k)]
        at = staged(cycle, n, k)
        orbits = over(solver, at, later, who, solver.again, x)
        h = orbits.harmonics
        amplitude = lanes.amplitude[who]
        change = np.abs(first_harmonic(h, amplitude) - first[who])
        swing = np.maximum(h.swing / amplitude, np.abs(first[who]))
        moved = np.abs(h.mean - mean[who]) / amplitude
        same = (change <= _SAME * np.maximum(np.abs(first[who]), 1e-3 * swing)) & (
            moved <= _SAME * swing
        )
        reason[who] = np.where(orbits.reason == Reason.SETTLED, reason[who], orbits.reason)
        reason[who[(orbits.reason == Reason.SETTLED) & ~same]] = Reason.CLOCK


def staged(cycle: Cycle, samples: int, stage: int) -> Cycle:
    """The cycle at this many steps and stage of `STAGES`, which only effects with memory have."""
    if cycle.periods == 1:
        return replace(cycle, samples=int(samples))
    periods, sought = STAGES[stage]
    return replace(cycle, samples=int(samples), periods=periods, sought=sought)


def first_harmonic(output: Harmonics, amplitude: np.ndarray) -> np.ndarray:
    """The first harmonic of the output over that of the input, complex ``(L,)``."""
    return (output.in_phase + 1j * output.ahead) / amplitude


def _like(flags: np.ndarray, x: np.ndarray) -> np.ndarray:
    return flags.reshape(flags.size, *([1] * (x.ndim - 1)))


def over(
    solver: Solver,
    cycle: Cycle,
    lanes: Lane,
    who: np.ndarray,
    act: Callable[..., Any],
    x: Any = None,
) -> Any:
    """An act of the solver on some lanes, in portions that the cores of the machine share."""
    portions = [*_portions(who, solver.capacity)]

    def one(lanes_at: np.ndarray) -> Any:
        guesses = () if x is None else (_padded(x[lanes_at], solver.capacity),)
        return act(cycle, lanes_at.size, some(lanes, _padded(lanes_at, solver.capacity)), *guesses)

    # threads, for XLA computes without the interpreter's lock
    parts = [one(portions[0])] if len(portions) == 1 else [*pool().map(one, portions)]
    order = np.argsort(np.concatenate(portions), kind="stable")
    return jax.tree.map(lambda *values: np.concatenate(values)[order], *parts)


def _portions(who: np.ndarray, capacity: int) -> Iterator[np.ndarray]:
    """Lanes in portions of equal work: neighbours, who are equally slow, are dealt out in turn."""
    cores = os.cpu_count() or 1
    least = -(-who.size // LANE_BLOCK) if who.size else 1
    count = max(-(-who.size // capacity), min(cores, least))
    for i in range(count):
        yield who[i::count]


def _padded(values: np.ndarray, size: int) -> np.ndarray:
    """Filled up to ``size`` with the last lane, which is worked out again at most."""
    return np.concatenate([values, np.repeat(values[-1:], size - values.shape[0], axis=0)])


def some(of_lanes: Any, who: np.ndarray) -> Any:
    """Some of the lanes, of a tree of arrays by lane."""
    return jax.tree.map(lambda values: np.asarray(values)[who], of_lanes)


def front(lanes: Lane, x: np.ndarray, who: np.ndarray) -> tuple[Lane, np.ndarray]:
    """Some lanes moved to the front, the last of them repeated behind."""
    order = np.concatenate([who, np.full(x.shape[0] - who.size, who[-1])])
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
