"""Least squares, and quadratic functions, within limits; traceable."""

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


_STEPS = 60  # most of them; some fifteen to thirty are taken
_CLOSE = 1e-11  # where the steps end, as a share of what the problem is about
_RIDGE = 1e-12  # share of the largest square that keeps the matrix regular


def least_squares_below(
    jacobian: Float[Array, "residuals n"],
    residual: Float[Array, " residuals"],
    rows: Float[Array, "m n"],
    limits: Float[Array, " m"],
    give: Float[Array, " m"],
) -> Float[Array, " n"]:
    """Minimize ``|jacobian @ x + residual|^2`` where ``rows @ x <= limits``; traceable.

    Limits are infinite where there is none. A row with a ``give`` above zero may be exceeded, at a
    price: ``(excess / give)^2`` is added to the sum of squares. Then there is always a solution;
    rows without a give must leave a point that fulfils them all. Two equal columns have no values
    of their own, only a sum.

    Source: Mehrotra's predictor and corrector, Nocedal & Wright 2006, algorithm 16.4; a give is
    a slack of its own, eliminated.
    """
    # a row of zeros below one is always fulfilled: shapes stay fixed whatever limits are infinite
    kept = jnp.isfinite(limits)
    rows = jnp.where(kept[:, None], rows, 0.0)
    limits = jnp.where(kept, limits, 1.0)
    hessian, slope = jacobian.T @ jacobian, jacobian.T @ residual
    size = jnp.max(jnp.diag(hessian)) + jnp.finfo(float).tiny
    hessian, slope = hessian / size + _RIDGE * jnp.eye(slope.size), slope / size
    # eliminating the slack of a soft row leaves give^2 on the diagonal, scaled as the hessian is
    soft = give**2 * size
    scale = 1.0 + jnp.max(jnp.abs(slope))

    def missing(x: Array, price: Array, room: Array) -> tuple[Array, Array]:
        return hessian @ x + slope + rows.T @ price, rows @ x + room - soft * price - limits

    def reach(value: Array, step: Array) -> Array:
        share = jnp.where(step < 0, -value / jnp.where(step < 0, step, -1.0), jnp.inf)
        return jnp.minimum(1.0, jnp.min(share, initial=jnp.inf))

    def improve(state: Any) -> Any:
        x, price, room, count, _ = state
        uphill, open_ = missing(x, price, room)
        weight = 1.0 / (room / price + soft)
        factor = jax.scipy.linalg.cho_factor(hessian + (rows.T * weight[None]) @ rows)

        def newton(product: Array) -> tuple[Array, Array, Array]:
            """The step towards ``price * room`` smaller by ``product``."""
            gap = weight * (open_ - product / price)
            dx = jax.scipy.linalg.cho_solve(factor, -uphill - rows.T @ gap)
            dprice = weight * (rows @ dx) + gap
            return dx, dprice, -(product + room * dprice) / price

        _, dprice, droom = newton(price * room)
        mean = jnp.mean(price * room)
        length = jnp.minimum(reach(price, dprice), reach(room, droom))
        ahead = jnp.mean((price + length * dprice) * (room + length * droom))
        # Mehrotra's heuristic: the more the predictor gains, the less the next step is centred
        centre = (ahead / mean) ** 3 * mean
        dx, dprice, droom = newton(price * room + dprice * droom - centre)
        # on the boundary itself a weight would be infinite
        length = 0.995 * jnp.minimum(reach(price, dprice), reach(room, droom))
        x, price, room = x + length * dx, price + length * dprice, room + length * droom
        uphill, open_ = missing(x, price, room)
        far = jnp.maximum(jnp.max(jnp.abs(uphill)) / scale, jnp.max(jnp.abs(open_)))
        solved = (far < _CLOSE) & (jnp.max(price * room) < _CLOSE * scale)
        return x, price, room, count + 1, solved

    ones = jnp.ones_like(limits)
    start = (jnp.zeros_like(slope), ones, jnp.maximum(limits, 0.0) + 1.0, 0, jnp.array(False))
    x, *_ = jax.lax.while_loop(lambda s: ~s[4] & (s[3] < _STEPS), improve, start)
    return x


_DAMPING = 1e-13
"""Share of the squares that keeps the matrix regular, below their rounding."""


def least_squares_within(
    jacobian: Float[Array, "rows n"],
    residual: Float[Array, " rows"],
    low: Float[Array, " n"],
    high: Float[Array, " n"],
    start: Float[Array, " n"],
) -> Float[Array, " n"]:
    """Minimize ``|jacobian @ x + residual|^2`` over ``low <= x <= high``; traceable.

    Where two columns are equal, only the sum of both is found.
    """
    hessian, slope_at_zero = jacobian.T @ jacobian, jacobian.T @ residual
    largest = jnp.max(jnp.diag(hessian)) + jnp.finfo(float).tiny
    # the second term serves columns of zeros: an input without effect, such as a rudder at rest
    ridge = jnp.maximum(_DAMPING * jnp.diag(hessian), _DAMPING**2 * largest)
    hessian = hessian + jnp.diag(ridge)
    # unit diagonal and unit residual: the box solver's tolerances are then those of any problem
    scale = jnp.sqrt(jnp.diag(hessian))
    size = jnp.linalg.norm(residual) + jnp.finfo(float).tiny
    left, right = (low - start) * scale / size, (high - start) * scale / size
    slope = (hessian @ start + slope_at_zero) / scale / size
    step = least_in_box(hessian / scale[:, None] / scale[None, :], slope, left, right)
    x = jnp.clip(start + step * size / scale, low, high)
    # at a limit exactly, without the rounding of scale and back: limits of inputs always hold
    return jnp.where(step <= left, low, jnp.where(step >= right, high, x))
