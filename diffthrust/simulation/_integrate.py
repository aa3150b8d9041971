"""Integration over a log's grid, in one loop.

The carry is a dictionary of scalars and the body is elementwise, so XLA compiles the loop as one
fused kernel; stacking, unrolling or branching would lose that. For the same reason the weights of
the exponential form are worked out ahead of the loop, for all steps at once.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp

from diffthrust.models._base.signals import Relaxing
from diffthrust.simulation._runge_kutta import Rates, advance, exponential_weights

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
