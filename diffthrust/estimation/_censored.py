"""Samples at the end of a sensor's range, taken as "at least" or "at most" (Tobin 1958)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support.words import joined
from diffthrust.estimation._laws import Gaussian, Law
from diffthrust.estimation._numbers import Batch, ProblemNumbers
from diffthrust.simulation._record import Record

_ROUNDS = 100
"""Of the level of the noise: each leaves the share of the samples that stand at a rail."""
_TAIL = 30.0
"""Standard deviations from which on the series of Mills's ratio serves (1e-9 at five terms)."""


@dataclass(frozen=True)
class Censored(Gaussian):
    """The normal law, of which samples at a rail say only on which side of it they lie.

    Such a sample counts by the probability that the sensor would have shown more than the rail:
    with what lies between the two as a = (modelled - rail) / level (the other way round at the
    lower rail) by -log Phi(a). Its slope is the inverse of Mills's ratio, m(a) = phi(a) / Phi(a),
    and its curvature m (m + a). The best level is the fixed point of expectation and maximisation
    (Dempster, Laird & Rubin 1977), with E(e^2) = 1 - a m(a) where the sample stands at a rail.
    """

    word: ClassVar[str] = "gaussian"
    closed: ClassVar[bool] = False
    censors: ClassVar[bool] = True

    def cost(
        self, rests: Sequence[Any], numbers: ProblemNumbers, levels_known: Sequence[bool]
    ) -> Any:
        """A level that is not known is where the likelihood is highest."""
        counts, fixed = numbers.counts, jnp.asarray(levels_known)
        sides = [_sides(batch) for batch in numbers.batches]
        inside = counts - sum(jnp.sum(jnp.abs(side), axis=(0, 2)) for side in sides)
        within = [jnp.where(side == 0, r, 0.0) for r, side in zip(rests, sides, strict=True)]
        squares = sum(jnp.sum(r**2, axis=(0, 2)) for r in within)

        def reweighted(_: int, s: Any) -> Any:
            beyond = jnp.zeros_like(s)
            for residual, side in zip(rests, sides, strict=True):
                a = -side * residual / s[None, :, None]
                beyond += jnp.sum(jnp.where(side == 0, 0.0, 1.0 - a * _mills(a)[0]), axis=(0, 2))
            pooled = jnp.sqrt((squares + s**2 * beyond) / counts + numbers.floor)
            return jnp.where(fixed, s, pooled)

        first = jnp.sqrt(squares / jnp.maximum(inside, 1.0) + numbers.floor)
        sigma = jax.lax.fori_loop(0, _ROUNDS, reweighted, jnp.where(fixed, numbers.noise, first))
        cost = 0.5 * squares / sigma**2 + inside * jnp.log(sigma)
        for residual, side in zip(rests, sides, strict=True):
            a = -side * residual / sigma[None, :, None]
            likely = jax.scipy.special.log_ndtr(a)
            cost -= jnp.sum(jnp.where(side == 0, 0.0, likely), axis=(0, 2))
        return jnp.sum(cost), sigma

    def straight(self, residual: Any, sigma: Any, batch: Batch) -> tuple[Any, Any]:
        """Of a sample at a rail the error that has its slope, under the weight of its curvature."""
        side, level = _sides(batch), sigma[None, :, None]
        slope, room = _mills(-side * residual / level)
        return (
            jnp.where(side == 0, residual, side * level / room),
            jnp.where(side == 0, 1.0, slope * room),
        )

    def bend(self, rests: Sequence[Any], numbers: ProblemNumbers, sigma: Any) -> list[Any]:
        """The curvature of each sample."""
        pairs = zip(rests, numbers.batches, strict=True)
        return [self.straight(residual, sigma, batch)[1] for residual, batch in pairs]


def _sides(batch: Batch) -> Any:
    """1 where a sample says "at least", -1 where it says "at most", 0 elsewhere."""
    side = jnp.asarray(batch.beyond)
    return jnp.where(jnp.isnan(batch.measured), 0.0, side.astype(float))


def _mills(a: Any) -> tuple[Any, Any]:
    """phi(a) / Phi(a), and what it exceeds -a by."""
    # `where` evaluates both forms everywhere: each is clipped to its own range, so that the one not
    # chosen neither divides by zero nor cancels
    far, near = jnp.maximum(-a, _TAIL), jnp.maximum(a, -_TAIL)
    ratio = jnp.exp(jax.scipy.stats.norm.logpdf(near) - jax.scipy.special.log_ndtr(near))
    room = (1.0 - 2.0 / far**2 + 10.0 / far**4 - 74.0 / far**6) / far
    tail = a < -_TAIL
    return jnp.where(tail, far + room, ratio), jnp.where(tail, room, ratio + near)


def at_rails(batch: Batch, records: Sequence[Record], channels: Sequence[str]) -> Batch:
    """A batch in which samples at the rails of censored channels stand at them, and on which side.

    Args:
        batch: of these records, without such samples.
        records: of the batch.
        channels: of the batch.
    """
    measured = np.array(batch.measured)
    beyond = np.zeros(measured.shape, np.int8)
    for row, record in enumerate(records):
        for column, name in enumerate(channels):
            if name in record.rails:
                places, values, sides = record.rails[name]
                measured[row, column, places] = values
                beyond[row, column, places] = sides
    return replace(batch, measured=measured, beyond=beyond)


def are_censored(records: Sequence[Record]) -> bool:
    """Whether any sample is to be taken as "at least" or "at most"."""
    return any(record.rails for record in records)


def rail_notes(law: Law, records: Sequence[Record]) -> tuple[str, ...]:
    """A note on how a fit took the samples at the rails of censored channels."""
    if not are_censored(records):
        return ()
    counts: dict[str, int] = {}
    for record in records:
        for name in sorted(record.rails):
            counts[name] = counts.get(name, 0) + record.rails[name].sides.size
    samples = joined([f"{count} of {name}" for name, count in counts.items()])
    if law.censors:
        return (f"Samples at a rail are taken as 'at least' or 'at most' it: {samples}.",)
    return (
        f"Samples at a rail carry no weight: {samples}. Only likelihood='simulation' with white "
        "Gaussian noise can take them as 'at least' or 'at most'.",
    )
