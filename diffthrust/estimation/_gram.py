"""Inner products of a few long series."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

_FEW = 6
"""Of so many series all pairs go into one pass: its compilation takes longer the more they are."""


def gram(series: list[Any]) -> Any:
    """Inner products of series with each other.

    A matrix product first writes the series to memory and is slow for matrices of a few rows. Of a
    few series all products are summed in one pass, into which XLA also draws what the series are
    made from: several times faster than all else in a Gauss-Newton step.

    Args:
        series: ``k`` arrays ``(B, C, T)``.

    Returns:
        Sums over ``C`` and ``T``, ``(B, k, k)``.
    """
    k = len(series)
    if k > _FEW:
        rows = jnp.stack(series, axis=1).reshape(series[0].shape[0], k, -1)
        return jnp.einsum("bit,bjt->bij", rows, rows)
    pairs = [(i, j) for i in range(k) for j in range(i + 1)]
    sums = jax.lax.reduce(
        tuple(series[i] * series[j] for i, j in pairs),
        (jnp.zeros(()),) * len(pairs),
        lambda one, other: tuple(a + b for a, b in zip(one, other, strict=True)),
        (1, 2),
    )
    found = dict(zip(pairs, sums, strict=True))
    whole = [[found[max(i, j), min(i, j)] for j in range(k)] for i in range(k)]
    return jnp.stack([jnp.stack(row, axis=-1) for row in whole], axis=-2)
