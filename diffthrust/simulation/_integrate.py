"""Integration over a log's grid, in one loop, by steps of a fourth-order method.

Plain states are advanced by the classical Runge-Kutta method, `Relaxing` states by its exponential
form (Cox & Matthews 2002, equations 26 to 29), which is the same method where the decay is slow and
exact where it is fast. What the other states see of a relaxing state at the start and in the middle
of a step is corrected such that its mean over the step is exact: the weights of the method would
otherwise count one sixth of the old value, however fast the decay. A vanishing time constant then
gives the model without the lag, and the order stays four.

The carry of the loop is a dictionary of scalars and its body is elementwise, so XLA compiles it as
one fused kernel; stacking, unrolling or branching would lose that. For the same reason the weights
of the exponential form are worked out ahead of the loop, for all steps at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from diffthrust.models._base.signals import Relaxing

Rates = Callable[[Mapping[str, Any], Mapping[str, Any]], Mapping[str, Any]]
"""From states and inputs at one instant to the rate of each state."""
Coefficients = tuple[Any, ...]
"""A coefficient for each stage of a step; those that are known beforehand are floats."""


class Scheme(NamedTuple):
    """How a step is made of its stages, for one state.

    A stage begins where the last one has put the states, and finds a slope. The state of the next
    stage is made of the state at the start, this slope, and the slopes of the first stages.

    Args:
        times: of the stages, as a share of the step.
        kept: of the state at the start, in the state of the next stage.
        newest: of the slope just found, in the same, times the step.
        first: of the slopes of the first stages, in the same; a row for each of them.
        share: of each slope in the whole step.
        end: of the state at the start in the state at the end.
        turned: of the state, added to its rate: what the frozen decay has taken.
    """

    times: Coefficients
    kept: Coefficients
    newest: Coefficients
    first: tuple[Coefficients, ...]
    share: Coefficients
    end: Any = 1.0
    turned: Coefficients = ()


_PLAIN = Scheme(
    times=(0.0, 0.5, 0.5, 1.0),
    kept=(1.0,) * 4,
    newest=(0.5, 0.5, 1.0, 0.0),
    first=(),
    share=(1 / 6, 1 / 3, 1 / 3, 1 / 6),
)
_BESIDE = Scheme(  # relaxing states take two stages more
    times=(0.0, 0.0, 0.5, 0.5, 0.5, 1.0),
    kept=(1.0,) * 6,
    newest=(0.0, 0.5, 0.0, 0.5, 1.0, 0.0),
    first=((0.0,) * 6, (0.0, 0.0, 0.5, 0.0, 0.0, 0.0)),
    share=(0.0, 1 / 6, 0.0, 1 / 3, 1 / 3, 1 / 6),
)


def _relaxing(w: Mapping[str, Any]) -> Scheme:
    """Of a relaxing state with these `exponential_weights`.

    The first stage corrects the start. The third looks ahead: a fast state follows the rise of its
    target within the step, too.
    """
    half, mean, rise = w["half"], -w["mean"], 0.5 * w["grown"]
    return Scheme(
        times=_BESIDE.times,
        kept=(1.0, half, half, half, half**2, 0.0),
        newest=(w["start"], rise, w["ramp"], rise, 2.0 * rise, 0.0),
        first=(
            (0.0, mean, mean, mean, 0.0, 0.0),
            (0.0, 0.0, rise - w["ramp"], 0.0, rise * (half - 1.0), 0.0),
        ),
        share=(0.0, w["first"], 0.0, 2.0 * w["both"], 2.0 * w["both"], w["last"]),
        end=w["kept"],
        turned=(0.0, *[w["decay"]] * 5),
    )


def advance(
    rates: Rates,
    x: Mapping[str, Any],
    inputs: Mapping[str, tuple[Any, ...]],
    h: Any,
    weights: Mapping[str, Mapping[str, Any]],
    compact: bool = False,
) -> dict[str, Any]:
    """The states one step later.

    Args:
        rates: the right-hand side.
        x: the states.
        inputs: as of `integrate`, for this step alone.
        h: its length [s].
        weights: the `exponential_weights` of the relaxing states, by name.
        compact: the stages run in a loop: less code to compile, and for many effects faster; for
            few of them slower.
    """
    beside = _BESIDE if weights else _PLAIN
    schemes = {n: _relaxing(weights[n]) if n in weights else beside for n in x}
    count = len(beside.times)
    saved = [tuple(float(i == j) for i in range(count)) for j in range(len(beside.first))]

    def stage(now: Callable[[Coefficients], Any], state: Any, sums: Any) -> tuple[Any, Any]:
        """From the states and sums at a stage to those at the next; ``now`` reads a row."""
        slopes = rates(state, {n: _at(value, now(beside.times)) for n, value in inputs.items()})
        following, summed = {}, {}
        for n, scheme in schemes.items():
            slope = plain_rate(slopes[n])
            if scheme.turned:
                slope = slope + now(scheme.turned) * state[n]
            total, *first = sums[n]
            first = [_either(now(row), slope, old) for row, old in zip(saved, first, strict=True)]
            move = _plus(0.0, now(scheme.newest), slope)
            for row, early in zip(scheme.first, first, strict=True):
                move = _plus(move, now(row), early)
            following[n] = _times(now(scheme.kept), x[n]) + h * move
            summed[n] = (_plus(total, now(scheme.share), slope), *first)
        return following, summed

    if compact:
        state = {n: jnp.asarray(value, float) for n, value in x.items()}
        nothing = {n: jnp.zeros_like(value) for n, value in state.items()}
        carry = state, {n: (nothing[n],) * (1 + len(s.first)) for n, s in schemes.items()}
        _, sums = jax.lax.fori_loop(
            0, count, lambda i, carry: stage(lambda row: _looked_up(row, i), *carry), carry
        )
    else:
        state, sums = dict(x), {n: (0.0,) * (1 + len(s.first)) for n, s in schemes.items()}
        for i in range(count):
            state, sums = stage(lambda row, i=i: row[i], state, sums)
    return {n: _times(scheme.end, x[n]) + h * sums[n][0] for n, scheme in schemes.items()}


def _at(value: tuple[Any, ...], time: Any) -> Any:
    """An input at the start, in the middle or at the end of a step."""
    if len(value) == 1:
        return value[0]
    middle = 0.5 * (value[0] + value[1]) if len(value) == 2 else value[1]
    if isinstance(time, float):
        return {0.0: value[0], 0.5: middle, 1.0: value[-1]}[time]
    return jnp.where(time == 0.0, value[0], jnp.where(time == 1.0, value[-1], middle))


def _looked_up(row: Coefficients, i: Any) -> Any:
    if all(isinstance(value, float) for value in row):
        return row[0] if len(set(row)) == 1 else jnp.asarray(row)[i]
    return jnp.stack(jnp.broadcast_arrays(*(jnp.asarray(value, float) for value in row)))[i]


def _either(here: Any, new: Any, old: Any) -> Any:
    """The new value where the coefficient is one, the old one where it is zero."""
    if isinstance(here, float):
        return new if here else old
    return jnp.where(here > 0.0, new, old)


def _plus(total: Any, coefficient: Any, value: Any) -> Any:
    """A sum with one term more; what is known to be nothing takes no operation."""
    if isinstance(coefficient, float) and coefficient == 0.0:
        return total
    term = _times(coefficient, value)
    return term if isinstance(total, float) and total == 0.0 else total + term


def _times(coefficient: Any, value: Any) -> Any:
    return value if isinstance(coefficient, float) and coefficient == 1.0 else coefficient * value


def plain_rate(k: Any) -> Any:
    """The number in a rate that may be `Relaxing`."""
    return k.rate if isinstance(k, Relaxing) else k


def with_push(k: Any, push: Any) -> Any:
    """A rate that may be `Relaxing`, with something added to it."""
    return k._replace(rate=k.rate + push) if isinstance(k, Relaxing) else k + push


_TERMS = range(3, 19)
SERIES = {
    "first": [4 / math.factorial(k) - 3 / math.factorial(k - 1) + 1 / math.factorial(k - 2)
              for k in _TERMS],
    "both": [-2 / math.factorial(k) + 1 / math.factorial(k - 1) for k in _TERMS],
    "last": [4 / math.factorial(k) - 1 / math.factorial(k - 1) for k in _TERMS],
    "ramp": [6 * (-1) ** k * (1 / math.factorial(k + 3) - 1 / 2**k / 6 / math.factorial(k + 1))
             for k in range(2, 18)],
    "mean": [1.5 * (-1) ** k * (1 / math.factorial(k + 1) - (4 / 2**k + 1) / 6 / math.factorial(k))
             for k in range(4, 19)],
}  # fmt: skip
"""Coefficients of the weights where the step is short beside the time constant, by name."""
TURN = 3.0**4
"""The step over the time constant, to the fourth, where the start of a step loses its weight."""


def exponential_weights(h: Any, decay: Any) -> dict[str, Any]:
    """Weights of the exponential method for steps ``h`` [s] and a decay [1/s].

    The closed forms lose all digits where ``h * decay`` is small; there, their Taylor series.
    """
    r = h * decay
    small = r < 1.0
    near = jnp.where(small, r, 0.0)
    z = -jnp.where(small, 1.0, r)  # keeps derivatives of the branch not taken finite
    e, eh = jnp.exp(z), jnp.exp(0.5 * z)
    tiny = r < 1e-8

    def either(name: str, argument: Any, direct: Any) -> Any:
        series = jnp.zeros_like(r)
        for coefficient in reversed(SERIES[name]):
            series = series * argument + coefficient
        return jnp.where(small, series, direct)

    simpson = (1 + 4 * eh + e) / 6
    grown = jnp.where(tiny, 1.0 - 0.25 * r, -jnp.expm1(-0.5 * r) / jnp.where(tiny, 1.0, 0.5 * r))
    ramp = 6 * (-0.5 / z - 1 / z**2 - (1 - e) / z**3) + 2 * (1 - eh) / z
    mean = either("mean", near, 1.5 * ((e - 1) / z - simpson) / (-z) ** 4)
    unseen = 1.0 / (TURN + r**4)  # the old value's weight at the start is 81 / (81 + r^4)
    return {
        "decay": jnp.broadcast_to(decay, r.shape),
        "kept": jnp.exp(-r),
        "half": jnp.exp(-0.5 * r),
        "grown": grown,
        "first": either("first", -near, (-4 - z + e * (4 - 3 * z + z**2)) / z**3),
        "both": either("both", -near, (2 + z + e * (-2 + z)) / z**3),
        "last": either("last", -near, (-4 - 3 * z - z**2 + e * (4 - z)) / z**3),
        "start": r**3 * unseen,
        "ramp": near**2 * either("ramp", near, 0.0) + jnp.where(small, 0.0, ramp),
        "mean": r**3 * (mean + 0.25 * unseen),
    }


Correct = Callable[[dict[str, Any], Mapping[str, Any], Any], dict[str, Any]]
"""From states, inputs and a row of other series at one instant to the corrected states."""


def integrate(
    rates: Rates,
    start: Mapping[str, Any],
    inputs: Mapping[str, tuple[Any, ...]],
    steps: Any,
    restart: Mapping[str, tuple[Any, Any]],
    correct: Correct | None = None,
    rows: Any = None,
    *,
    uniform: bool = False,
    substeps: Any = 1,
    compact: bool = False,
    padded: bool = False,
) -> dict[str, Any]:
    """Integrate a system of first-order equations over given steps.

    Args:
        rates: the right-hand side; evaluated with scalars.
        start: initial states, scalars.
        inputs: for each input ``(held,)``, ``(at_start, at_end)`` or ``(at_start, in_the_middle,
            at_end)`` of every step, each ``(N,)``; the second is linear within the step, and the
            third is for steps that are not divided.
        steps: step lengths [s], ``(N,)``.
        restart: for some states ``(values, unsigned)``: where a value, ``(N,)``, is finite, the
            state is set to it before the step (with the state's own sign where unsigned).
        correct: changes the states before each step, from them, the inputs at the start of the
            step and this step's row of ``rows``.
        rows: series that ``correct`` reads, ``(N,)`` each.
        uniform: all steps are as long as the first (or of no length, at the end, where nothing is
            read any more): the weights of relaxing states are then worked out once.
        substeps: parts of equal length into which each step is divided; a traced number makes one
            program for all of them, of a loop within the loop.
        compact: see `advance`.
        padded: steps of no length at the end are left out, and what is returned there is the
            start. For one run at a time: side by side, runs of several lengths would copy all that
            they return at each step.

    Returns:
        Each state after every step, before any correction, ``(N + 1,)`` with the start in front.
    """
    if not start:
        return {}
    values = {name: value for name, (value, _) in restart.items()}

    first = {name: jnp.asarray(value, float) for name, value in start.items()}
    fast = {
        name: exponential_weights((steps[0] if uniform else steps) / substeps, k.decay)
        for name, k in rates(first, {name: value[0] for name, value in inputs.items()}).items()
        if isinstance(k, Relaxing)
    }

    def body(state: dict[str, Any], x: Any) -> dict[str, Any]:
        inputs_now, step, anew, weights, row = x
        weights = fast if uniform else weights
        for name, value in anew.items():
            # by `where`: a branch in the body would break up the fused kernel
            signed = jnp.where(restart[name][1] & (state[name] < 0), -value, value)
            state = {**state, name: jnp.where(jnp.isnan(value), state[name], signed)}
        if correct:
            state = correct(state, {name: value[0] for name, value in inputs_now.items()}, row)

        def further(substep: Any, state: dict[str, Any]) -> dict[str, Any]:
            part = jnp.asarray(substep, float)
            inputs_within = {
                name: within(value, part, substeps) for name, value in inputs_now.items()
            }
            return advance(rates, state, inputs_within, step / substeps, weights, compact)

        if isinstance(substeps, int) and substeps == 1:
            return further(0, state)
        # a loop whose length is known beforehand can be differentiated backwards, too
        parts = substeps if isinstance(substeps, int) else jnp.asarray(substeps, int)
        return jax.lax.fori_loop(0, parts, further, state)

    def kept(state: dict[str, Any], x: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        after = body(state, x)
        return after, after

    rows_of_steps = (dict(inputs), steps, values, {} if uniform else fast, rows)
    if padded:
        # logs padded to a shared length share a program; this loop does not pay for the padding
        after = _until_the_end(body, first, rows_of_steps, steps)
    else:
        # not unrolled: 10 000 steps of a thruster took 0.17 ms so, and 1.8 ms unrolled by 16
        _, after = jax.lax.scan(kept, first, rows_of_steps)
    return {name: jnp.concatenate([first[name][None], after[name]]) for name in first}


def _until_the_end(
    body: Callable[[dict[str, Any], Any], dict[str, Any]],
    first: dict[str, Any],
    rows: Any,
    steps: Any,
) -> dict[str, Any]:
    """What a scan collects, but of the steps up to the last that has a length."""

    def advanced(i: Any, carry: Any) -> Any:
        state, after = carry
        state = body(state, jax.tree.map(lambda row: row[i], rows))
        return state, {name: after[name].at[i].set(state[name]) for name in after}

    rows = jax.tree.map(jnp.asarray, rows)
    after = {name: jnp.broadcast_to(value, steps.shape) for name, value in first.items()}
    # The last step that has a length, not the number of such steps: two samples at one time stamp
    # leave a step of no length inside a log.
    count = jnp.max(jnp.where(steps != 0.0, jnp.arange(1, steps.size + 1), 0))
    return jax.lax.fori_loop(0, count, advanced, (first, after))[1]


def within(value: tuple[Any, ...], substep: Any, substeps: Any) -> tuple[Any, ...]:
    """An input over one of the equal parts of a step, as `integrate` is given it for the whole."""
    if len(value) == 1 or (isinstance(substeps, int) and substeps == 1):
        return value
    rise = (value[1] - value[0]) / substeps
    return value[0] + rise * substep, value[0] + rise * (substep + 1)
