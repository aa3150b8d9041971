"""The periodic orbit of a model under a sinusoid, by harmonic balance.

The states are finite Fourier series. The rates that the equations give along them, at the instants
of one period, are projected on the same harmonics and must equal the derivatives of the series (a
Galerkin method in alternating frequency and time). Newton's method solves for the coefficients:
the equations are elementwise in time, so one forward derivative for each state gives the whole
Jacobian.

What a balance leaves out is shown by one further step with at least twice as many harmonics, and
with the equations seen at far more instants (`left_out`). A corner of the equations (a dead band, a
saturation, dry friction) has harmonics without end, and only harmonics beyond those kept show the
size of what was dropped. Where that step is not short, the balance is solved again first. The
change is enlarged by the remainder of a series that falls with the first power of the number of
harmonics; as a rule it falls faster.

Source: Cameron & Griffin 1989 (alternating frequency-time); Krack & Gross 2019, Harmonic Balance
for Nonlinear Vibration Problems, chapter 2.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from diffthrust._support._running.programs import program
from diffthrust.describing._periodic.period import (
    LANE_BLOCK,
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
from diffthrust.describing._periodic.respond import (
    LONGEST_SERIES,
    PeriodicResponses,
    Reason,
    SolvedOrbits,
    first_harmonic,
    front,
    merged,
    over,
    some,
)
from diffthrust.describing._periodic.shooting import COARSEST_SERIES, LANES, starts
from diffthrust.models._base.model import Model
from diffthrust.simulation._integrate import plain_rate
from diffthrust.simulation._trajectory import Key, rates_of

_MOST_EVALUATIONS = 80
"""Evaluations that may be spent on one orbit, at one density of instants."""
_ORBIT_BALANCED = 1e-8
"""An orbit is found where Newton's next step is so short against the coefficients."""
_ROUNDING = 1e-13
"""A derivative counts as none below this share of the largest."""
_DENSE_STEPS = 2048
"""Steps to the period at which a balance is judged: what happens in a moment, as static friction at
the turn of a slow shaft, would pass unseen between the instants of a few harmonics."""
_SHORTEST_SHARE = 2.0**-10
"""A step is halved no further than to this share of Newton's."""

_NUMBERS = 2_000_000
"""Numbers in all Jacobians of one call: it bounds the memory."""


class Balance(NamedTuple):
    """What the coefficients of one lane amount to, with ``c = 2 harmonics + 1`` for each state."""

    rest: Float[Numbers, "*lanes n c"]  # what is missing to a balance [unit of the state / s]
    slope: Float[Numbers, "*lanes n*c n*c"]  # of the rest; empty where it was not wanted
    harmonics: Harmonics  # of the output


def balance(
    model: Model, cycle: Cycle, lane: Lane, x: Float[Array, "n c"], sloped: bool
) -> Balance:
    """How far Fourier coefficients are from a balance.

    They are for each state its mean, then the cosine and sine parts of each harmonic, ``(n, c)``.
    The slope, if ``sloped``, costs far more than all the rest.
    """
    series = driven_period(model, cycle, lane)
    dense = 2 * cycle.samples
    names = cycle.states
    constant_states = {n: jnp.full(dense, v) for n, v in start_of(model, series).items()}
    up, down, turn = (jnp.asarray(m) for m in _matrices(dense, cycle.harmonics))
    u = {n: v[:-1] for n, v in series.inputs.items()} | {"time": series.time[:-1]}

    def rates(path: Float[Array, "n instants"]) -> Float[Array, "n instants"]:
        followed = {n: path[i] for i, n in enumerate(names)}
        by_name = rates_of(model, names, {**constant_states, **followed}, u)
        return jnp.stack([jnp.broadcast_to(plain_rate(by_name[n]), (dense,)) for n in names])

    path = x @ up.T
    residual = lane.frequency * (x @ turn.T) - rates(path) @ down.T
    series_of_states = {**constant_states, **{n: path[i] for i, n in enumerate(names)}}
    series_of_states = {n: jnp.concatenate([v, v[:1]]) for n, v in series_of_states.items()}
    harmonics = harmonics_of(model, cycle, lane, series, series_of_states)
    if not sloped:
        return Balance(residual, jnp.zeros((0, 0)), harmonics)
    along = jnp.broadcast_to(jnp.eye(len(names))[:, :, None], (len(names), *path.shape))
    # derivatives by n states, not by n (2 h + 1) coefficients: a tenth of the passes and less
    slopes = jax.vmap(lambda v: jax.jvp(rates, (path,), (v,))[1])(along)  # by state, (n, n, dense)
    pushed = jnp.einsum("as,jis,sb->iajb", down, slopes, up)
    inertia = jnp.einsum("ij,ab->iajb", jnp.eye(len(names)), lane.frequency * turn)
    return Balance(residual, (inertia - pushed).reshape(x.size, x.size), harmonics)


@program(3)
def balances(
    key: Key, cycle: Cycle, sloped: bool, count: int, lanes: Lane, x: Float[Numbers, "lanes n c"]
) -> Balance:
    """`balance` of the first ``count`` lanes, with coefficients ``(lanes, n, c)``."""

    def balanced(lane_and_x: tuple[Lane, Array]) -> Balance:
        lane, unknowns = lane_and_x
        return balance(key.model.bind(lane.values), cycle, lane, unknowns, sloped)

    return in_blocks(balanced, count, (lanes, x))


def balancing_step(
    slope: Float[np.ndarray, "lanes n*c n*c"], residual: Float[np.ndarray, "lanes n c"]
) -> Float[np.ndarray, "lanes n c"]:
    """The step that would balance each lane, of the shape of the rest, ``(lanes, n, c)``.

    A coefficient that nothing depends on, as the mean position of a vehicle that nothing pulls
    back, is held. NaN where the rest is not finite.
    """
    shape, slope = residual.shape, slope.copy()
    residual = residual.reshape(slope.shape[:2]).copy()
    fine = np.asarray(np.isfinite(slope).all(axis=(1, 2)) & np.isfinite(residual).all(axis=1))
    held_fast(slope, residual, drifting(slope) & fine[:, None])
    # rows have the units of different states
    size = np.abs(slope).max(axis=2) + TINY
    slope, residual = slope / size[:, :, None], residual / size
    step = np.full(residual.shape, np.nan)
    if fine.any():
        try:
            step[fine] = -np.linalg.solve(slope[fine], residual[fine][..., None])[..., 0]
        except np.linalg.LinAlgError:  # some lane is singular: the shortest step for all
            inverse = np.linalg.pinv(slope[fine], rcond=1e-12)
            step[fine] = -np.einsum("lij,lj->li", inverse, residual[fine])
    return step.reshape(shape)


def drifting(slope: Float[np.ndarray, "lanes n*c n*c"]) -> Bool[np.ndarray, "lanes n*c"]:
    """Coefficients that nothing depends on, ``(lanes, n c)``; see `idle`."""
    return idle(slope, _ROUNDING * np.abs(slope).max(axis=(1, 2))[:, None])


def _matrices(points: int, harmonics: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """From coefficients to instants, back again, and the derivative by the phase."""
    turn = 2.0 * np.pi * np.arange(points) / points
    columns = [np.ones(points)]
    by_phase = np.zeros((2 * harmonics + 1, 2 * harmonics + 1))
    for k in range(1, harmonics + 1):
        columns += [np.cos(k * turn), np.sin(k * turn)]
        by_phase[2 * k - 1, 2 * k], by_phase[2 * k, 2 * k - 1] = k, -k
    up = np.stack(columns, axis=1)
    down = 2.0 / points * up.T
    down[0] *= 0.5
    return up, down, by_phase


class HarmonicBalance:
    """Orbits by harmonic balance."""

    def __init__(self, model: Model, states: int, harmonics: int) -> None:
        self.key = Key(model)
        self.harmonics = harmonics
        unknowns = (states * (2 * harmonics + 1)) ** 2
        self.capacity = max(LANE_BLOCK, min(LANES, _NUMBERS // unknowns) // LANE_BLOCK * LANE_BLOCK)
        self.coarsest = max(32, 1 << (4 * harmonics - 1).bit_length())
        if remembers(model):
            self.coarsest = max(self.coarsest, COARSEST_SERIES)
        self.finest, self.growth = max(4096, self.coarsest), 2

    def begin(self, cycle: Cycle, count: int, lanes: Lane) -> np.ndarray:
        """Constant states, the model's own initial ones, ``(count, n, c)``."""
        first = np.asarray(starts(self.key, cycle, count, lanes))[:count]
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
        kept: Balance | None = None
        active = np.arange(count)
        for _ in range(_MOST_EVALUATIONS):
            missed = self._run(cycle, active, lanes, x)
            keep = np.isfinite(missed.rest).all(axis=(1, 2))
            if kept is None:
                kept = merged(None, missed, active, count)
                reason[~keep] = Reason.DIVERGES
            else:
                unit = _size(point[active] + step[active])
                old = np.asarray(kept.slope)[active]
                bar = balancing_step(old, missed.rest) / unit[:, :, None]
                with np.errstate(invalid="ignore"):
                    keep &= np.abs(bar).max(axis=(1, 2)) <= length[active]
                # halved ten times without a gain: the step is taken as it is, for a corner may lie
                # in between
                keep |= share[active] <= _SHORTEST_SHARE
            new = active[keep]
            kept = merged(kept, some(missed, keep), new, count)
            point[new], share[new] = x[new], np.minimum(1.0, 4.0 * share[new])
            step[new] = balancing_step(missed.slope[keep], missed.rest[keep])
            share[active[~keep]] *= 0.5
            unit = _size(point[active] + step[active])
            length[active] = (np.abs(step[active]) / unit[:, :, None]).max(axis=(1, 2))
            closed = keep & (length[active] <= _ORBIT_BALANCED)
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
        drifts = drifting(np.asarray(now.slope)).reshape(now.rest.shape)
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
        dense = min(max(_DENSE_STEPS, cycle.samples), LONGEST_SERIES // (2 * cycle.periods))
        many = replace(cycle, samples=dense)
        slope = self._run(cycle, every, lanes, x).slope
        x[:count] += balancing_step(slope, self._run(many, every, lanes, x, sloped=False).rest)
        judged = self._run(many, every, lanes, x, sloped=False).harmonics
        fine = np.isfinite(x[:count]).all(axis=(1, 2))
        return SolvedOrbits(x[:count], judged, np.where(fine, Reason.SETTLED, Reason.NOT_CLOSED))

    def _run(
        self, cycle: Cycle, who: np.ndarray, lanes: Lane, x: np.ndarray, sloped: bool = True
    ) -> Balance:
        cycle = replace(cycle, harmonics=self.harmonics)
        missed = balances(self.key, cycle, sloped, who.size, *front(lanes, x, who))
        return some(missed, np.arange(who.size))


def _size(x: np.ndarray) -> np.ndarray:
    """The largest coefficient of each state, ``(lanes, n)``."""
    return np.abs(x).max(axis=2) + TINY


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
    """The error of each first harmonic that a richer balance shows, relative to it, ``(L,)``.

    The real part is that of the gain, the imaginary one that of the phase [rad]. NaN where there is
    no answer, infinite where more harmonics lead nowhere.
    """
    error = np.full(lanes.amplitude.size, np.nan, complex)
    more = 2 * richer.harmonics + 1 - responses.x.shape[-1]
    share = more / (2 * richer.harmonics)  # of the error, if that falls with the first power
    x = np.pad(responses.x, ((0, 0), (0, 0), (0, more)))

    def judged(who: np.ndarray, at: Cycle) -> np.ndarray:
        reference = over(richer, at, lanes, who, richer.judge, x)
        change = _relative_change(reference.harmonics, lanes.amplitude[who], responses.first[who])
        return np.where(reference.reason == Reason.SETTLED, change / share, np.inf)

    for who, at in responses.alike(cycle, np.flatnonzero(responses.reason == Reason.SETTLED)):
        at = replace(at, samples=max(at.samples, richer.coarsest))
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
