"""The searches for periodic orbits: Newton's method by shooting, and by harmonic balance."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import jax
import numpy as np

from diffthrust.describing._periodic import harmonic_balance as hb
from diffthrust.describing._periodic import shooting as shooting
from diffthrust.describing._periodic.period import LANE_BLOCK, TINY, Cycle, Lane, remembers
from diffthrust.describing._periodic.respond import LONGEST_SERIES, Reason, SolvedOrbits, some
from diffthrust.models._base.model import Model
from diffthrust.simulation._trajectory import Key

_COARSEST_SERIES = 1024
"""Steps to the period at first, with an effect that has memory. A rate limit that always acts turns
its series half a step late on the average: twice as many steps then keep it within 0.1 degree."""
_FINEST_SERIES = 16384
"""Steps to the period at last, with such an effect."""
_LANES = 512
"""Lanes of one call."""
_NUMBERS = 2_000_000
"""Numbers in all Jacobians of one call of the harmonic balance: it bounds the memory."""


_Tree = TypeVar("_Tree", shooting.Orbit, hb.Balance)


class Shooting:
    """Orbits by shooting: simulation to the periodic steady state."""

    def __init__(self, model: Model, states: int) -> None:
        self.key = Key(model)
        self.capacity = _LANES
        # few different lengths: each is a program to compile, which takes longer than to run it
        self.coarsest, self.finest, self.growth = (128, 8192, 4) if states else (256, 65536, 4)
        if remembers(model):
            self.coarsest, self.finest = _COARSEST_SERIES, max(self.finest, _FINEST_SERIES)

    def begin(self, cycle: Cycle, count: int, lanes: Lane) -> np.ndarray:
        """The model's own initial states, ``(count, n)``."""
        return np.asarray(shooting.starts(self.key, cycle, count, lanes))[:count]

    def solve(self, cycle: Cycle, count: int, lanes: Lane, x: np.ndarray) -> SolvedOrbits:
        """Newton's method on the period map; where it leads astray, one more period instead."""
        x = np.array(x)
        best = np.full(count, np.inf)  # how far from closed, at the last point that was kept
        after = x[:count].copy()  # one period after that point
        reason = np.full(count, Reason.NOT_CLOSED)
        kept = None
        active = np.arange(count)
        for _ in range(shooting.MOST_PERIODS):
            orbit = self._run(cycle, active, lanes, x)
            step = shooting.closing_step(orbit)
            far = np.abs(step).max(axis=1, initial=0.0)
            kept = _merged(kept, orbit, active, count)
            closed = far <= shooting.ORBIT_CLOSED
            broken = ~np.isfinite(far) & ~np.isfinite(best[active])
            reason[active[closed]] = Reason.SETTLED
            reason[active[broken]] = Reason.DIVERGES
            # a Newton step that leads farther away is dropped; the period after the last good point
            # takes its place, as waiting for the transient would
            worse = ~(far < best[active])
            scale = shooting.scale_of(orbit)
            with np.errstate(invalid="ignore"):
                onward = np.asarray(orbit.start) + scale * step
            onward = np.where(worse[:, None], after[active], onward)
            # after a plain period any Newton step is tried again
            best[active] = np.where(worse, np.inf, far)
            after[active] = np.where(worse[:, None], after[active], np.asarray(orbit.end))
            go = ~closed & ~broken
            active = active[go]
            if not active.size:
                break
            x[active] = onward[go]
        assert kept is not None
        grows = shooting.unstable(kept)
        reason = np.where((reason == Reason.SETTLED) & grows, Reason.UNSTABLE, reason)
        return SolvedOrbits(kept.start, kept.harmonics, reason)

    def again(self, cycle: Cycle, count: int, lanes: Lane, x: np.ndarray) -> SolvedOrbits:
        """One more period from where the orbits ended."""
        now = self._run(cycle, np.arange(count), lanes, x)
        following = np.array(x)
        following[:count] = now.end
        orbit = self._run(cycle, np.arange(count), lanes, following)
        return SolvedOrbits(orbit.start, orbit.harmonics, np.full(count, Reason.SETTLED))

    def _run(self, cycle: Cycle, who: np.ndarray, lanes: Lane, x: np.ndarray) -> shooting.Orbit:
        front, begin = _front(lanes, x, who)
        return _cut(shooting.periods(self.key, cycle, who.size, front, begin), who.size)


class HarmonicBalance:
    """Orbits by harmonic balance."""

    def __init__(self, model: Model, states: int, harmonics: int) -> None:
        self.key = Key(model)
        self.harmonics = harmonics
        unknowns = (states * (2 * harmonics + 1)) ** 2
        self.capacity = max(
            LANE_BLOCK, min(_LANES, _NUMBERS // unknowns) // LANE_BLOCK * LANE_BLOCK
        )
        self.coarsest = max(32, 1 << (4 * harmonics - 1).bit_length())
        if remembers(model):
            self.coarsest = max(self.coarsest, _COARSEST_SERIES)
        self.finest, self.growth = max(4096, self.coarsest), 2

    def begin(self, cycle: Cycle, count: int, lanes: Lane) -> np.ndarray:
        """Constant states, the model's own initial ones, ``(count, n, c)``."""
        first = np.asarray(shooting.starts(self.key, cycle, count, lanes))[:count]
        x = np.zeros((*first.shape, 2 * self.harmonics + 1))
        x[:, :, 0] = first
        return x

    def solve(self, cycle: Cycle, count: int, lanes: Lane, x: np.ndarray) -> SolvedOrbits:
        """Newton's method, its step halved where it would lead further away.

        Further in Deuflhard's natural measure: by the length of the step that the Jacobian of the
        last point would take from the new one. The rest itself will not do, for its parts have
        the units of different states.
        """
        x = np.array(x)
        point, step = x[:count].copy(), np.zeros_like(x[:count])
        share, length = np.ones(count), np.full(count, np.inf)
        reason = np.full(count, Reason.NOT_CLOSED)
        kept: hb.Balance | None = None
        active = np.arange(count)
        for _ in range(hb.MOST_EVALUATIONS):
            missed = self._run(cycle, active, lanes, x)
            keep = np.isfinite(missed.rest).all(axis=(1, 2))
            if kept is None:
                reason[~keep] = Reason.DIVERGES
                kept = _merged(None, missed, active, count)
            else:
                unit = _size(point[active] + step[active])
                old = np.asarray(kept.slope)[active]
                bar = hb.balancing_step(old, missed.rest) / unit[:, :, None]
                with np.errstate(invalid="ignore"):
                    keep &= np.abs(bar).max(axis=(1, 2)) <= length[active]
                # halved ten times without a gain: the step is taken as it is, for a corner may lie
                # in between
                keep |= share[active] <= hb.SHORTEST_SHARE
            new = active[keep]
            kept = _merged(kept, missed, new, count, keep)
            point[new], share[new] = x[new], np.minimum(1.0, 4.0 * share[new])
            step[new] = hb.balancing_step(missed.slope[keep], missed.rest[keep])
            share[active[~keep]] *= 0.5
            unit = _size(point[active] + step[active])
            length[active] = (np.abs(step[active]) / unit[:, :, None]).max(axis=(1, 2))
            closed = keep & (length[active] <= hb.ORBIT_BALANCED)
            reason[active[closed]] = Reason.SETTLED
            broken = ~np.isfinite(length[active])
            reason[active[broken]] = Reason.DIVERGES
            active = active[~closed & ~broken]
            if not active.size:
                break
            x[active] = point[active] + share[active][:, None, None] * step[active]
        assert kept is not None
        return SolvedOrbits(point, kept.harmonics, reason)

    def again(self, cycle: Cycle, count: int, lanes: Lane, x: np.ndarray) -> SolvedOrbits:
        """The same coefficients on a later clock, those that drift a period further."""
        every = np.arange(count)
        now = self._run(cycle, every, lanes, x)
        drifts = hb.drifting(np.asarray(now.slope)).reshape(now.rest.shape)
        period = (2.0 * np.pi / lanes.frequency[:count])[:, None, None]
        x = np.array(x)
        x[:count] -= np.where(drifts, now.rest * period, 0.0)
        later = self._run(cycle, every, lanes, x)
        return SolvedOrbits(x[:count], later.harmonics, np.full(count, Reason.SETTLED))

    def judge(self, cycle: Cycle, count: int, lanes: Lane, x: np.ndarray) -> SolvedOrbits:
        """One step towards the balance that many more instants than the cycle's ask for.

        The slope is that at the cycle's own instants: a step needs to be right in its first digits.
        """
        every, x = np.arange(count), np.array(x)
        dense = min(max(hb.DENSE_STEPS, cycle.samples), LONGEST_SERIES // (2 * cycle.periods))
        many = replace(cycle, samples=dense)
        slope = self._run(cycle, every, lanes, x).slope
        x[:count] += hb.balancing_step(slope, self._run(many, every, lanes, x, sloped=False).rest)
        judged = self._run(many, every, lanes, x, sloped=False).harmonics
        fine = np.isfinite(x[:count]).all(axis=(1, 2))
        return SolvedOrbits(x[:count], judged, np.where(fine, Reason.SETTLED, Reason.NOT_CLOSED))

    def _run(
        self, cycle: Cycle, who: np.ndarray, lanes: Lane, x: np.ndarray, sloped: bool = True
    ) -> hb.Balance:
        front, begin = _front(lanes, x, who)
        cycle = replace(cycle, harmonics=self.harmonics)
        return _cut(hb.balances(self.key, cycle, sloped, who.size, front, begin), who.size)


def _size(x: np.ndarray) -> np.ndarray:
    """The largest coefficient of each state, ``(lanes, n)``."""
    return np.abs(x).max(axis=2) + TINY


def _front(lanes: Lane, x: np.ndarray, who: np.ndarray) -> tuple[Lane, np.ndarray]:
    """Some lanes moved to the front, the last of them repeated behind."""
    order = np.concatenate([who, np.full(x.shape[0] - who.size, who[-1])])
    return some(lanes, order), x[order]


def _cut(of_lanes: _Tree, count: int) -> _Tree:
    return jax.tree.map(lambda a: np.asarray(a)[:count], of_lanes)


def _merged(
    kept: _Tree | None,
    new: _Tree,
    who: np.ndarray,
    count: int,
    flags: np.ndarray | slice = slice(None),
) -> _Tree:
    """The kept values of all lanes, with those of ``who`` updated."""
    if kept is None:
        kept = jax.tree.map(lambda a: np.zeros((count, *a.shape[1:])), new)

    def put(old: np.ndarray, now: np.ndarray) -> np.ndarray:
        old[who] = now[flags]
        return old

    return jax.tree.map(put, kept, new)
