"""One sample of a predictive controller: Gauss-Newton over the horizon, within the limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from diffthrust._support._running.programs import program
from diffthrust._support.box import least_squares_below, least_squares_within
from diffthrust.control._one_sample import AT_SEA, SPEEDS, State, one_sample
from diffthrust.models._base.model import Model
from diffthrust.simulation._trajectory import Key

_LENGTHS = np.array([1.0, 0.5, 0.25, 0.1])
"""Of the Gauss-Newton step."""
_EVEN = (0.02, 0.45, 0.98)
"""Shares of the range at which a plan is held throughout, where that is a better beginning than the
last plan: on the wrong side of a hill no step leads to the right one, and a propeller at rest, in
the middle of a range, has no slope at all."""
_MARGIN = 1e-4
"""Of the range between the limits: slopes are taken this far inside, where the force law of a
propeller that stops at a limit still has one."""
_BEYOND = 1e-3
"""So much beyond the limit of a state, in its unit, at one sample weighs as much as an error of
``position``. A limit that waves or a bad start have broken must leave a plan that comes back."""
_SETTLED = 1e-3
"""A plan is a minimum where the cosine between the residuals and the slope of each input that is
free to move is below this, or the next step, as a share of the ranges."""


class Plan(NamedTuple):
    """What a predictive controller intends, and what it remembers until the next sample.

    Args:
        inputs: what to apply now, by name, in the model's units.
        planned: the inputs over the horizon, as shares of the range between their limits,
            ``(horizon, inputs)``.
        state: the states that it expects at the next sample.
        push: accelerations that the model does not explain, ``north``, ``east`` [m/s^2] and ``yaw``
            [rad/s^2]; zero unless they are estimated.
        cost: the sum of squares that was minimized, with what is beyond limits of states.
        iterations: Gauss-Newton steps that were taken.
        settled: whether the plan that the last of them began from was a minimum, if not the lowest
            one: no input that is free to move lowers the cost.
        unseen: samples since the speeds were measured, for the estimate of ``push``.
        late: seconds for which the path has waited for a vessel that cannot keep up.

    Example:
        >>> plan = mpc.start(sighted)
        >>> plan._fields
        ('inputs', 'planned', 'state', 'push', 'cost', 'iterations', 'settled', 'unseen', 'late')
    """

    inputs: dict[str, Array]
    planned: Array
    state: State
    push: dict[str, Array]
    cost: Array
    iterations: Array
    settled: Array
    unseen: Array
    late: Array


class Frame(NamedTuple):
    """What fixes the compiled code of a controller, beside the lengths of its arrays."""

    key: Key
    substeps: int
    estimating: bool
    limited: tuple[str, ...]
    slewing: bool

    @property
    def bounded(self) -> bool:
        """Whether only the inputs have limits, each by itself."""
        return not (self.limited or self.slewing)


class Setting(NamedTuple):
    """Settings of a controller that may change without another compilation."""

    values: dict[str, Array]
    low: Array
    high: Array
    moves: Array
    reach: Array
    least: Array
    most: Array
    period: Array
    position: Array
    point: Array
    lag: Array
    iterations: Array


def replan(
    frame: Frame, setting: Setting, plan: Plan, measured: Mapping[str, Array], place: Array
) -> Plan:
    """`MPC.step`, traceable: ``place`` is ``(horizon, 2)``; what is NaN was not measured."""
    model = frame.key.model.bind(setting.values)
    blind = {name: jnp.isnan(measured[name]) for name in AT_SEA}
    state = {**plan.state}
    state |= {n: jnp.where(blind[n], plan.state[n], measured[n]) for n in AT_SEA}
    # the error has grown since the last sample that was measured
    since = setting.period * (1.0 + plan.unseen)
    missed = {n: jnp.where(blind[n], 0.0, measured[n] - plan.state[n]) for n in SPEEDS}
    push = _estimate(plan, missed, since, setting.lag) if frame.estimating else plan.push
    previous = jnp.stack([plan.inputs[name] for name in model.inputs])
    previous = (previous - setting.low) / (setting.high - setting.low)
    ahead = _Horizon(frame, setting, model, state, push, previous, place, plan.planned.shape)
    flat, count, _, settled = jax.lax.while_loop(
        lambda carry: ~carry[3] & (carry[1] < setting.iterations),
        ahead.improve,
        (ahead.best_guess(plan.planned), jnp.asarray(0), jnp.zeros(()), jnp.asarray(False)),
    )
    planned = jnp.clip(flat, 0.0, 1.0).reshape(ahead.shape)
    nearest = jnp.clip(previous, 0.0, 1.0)
    # the interior point method fulfils rates to its tolerance; what is applied fulfils them exactly
    first = jnp.clip(planned[0], nearest - setting.reach, nearest + setting.reach)
    unmeasured = blind["surge"] | blind["sway"] | blind["yaw_rate"]
    return Plan(
        inputs=ahead.inputs_of(first),
        planned=planned.at[0].set(first),
        state=ahead.after(state, first),
        push=push,
        cost=ahead.cost(flat),
        iterations=count,
        settled=settled,
        unseen=jnp.where(unmeasured, plan.unseen + 1.0, 0.0),
        late=plan.late + ahead.waiting(flat),
    )


@dataclass(frozen=True, eq=False)  # by identity: JAX hashes methods, and arrays have no hash
class _Horizon:
    """The problem of one sample: inputs over the horizon, as shares of their ranges, in one row."""

    frame: Frame
    setting: Setting
    model: Model  # with its values
    state: State  # at the sample
    push: dict[str, Array]  # unexplained accelerations, taken to last
    previous: Array  # inputs before the sample, as shares of their ranges
    place: Array  # of the path, (horizon, 2)
    shape: tuple[int, ...]  # of the inputs, (horizon, inputs)

    def inputs_of(self, shares: Array) -> dict[str, Array]:
        """Inputs at one sample, by name, within their limits."""
        low, high = self.setting.low, self.setting.high
        row = jnp.clip(low + shares * (high - low), low, high)
        return {name: row[i] for i, name in enumerate(self.model.inputs)}

    def after(self, state: State, shares: Array) -> State:
        """The state one sample later."""
        now = jnp.zeros(())  # models do not read the time of day
        inputs = self.inputs_of(shares)
        period, substeps = self.setting.period, self.frame.substeps
        return one_sample(self.model, state, inputs, now, period, substeps, self.push)

    def foreseen(self, flat: Array) -> tuple[Array, Array]:
        """What is squared, and by how much states are beyond their limits; negative within."""
        setting, shares = self.setting, flat.reshape(self.shape)

        def body(state: State, row: Array) -> tuple[State, tuple[Array, Array]]:
            state = self.after(state, row)
            limited = jnp.array([state[name] for name in self.frame.limited])
            return state, (control_point(state, setting.point), limited)

        _, (track, limited) = jax.lax.scan(body, self.state, shares)
        changes = jnp.diff(shares, axis=0, prepend=self.previous[None]) / setting.moves[None]
        off = (track - self.place) / setting.position
        errors = jnp.concatenate([off.ravel(), changes.ravel()])
        beyond = jnp.concatenate([limited - setting.most[None], setting.least[None] - limited])
        return errors, beyond.ravel()

    def waiting(self, flat: Array) -> Array:
        """Seconds for which the path waits: the time that the vessel loses at the plan's end.

        An error along the path that no plan can mend grows, and in the end a course beside the path
        is the cheaper one: with a surge of 0.6 m/s at most a boat left a line of 0.8 m/s at
        0.022 m/s, for ever. A vessel that catches up, or is late by less than ``position``, is not
        waited for.
        """
        count = self.place.shape[0]
        if count == 1:
            return jnp.zeros(())
        errors, _ = self.foreseen(flat)
        behind = -self.setting.position * errors[: 2 * count].reshape(count, 2)
        onward = self.place[-1] - self.place[-2]
        length = jnp.linalg.norm(onward) + jnp.finfo(float).tiny
        late, lost = behind[-1] @ onward / length, (behind[-1] - behind[-2]) @ onward / length**2
        share = jnp.where(late > self.setting.position, jnp.clip(lost, 0.0, 1.0), 0.0)
        return jnp.where(jnp.isfinite(share), share, 0.0) * self.setting.period

    def cost(self, flat: Array) -> Array:
        """Sum of squares; infinite where the model runs away."""
        errors, beyond = self.foreseen(flat)
        total = jnp.sum(errors**2) + jnp.sum((jnp.maximum(beyond, 0.0) / _BEYOND) ** 2)
        return jnp.where(jnp.isfinite(total), total, jnp.inf)

    def best_guess(self, planned: Array) -> Array:
        """The best start: the last plan, one sample on, or inputs that are held (`_EVEN`)."""
        warm = jnp.concatenate([planned[1:], planned[-1:]])
        furthest = self.setting.reach[None] * jnp.arange(1.0, self.shape[0] + 1)[:, None]
        nearest = jnp.clip(self.previous, 0.0, 1.0)
        even = [jnp.clip(jnp.asarray(row)[None], nearest[None] - furthest, nearest[None] + furthest)
                for row in product(_EVEN, repeat=self.shape[1])]  # fmt: skip
        guesses = jnp.stack([warm.ravel(), *(guess.ravel() for guess in even)])
        return guesses[jnp.argmin(jax.vmap(self.cost)(guesses))]

    def step_from(
        self, flat: Array, jacobian: Array, residual: Array, slopes: Array, beyond: Array
    ) -> Array:
        """The step of least squares within the limits of inputs, their changes and states."""
        if self.frame.bounded:
            return least_squares_within(jacobian, residual, -flat, 1.0 - flat, jnp.zeros_like(flat))
        eye, reach = jnp.eye(flat.size), self.setting.reach[None]
        changing = jnp.diff(eye.reshape(*self.shape, -1), axis=0, prepend=0.0)
        changing = changing.reshape(flat.size, -1)
        nearest = jnp.clip(self.previous, 0.0, 1.0)
        changes = jnp.diff(flat.reshape(self.shape), axis=0, prepend=nearest[None])
        up, down = (reach - changes).ravel(), (reach + changes).ravel()
        hard = [1.0 - flat, flat, up, down]
        return least_squares_below(
            jacobian,
            residual,
            jnp.concatenate([eye, -eye, changing, -changing, slopes]),
            jnp.concatenate([*hard, -beyond]),
            jnp.concatenate([jnp.zeros(4 * flat.size), jnp.full(beyond.shape, _BEYOND)]),
        )

    def improve(self, carry: tuple[Array, ...]) -> tuple[Array, ...]:
        """One damped Gauss-Newton step: inputs, steps so far, damping, and whether it ends."""
        flat, count, damping, _ = carry
        # forward mode: the reverse mode of a scan leaves XLA's fused loop
        jacobian, slopes = jax.jacfwd(self.foreseen)(jnp.clip(flat, _MARGIN, 1.0 - _MARGIN))
        now, (residual, beyond) = self.cost(flat), self.foreseen(flat)
        sizes = jnp.linalg.norm(jacobian, axis=0)
        step = self.step_from(
            flat,
            jnp.concatenate([jacobian, jnp.sqrt(damping) * jnp.diag(sizes)]),
            jnp.concatenate([residual, jnp.zeros_like(flat)]),
            slopes,
            beyond,
        )
        # all lengths in one batch: a line search that branches cannot be vectorized
        tried = jax.vmap(lambda length: flat + length * step)(_LENGTHS)
        costs = jax.vmap(self.cost)(tried)
        best = jnp.argmin(costs)
        better = costs[best] < now
        slope = residual @ jacobian
        # an input pushed against its limit: its slope need not vanish at a minimum
        held = ((flat <= 0) & (slope >= 0)) | ((flat >= 1) & (slope <= 0))
        steep = jnp.abs(slope) / (sizes * jnp.linalg.norm(residual) + jnp.finfo(float).tiny)
        level = self.frame.bounded & (jnp.max(jnp.where(held, 0.0, steep)) < _SETTLED)
        short = (jnp.max(jnp.abs(step)) < _SETTLED) & (damping < 1.0)
        # at a kink of the force law no slope is level, and yet no step helps, however small
        corner = (now - costs[best] <= _SETTLED**2 * now) & (damping >= 1.0)
        settled = jnp.isfinite(now) & (level | short | corner)
        # Levenberg-Marquardt: no damping while Gauss-Newton helps, more where its tenth does not
        damping = jnp.where(better, 0.1 * damping, jnp.maximum(10.0 * damping, 1e-3))
        return jnp.where(better, tried[best], flat), count + 1, damping, settled


def control_point(state: Mapping[str, Array], ahead: Array) -> Array:
    """North and east of the point that is to follow the path, ``(2,)``."""
    cos, sin = jnp.cos(state["heading"]), jnp.sin(state["heading"])
    return jnp.stack([state["north"] + ahead * cos, state["east"] + ahead * sin])


def _estimate(
    plan: Plan, missed: Mapping[str, Array], since: Array, lag: Array
) -> dict[str, Array]:
    """The unexplained accelerations, moved towards what the last sample missed."""
    heading = plan.state["heading"]
    cos, sin = jnp.cos(heading), jnp.sin(heading)
    # an error of speed over the time in which it grew, taken in with the share 1 - exp(-t / lag)
    gain = -jnp.expm1(-since / lag) / since
    unexplained = {
        "north": missed["surge"] * cos - missed["sway"] * sin,
        "east": missed["surge"] * sin + missed["sway"] * cos,
        "yaw": missed["yaw_rate"],
    }
    return {name: plan.push[name] + gain * unexplained[name] for name in plan.push}


compiled_replan = program(1)(replan)
"""`replan`, compiled once for each structure and horizon."""
