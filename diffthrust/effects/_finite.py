"""Powers, roots, logarithms and quotients that are finite everywhere, and so are their slopes.

A fit takes derivatives at rest, too, and at exponents that it is about to find: the plain functions
give infinities there. These agree with them wherever a size is above a millionth.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp

from diffthrust.models._base.signals import Signal

_FLOOR = 1e-6
"""Powers, roots and logarithms go on below this as if they came from it."""
_LEAST = 1e-12
"""What divides is no smaller."""
_HIGHEST = 80.0
"""An exponential grows no further than that of this."""


def raised(base: Signal, exponent: Signal | float, xp: Any = jnp) -> Signal:
    """The power of the base's size; a straight line through zero below a millionth.

    Args:
        base: of either sign, which is lost.
        exponent: above zero.
        xp: whose functions are used, `jax.numpy` or `numpy`.

    Example:
        >>> float(raised(-4.0, 1.5))
        8.0
    """
    size = xp.abs(base)
    # |x|^0.5 has an infinite slope at rest, where logs begin; and x^p by p is x^p log x: NaN
    # at 0
    return xp.minimum(size / _FLOOR, 1.0) * xp.maximum(size, _FLOOR) ** exponent


def square_root(x: Signal, xp: Any = jnp) -> Signal:
    """The square root; zero below zero."""
    return raised(xp.maximum(x, 0.0), 0.5, xp)


def logarithm(x: Signal, xp: Any = jnp) -> Signal:
    """The natural logarithm; of a millionth below that."""
    return xp.log(xp.maximum(x, _FLOOR))


def exponential(x: Signal, xp: Any = jnp) -> Signal:
    """The exponential; constant above 80."""
    return xp.exp(xp.minimum(x, _HIGHEST))


def quotient(above: Signal | float, below: Signal, xp: Any = jnp) -> Signal:
    """One signal over another, whose size is taken as 1e-12 at least."""
    return above / xp.where(xp.abs(below) < _LEAST, xp.where(below < 0, -_LEAST, _LEAST), below)
