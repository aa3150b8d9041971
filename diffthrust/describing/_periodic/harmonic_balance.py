"""The periodic orbit of a model under a sinusoid, by harmonic balance.

The states are finite Fourier series. The rates that the equations give along them, at the instants
of one period, are projected on the same harmonics and must equal the derivatives of the series (a
Galerkin method in alternating frequency and time). Newton's method solves for the coefficients:
the equations are elementwise in time, so one forward derivative for each state gives the whole
Jacobian.

Source: Cameron & Griffin 1989 (alternating frequency-time); Krack & Gross 2019, Harmonic Balance
for Nonlinear Vibration Problems, chapter 2.
"""

from __future__ import annotations

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
    start_of,
)
from diffthrust.models._base.model import Model
from diffthrust.simulation._runge_kutta import plain_rate
from diffthrust.simulation._trajectory import Key, rates_of

MOST_EVALUATIONS = 80
"""Evaluations that may be spent on one orbit, at one density of instants."""
ORBIT_BALANCED = 1e-8
"""An orbit is found where Newton's next step is so short against the coefficients."""
_ROUNDING = 1e-13
"""A derivative counts as none below this share of the largest."""
DENSE_STEPS = 2048
"""Steps to the period at which a balance is judged: what happens in a moment, as static friction at
the turn of a slow shaft, would pass unseen between the instants of a few harmonics."""
SHORTEST_SHARE = 2.0**-10
"""A step is halved no further than to this share of Newton's."""


class Balance(NamedTuple):
    """What the coefficients of one lane amount to, with ``c = 2 harmonics + 1`` for each state.

    Args:
        rest: what is missing to a balance [unit of the state / s], ``(n, c)``.
        slope: derivative of the rest with respect to the coefficients, ``(n c, n c)``; empty where
            it was not wanted.
        harmonics: of the output.
    """

    rest: Float[Numbers, "*lanes n c"]
    slope: Float[Numbers, "*lanes n*c n*c"]
    harmonics: Harmonics


def balance(
    model: Model, cycle: Cycle, lane: Lane, x: Float[Array, "n c"], sloped: bool
) -> Balance:
    """How far Fourier coefficients are from a balance.

    Args:
        model: the model with the lane's parameters.
        cycle: how.
        lane: amplitude and frequency.
        x: for each state its mean, then the cosine and sine parts of each harmonic, ``(n, c)``.
        sloped: with the slope, which costs far more than all the rest.
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
    # a derivative by each of n states in place of n (2 h + 1) coefficients: a tenth of the passes
    # and less
    slopes = jax.vmap(lambda v: jax.jvp(rates, (path,), (v,))[1])(along)  # by state, (n, n, dense)
    pushed = jnp.einsum("as,jis,sb->iajb", down, slopes, up)
    inertia = jnp.einsum("ij,ab->iajb", jnp.eye(len(names)), lane.frequency * turn)
    return Balance(residual, (inertia - pushed).reshape(x.size, x.size), harmonics)


@program(3)
def balances(
    key: Key, cycle: Cycle, sloped: bool, count: int, lanes: Lane, x: Float[Numbers, "lanes n c"]
) -> Balance:
    """`balance` of the first ``count`` lanes, with coefficients ``(lanes, n, c)``."""

    def one(lane_and_x: tuple[Lane, Array]) -> Balance:
        lane, unknowns = lane_and_x
        return balance(key.model.bind(lane.values), cycle, lane, unknowns, sloped)

    return in_blocks(one, count, (lanes, x))


def balancing_step(
    slope: Float[np.ndarray, "lanes n*c n*c"], residual: Float[np.ndarray, "lanes n c"]
) -> Float[np.ndarray, "lanes n c"]:
    """The step that would balance each lane, of the shape of the rest, ``(lanes, n, c)``.

    A coefficient that nothing depends on, as the mean position of a vehicle that nothing pulls
    back, is held. NaN where the rest is not finite.
    """
    shape, slope = residual.shape, slope.copy()
    residual = residual.reshape(slope.shape[:2])
    fine = np.asarray(np.isfinite(slope).all(axis=(1, 2)) & np.isfinite(residual).all(axis=1))
    residual = residual.copy()
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
