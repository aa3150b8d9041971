"""Fixed-step fourth-order integration over a log's grid, in one scan.

Plain states are advanced by the classical Runge-Kutta method. `Relaxing` states are advanced by
its exponential form (Cox & Matthews 2002, equations 26 to 29), which is the same method where the
decay is slow and exact where it is fast. What the other states see of a relaxing state at the start
and in the middle of a step is corrected such that its mean over the step is exact: the weights of
the method would otherwise count one sixth of the old value, however fast the decay. A vanishing
time constant then gives the model without the lag, and the order stays four.

The carry is a dictionary of scalars and the body is elementwise, so XLA compiles the loop as one
fused kernel; stacking, unrolling or branching would lose that. For the same reason the weights of
the exponential form are worked out ahead of the loop, for all steps at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp

from diffthrust.models._base.signals import Relaxing

Rates = Callable[[Mapping[str, Any], Mapping[str, Any]], Mapping[str, Any]]
"""From states and inputs at one instant to the rate of each state."""
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
    uniform: bool = False,
) -> dict[str, Any]:
    """Integrate a system of first-order equations over given steps.

    Args:
        rates: the right-hand side; evaluated with scalars.
        start: initial states, scalars.
        inputs: for each input ``(held,)``, ``(at_start, at_end)`` or ``(at_start, in_the_middle,
            at_end)`` of every step, each ``(N,)``; the second is linear within the step.
        steps: step lengths [s], ``(N,)``.
        restart: for some states ``(values, unsigned)``: where a value, ``(N,)``, is finite, the
            state is set to it before the step (with the state's own sign where unsigned).
        correct: changes the states before each step, from them, the inputs at the start of the
            step and this step's row of ``rows``.
        rows: series that ``correct`` reads, ``(N,)`` each.
        uniform: all steps are as long as the first (or of no length, at the end, where nothing is
            read any more): the weights of relaxing states are then worked out once.

    Returns:
        Each state after every step, before any correction, ``(N + 1,)`` with the start in front.
    """
    if not start:
        return {}
    values = {name: value for name, (value, _) in restart.items()}

    first = {name: jnp.asarray(value, float) for name, value in start.items()}
    fast = {
        name: exponential_weights(steps[0] if uniform else steps, k.decay)
        for name, k in rates(first, {name: value[0] for name, value in inputs.items()}).items()
        if isinstance(k, Relaxing)
    }

    each = {} if uniform else fast

    def body(state: dict[str, Any], x: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        inputs_now, step, anew, weights, row = x
        weights = fast if uniform else weights
        for name, value in anew.items():
            signed = jnp.where(restart[name][1] & (state[name] < 0), -value, value)
            state = {**state, name: jnp.where(jnp.isnan(value), state[name], signed)}
        if correct:
            state = correct(state, {name: value[0] for name, value in inputs_now.items()}, row)
        state = advance(rates, state, inputs_now, step, weights)
        return state, state

    _, after = jax.lax.scan(body, first, (dict(inputs), steps, values, each, rows))
    return {name: jnp.concatenate([first[name][None], after[name]]) for name in first}


def advance(
    rates: Rates,
    x: Mapping[str, Any],
    inputs: Mapping[str, tuple[Any, ...]],
    h: Any,
    weights: Mapping[str, Mapping[str, Any]],
) -> dict[str, Any]:
    """The states one step later; arguments as of `integrate`, for this step alone.

    ``weights`` are the `exponential_weights` of the relaxing states, by name.
    """
    early = {name: value[0] for name, value in inputs.items()}
    late = {name: value[-1] for name, value in inputs.items()}
    middle = {
        name: 0.5 * (value[0] + value[1]) if len(value) == 2 else value[len(value) // 2]
        for name, value in inputs.items()
    }

    def stage(plain: Callable[[str], Any], fast: Callable[[str], Any]) -> dict[str, Any]:
        return {name: fast(name) if name in weights else plain(name) for name in x}

    def slope(state: Mapping[str, Any], u: Mapping[str, Any]) -> dict[str, Any]:
        """The rates; of relaxing states the part that the frozen decay leaves."""
        slopes = rates(state, u)
        return {
            name: plain_rate(k) + weights[name]["decay"] * state[name] if name in weights else k
            for name, k in slopes.items()
        }

    k1 = {name: plain_rate(k) for name, k in rates(x, early).items()}
    n1 = slope(stage(x.__getitem__, lambda n: x[n] + h * weights[n]["start"] * k1[n]), early)
    w = {name: _Stage(x[name], h, k1[name], n1[name], weights[name]) for name in weights}
    a = stage(lambda n: x[n] + 0.5 * h * n1[n], lambda n: w[n].middle(n1[n]))
    if weights:  # a fast state follows the rise of its target within the step, too
        ahead = slope(a, middle)
        a = stage(a.__getitem__, lambda n: a[n] + h * weights[n]["ramp"] * (ahead[n] - n1[n]))
    n2 = slope(a, middle)
    b = stage(lambda n: x[n] + 0.5 * h * n2[n], lambda n: w[n].middle(n2[n]))
    n3 = slope(b, middle)
    c = stage(lambda n: x[n] + h * n3[n], lambda n: w[n].end(n3[n]))
    n4 = slope(c, late)
    return stage(
        lambda n: x[n] + h / 6.0 * (n1[n] + 2.0 * n2[n] + 2.0 * n3[n] + n4[n]),
        lambda n: w[n].final(n2[n], n3[n], n4[n]),
    )


def plain_rate(k: Any) -> Any:
    """The number in a rate that may be `Relaxing`."""
    return k.rate if isinstance(k, Relaxing) else k


def with_push(k: Any, push: Any) -> Any:
    """A rate that may be `Relaxing`, with something added to it."""
    return k._replace(rate=k.rate + push) if isinstance(k, Relaxing) else k + push


class _Stage:
    """One relaxing state within one step."""

    def __init__(self, x: Any, h: Any, rate: Any, n1: Any, weights: Mapping[str, Any]) -> None:
        self.x, self.h, self.rate, self.n1, self.w = x, h, rate, n1, weights

    def _half(self, n: Any) -> Any:
        return self.w["half"] * self.x + 0.5 * self.h * self.w["grown"] * n

    def middle(self, n: Any) -> Any:
        return self._half(n) - self.h * self.rate * self.w["mean"]

    def end(self, n3: Any) -> Any:
        rise = 0.5 * self.h * self.w["grown"] * (2.0 * n3 - self.n1)
        return self.w["half"] * self._half(self.n1) + rise

    def final(self, n2: Any, n3: Any, n4: Any) -> Any:
        w = self.w
        weighted = self.n1 * w["first"] + 2.0 * (n2 + n3) * w["both"] + n4 * w["last"]
        return w["kept"] * self.x + self.h * weighted


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
