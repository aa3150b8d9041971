"""Linear least squares between limits: what each Gauss-Newton step of an MPC solves."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from diffthrust._support.box import least_in_box

_RIDGE = 1e-13
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
    ridge = jnp.maximum(_RIDGE * jnp.diag(hessian), _RIDGE**2 * largest)
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
