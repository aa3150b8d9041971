"""Linear least squares between limits: what each Gauss-Newton step of an MPC solves."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

_STEPS = 40
"""Rounds at most; a round settles which limits hold, and few are needed from a good guess."""
_LENGTHS = 0.5 ** np.arange(12.0)
"""Of the Newton step."""
_ROUNDING = 1e-12
_RIDGE = 1e-13
"""Share of the squares that keeps the matrix regular, below their rounding."""


def least_squares_within(
    jacobian: Any, residual: Any, low: Any, high: Any, start: Any
) -> tuple[Any, Any]:
    """Minimize ``|jacobian @ x + residual|^2`` over ``low <= x <= high``; traceable.

    Where a limit holds and the slope points out of the box, the variable stays; the others take the
    Newton step for themselves, bent back into the box, at the length that lowers the sum most.

    Args:
        jacobian: ``(m, n)``; of two columns that cannot be told apart, neither has a value of its
            own.
        residual: ``(m,)``.
        low: ``(n,)``.
        high: ``(n,)``, above ``low``.
        start: the first guess, ``(n,)``, within the limits.

    Returns:
        The minimizer, ``(n,)``, and whether the conditions of optimality hold.

    Source: Bertsekas 1982, Projected Newton methods for optimization problems with simple
    constraints, section 2.
    """
    hessian, slope_at_zero = jacobian.T @ jacobian, jacobian.T @ residual
    largest = jnp.max(jnp.diag(hessian)) + jnp.finfo(float).tiny
    ridge = jnp.maximum(_RIDGE * jnp.diag(hessian), _RIDGE**2 * largest)
    hessian = hessian + jnp.diag(ridge)
    scale = jnp.sqrt(jnp.diag(hessian))
    size = jnp.linalg.norm(residual)

    def slope(x: Any) -> Any:
        return hessian @ x + slope_at_zero

    def value(x: Any) -> Any:
        return 0.5 * x @ (hessian @ x) + slope_at_zero @ x

    def held(x: Any, g: Any) -> Any:
        return ((x <= low) & (g >= 0)) | ((x >= high) & (g <= 0))

    def optimal(x: Any) -> Any:
        g = slope(x)
        left = jnp.where(held(x, g), 0.0, jnp.abs(g) / scale)
        return jnp.max(left) <= 1e-9 * size + _ROUNDING

    def unfinished(carry: tuple[Any, Any, Any]) -> Any:
        x, count, stuck = carry
        return ~optimal(x) & (count < _STEPS) & ~stuck

    def improve(carry: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
        x, count, _ = carry
        g = slope(x)
        free = ~held(x, g)
        both = free[:, None] & free[None, :]
        reduced = jnp.where(both, hessian, jnp.diag(jnp.where(free, 0.0, scale**2)))
        step = jnp.linalg.solve(reduced, jnp.where(free, -g, 0.0))
        tried = jax.vmap(lambda length: jnp.clip(x + length * step, low, high))(_LENGTHS)
        values = jax.vmap(value)(tried)
        best = jnp.argmin(values)
        better = values[best] < value(x)
        return jnp.where(better, tried[best], x), count + 1, ~better

    x, _, _ = jax.lax.while_loop(
        unfinished, improve, (jnp.clip(start, low, high), 0, jnp.asarray(False))
    )
    return x, optimal(x)
