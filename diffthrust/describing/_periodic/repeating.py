"""Where a series must begin to repeat itself, if it hardly forgets how it began.

The command that a rate limit lets through is a triangle where the limit always acts. Its mean tends
to that of the command, but by a share of 4 rate / (amplitude frequency) in a period only. So the
start is sought instead: from one below the right one the series rises from period to period, from
one above it falls, for effects with memory keep the order of two series.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

_HALVINGS = 40
"""Halvings of the range of starts. A thruster that turns slowly under a fast command feels the
smallest mean."""
STARTS_APART = 0.01
"""Starts that all repeat may be so far apart, of the swing of the series."""
_STILL = 1e-8
"""A series repeats that rises less in a period, of the input's amplitude: the clock is rounded."""


def repeating_start(
    reached: Callable[[Array], Float[Array, " n"]], amplitude: Float[Array, ""], period: int
) -> tuple[Float[Array, ""], Bool[Array, ""]]:
    """The start of a series that repeats.

    A rate limit that is worked out sample by sample does not feel where between two of them it
    switches: a range of starts repeats. Its middle is taken, which is the right one for a command
    that swings evenly; the range shrinks as the steps get finer.

    Args:
        reached: the series over two periods, from the deviation with which the input begins.
        amplitude: of the input; no start can be farther from its mean.
        period: instants of a period.

    Returns:
        The deviation, and whether the range is narrow: only then there is one answer.
    """

    def rise(begin: Array) -> Array:
        series = reached(begin)
        return jnp.mean(series[-period:] - series[-2 * period : -period]) / amplitude

    def edge(least: Array) -> Array:
        def halve(_: Array, ends: tuple[Array, Array]) -> tuple[Array, Array]:
            low, high = ends
            middle = 0.5 * (low + high)
            rises = rise(middle) > least
            return jnp.where(rises, middle, low), jnp.where(rises, high, middle)

        return jax.lax.fori_loop(0, _HALVINGS, halve, (-amplitude, amplitude))[0]

    # bisection, since the rise is flat over the range of starts that repeat and has no slope to
    # follow
    low, high = jax.vmap(edge)(jnp.asarray([_STILL, -_STILL]))
    begin = 0.5 * (low + high)
    return begin, high - low <= STARTS_APART * jnp.ptp(reached(begin)[-period:])
