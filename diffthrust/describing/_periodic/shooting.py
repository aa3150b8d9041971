"""The periodic orbit of a model under a sinusoid, by shooting.

The states after one period are a function of those before it; the orbit is where both are equal.
Newton's method finds it with the forward-mode Jacobian of that function, which the integration
gives along the way. Waiting for the transient instead would take thousands of periods where a
thruster turns slowly under a fast command: its damping vanishes with its speed.

Source: Nayfeh & Balachandran 1995, Applied Nonlinear Dynamics, section 6.1 (shooting); section 3.2
(stability by the multipliers of the period map).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from diffthrust._support._running.programs import program
from diffthrust.describing._periodic.period import (
    TINY,
    Cycle,
    Harmonics,
    Lane,
    Numbers,
    driven_period,
    harmonics_of,
    held_fast,
    idle,
    in_blocks,
    remembers,
    start_of,
)
from diffthrust.describing._periodic.respond import Reason, SolvedOrbits, front, merged, some
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Relaxing
from diffthrust.simulation._integrate import integrate
from diffthrust.simulation._trajectory import Key, rates_of

_MOST_PERIODS = 40
"""Periods that may be integrated for one orbit, at one step length."""
_ORBIT_CLOSED = 1e-7
"""An orbit is found where Newton's next step is so short against the swing of the states."""
_FREE = 1e-9
"""A direction in which the period map changes this little of a displacement is not held by the
model, as the position of a vehicle that nothing pulls back."""
_UNSTABLE = 1e-6
"""Margin by which a multiplier of the period map may exceed one: rounding, and free directions."""

LANES = 512
"""Lanes of one call."""
COARSEST_SERIES = 1024
"""Steps to the period at first, with an effect that has memory. A rate limit that always acts turns
its series half a step late on the average: twice as many steps then keep it within 0.1 degree."""
_FINEST_SERIES = 16384
"""Steps to the period at last, with such an effect."""


class Orbit(NamedTuple):
    """What one period shows, by lane: states at its start and end, and the output."""

    start: Float[Numbers, "*lanes n"]
    end: Float[Numbers, "*lanes n"]
    slope: Float[Numbers, "*lanes n n"]  # of the end with respect to the start
    swing: Float[Numbers, "*lanes n"]  # largest less least value of each state
    harmonics: Harmonics


def one_period(model: Model, cycle: Cycle, lane: Lane, start: Float[Array, " n"]) -> Orbit:
    """Integrate over one period, with the derivative with respect to the start ``(n,)``."""
    series = driven_period(model, cycle, lane)
    names, constant_states = cycle.states, start_of(model, series)
    inputs = {n: (v[:-1:2], v[1::2], v[2::2]) for n, v in series.inputs.items()}
    inputs["time"] = series.time[:-1:2], series.time[1::2], series.time[2::2]
    steps = jnp.full(cycle.samples, 2.0 * jnp.pi / lane.frequency / cycle.samples)

    def rates(state: Mapping[str, Array], u: Mapping[str, Array]) -> dict[str, Array | Relaxing]:
        slopes = rates_of(model, names, {**constant_states, **state}, u)
        return {n: k for n, k in slopes.items() if n in names}

    def end_of(x: Float[Array, " n"]) -> tuple[Array, dict[str, Array]]:
        begin = {name: x[i] for i, name in enumerate(names)}
        path = integrate(rates, begin, inputs, steps, {}, uniform=True)
        return jnp.stack([path[name][-1] for name in names]), path

    def harmonics(size: int, path: Mapping[str, Array]) -> Harmonics:
        still = {name: jnp.full(size, value) for name, value in constant_states.items()}
        return harmonics_of(model, cycle, lane, series, {**still, **path})

    if not names:
        empty = jnp.zeros(0)
        return Orbit(empty, empty, jnp.zeros((0, 0)), empty, harmonics(2 * cycle.samples + 1, {}))
    # few states: their tangents ride along with the integration
    along, path = jax.jacfwd(end_of, has_aux=True)(start)
    swing = jnp.stack([jnp.max(path[n]) - jnp.min(path[n]) for n in names])
    end = jnp.stack([path[n][-1] for n in names])
    return Orbit(start, end, along, swing, harmonics(cycle.samples + 1, path))


@program(2)
def periods(
    key: Key, cycle: Cycle, count: int, lanes: Lane, start: Float[Numbers, "lanes n"]
) -> Orbit:
    """`one_period` of the first ``count`` lanes, from ``start`` ``(lanes, n)``."""

    def followed(lane_and_start: tuple[Lane, Array]) -> Orbit:
        lane, begin = lane_and_start
        return one_period(key.model.bind(lane.values), cycle, lane, begin)

    return in_blocks(followed, count, (lanes, start))


@program(2)
def starts(key: Key, cycle: Cycle, count: int, lanes: Lane) -> Float[Array, "lanes n"]:
    """Where the states that are followed begin by themselves, of the first ``count`` lanes."""

    def begun(lane: Lane) -> Float[Array, " n"]:
        model = key.model.bind(lane.values)
        start = start_of(model, driven_period(model, cycle, lane))
        return jnp.stack([start[n] for n in cycle.states]) if cycle.states else jnp.zeros(0)

    return in_blocks(begun, count, lanes)


def closing_step(orbit: Orbit) -> Float[np.ndarray, "lanes n"]:
    """The step that would close each orbit, in units of the swing of its states, ``(lanes, n)``.

    Directions that the model does not hold are left alone. NaN where the period diverges.
    """
    scale = scale_of(orbit)
    residual = (np.asarray(orbit.end) - np.asarray(orbit.start)) / scale
    slope = np.asarray(orbit.slope) * scale[:, None, :] / scale[:, :, None]
    matrix = np.eye(residual.shape[1]) - slope
    fine = np.asarray(np.isfinite(residual).all(axis=1) & np.isfinite(matrix).all(axis=(1, 2)))
    held_fast(matrix, residual, idle(matrix, _FREE) & fine[:, None])
    step = np.full(residual.shape, np.nan)
    if residual.shape[1] == 1:
        held = fine & (np.abs(matrix[:, 0, 0]) > _FREE)
        step[fine] = 0.0
        step[held, 0] = residual[held, 0] / matrix[held, 0, 0]
    elif fine.any():
        u, s, vh = np.linalg.svd(matrix[fine])
        # the shortest step: nothing along directions that the model does not hold, as a vehicle's
        # position
        inverse = np.where(s > _FREE, 1.0 / np.maximum(s, _FREE), 0.0)
        along = inverse * np.einsum("lji,lj->li", u, residual[fine])
        step[fine] = np.einsum("lij,li->lj", vh, along)
    return step


def scale_of(orbit: Orbit) -> Float[np.ndarray, "lanes n"]:
    """The swing of each state, or its size where it does not swing, ``(lanes, n)``."""
    swing, size = np.asarray(orbit.swing), np.abs(np.asarray(orbit.start))
    with np.errstate(invalid="ignore"):
        return np.where(swing > 1e-9 * size, swing, np.where(size > 0, size, 1.0)) + TINY


def unstable(orbit: Orbit) -> Bool[np.ndarray, " lanes"]:
    """Whether a small displacement from each orbit grows from period to period, ``(lanes,)``."""
    slope = np.asarray(orbit.slope)
    fine = np.isfinite(slope).all(axis=(1, 2))
    grows = np.zeros(slope.shape[0], bool)
    multipliers = np.abs(np.linalg.eigvals(slope[fine]))
    grows[fine] = multipliers.max(axis=1, initial=0.0) > 1.0 + _UNSTABLE
    return grows


class Shooting:
    """Orbits by shooting: simulation to the periodic steady state."""

    def __init__(self, model: Model, states: int) -> None:
        self.key = Key(model)
        self.capacity = LANES
        # few different lengths: each is a program to compile, which takes longer than to run it
        self.coarsest, self.finest, self.growth = (128, 8192, 4) if states else (256, 65536, 4)
        if remembers(model):
            self.coarsest, self.finest = COARSEST_SERIES, max(self.finest, _FINEST_SERIES)

    def begin(self, cycle: Cycle, count: int, lanes: Lane) -> np.ndarray:
        """The model's own initial states, ``(count, n)``."""
        return np.asarray(starts(self.key, cycle, count, lanes))[:count]

    def solve(self, cycle: Cycle, count: int, lanes: Lane, x: np.ndarray) -> SolvedOrbits:
        """Newton's method on the period map; where it leads astray, one more period instead."""
        x = np.array(x)
        best = np.full(count, np.inf)  # how far from closed, at the last point that was kept
        after = x[:count].copy()  # one period after that point
        reason = np.full(count, Reason.NOT_CLOSED)
        kept = None
        active = np.arange(count)
        for _ in range(_MOST_PERIODS):
            orbit = self._run(cycle, active, lanes, x)
            step = closing_step(orbit)
            far = np.abs(step).max(axis=1, initial=0.0)
            kept = merged(kept, orbit, active, count)
            closed = far <= _ORBIT_CLOSED
            broken = ~np.isfinite(far) & ~np.isfinite(best[active])
            reason[active[closed]] = Reason.SETTLED
            reason[active[broken]] = Reason.DIVERGES
            # a Newton step that leads farther away is dropped; the period after the last good point
            # takes its place, as waiting for the transient would
            worse = ~(far < best[active])
            scale = scale_of(orbit)
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
        grows = unstable(kept)
        reason = np.where((reason == Reason.SETTLED) & grows, Reason.UNSTABLE, reason)
        return SolvedOrbits(kept.start, kept.harmonics, reason)

    def again(self, cycle: Cycle, count: int, lanes: Lane, x: np.ndarray) -> SolvedOrbits:
        """One more period from where the orbits ended."""
        now = self._run(cycle, np.arange(count), lanes, x)
        following = np.array(x)
        following[:count] = now.end
        orbit = self._run(cycle, np.arange(count), lanes, following)
        return SolvedOrbits(orbit.start, orbit.harmonics, np.full(count, Reason.SETTLED))

    def _run(self, cycle: Cycle, who: np.ndarray, lanes: Lane, x: np.ndarray) -> Orbit:
        orbits = periods(self.key, cycle, who.size, *front(lanes, x, who))
        return some(orbits, np.arange(who.size))
