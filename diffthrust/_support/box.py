"""Quadratic functions within a box; traceable."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

_ROUNDS = 100  # most rounds for which sides of the box bound a step


def least_in_box(
    matrix: Float[Array, "n n"],
    slope: Float[Array, " n"],
    low: Float[Array, " n"],
    high: Float[Array, " n"],
) -> Float[Array, " n"]:
    """The minimum of ``slope @ x + x @ matrix @ x / 2`` between ``low <= 0`` and ``high >= 0``.

    A primal active set (Nocedal & Wright 2006, section 16.5): from zero towards the minimum over
    the free coordinates, as far as the first side of the box, which then fixes one coordinate more;
    at the minimum, the coordinate with the largest inward slope is released. Clipping the step at
    the sides instead would turn it uphill where coordinates depend on each other.
    """
    # Shapes stay constant for the compiler: fixed coordinates keep their rows, as those of the unit
    # matrix, instead of being removed from the system.
    eye = jnp.eye(slope.size)

    def again(state: Any) -> Any:
        x, fixed, _, count = state
        pull = slope + matrix @ x
        free = jnp.where(fixed[:, None] | fixed[None, :], eye, matrix)
        step = -jnp.linalg.solve(free, jnp.where(fixed, 0.0, pull))
        side = jnp.where(step < 0, low, high)
        reach = jnp.where(fixed | (step == 0), jnp.inf, (side - x) / jnp.where(step == 0, 1, step))
        first = jnp.argmin(reach)
        blocked = reach[first] < 1.0
        x = x + jnp.minimum(1.0, jnp.maximum(reach[first], 0.0)) * step
        x = jnp.where(blocked, x.at[first].set(side[first]), x)
        pull = slope + matrix @ x
        back = jnp.where(x <= low, -pull, 0.0) + jnp.where(x >= high, pull, 0.0)
        back = jnp.where(fixed & (low < high), back, 0.0)
        worst = jnp.argmax(back)
        # Numerics: slopes of rounding size would release and block the same side by turns until
        # _ROUNDS.
        releases = ~blocked & (back[worst] > 1e-12)
        fixed = jnp.where(blocked, fixed.at[first].set(True), fixed)
        fixed = jnp.where(releases, fixed.at[worst].set(False), fixed)
        return x, fixed, blocked | releases, count + 1

    # A coordinate that starts on its bound with the slope pointing outward is fixed from the start:
    # otherwise the first step has length zero.
    outward = ((low == 0) & (slope > 0)) | ((high == 0) & (slope < 0))
    initial = (jnp.zeros_like(slope), outward, jnp.array(True), 0)
    x, *_ = jax.lax.while_loop(lambda state: state[2] & (state[3] < _ROUNDS), again, initial)
    return jnp.clip(x, low, high)
