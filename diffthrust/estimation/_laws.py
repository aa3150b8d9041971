"""Laws of errors: how likely a residual is beside the level of the noise.

A law is one class here and its place in `LOSSES` of `_arguments`: fits, spec files, predictions,
posteriors and the advice on noise ask it for the rest. Its numbers must agree with each other;
`tests/estimation/test_error_laws.py` holds those of every law in the registry against its density.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support.words import joined
from diffthrust.estimation._numbers import Batch, ProblemNumbers
from diffthrust.simulation._record import Record

TAIL = 4.0
"""Degrees of freedom of the Student-t law behind ``loss="student_t"``."""
_ROUNDS = 60
"""Rounds of reweighting for a noise level. Under Student's law each leaves 3/7 of the error."""


class Law(ABC):
    """A law of errors; fixes the compiled code of a problem.

    With the level s of the noise and u = error / s, the negative log-likelihood of a sample is
    penalty(u) + constant + log(s), and the slope of the penalty is weight(u) u.
    """

    word: ClassVar[str]
    """Its name among the losses of `fit`."""
    suits: ClassVar[str]
    """Which errors it is for, in a few words of a comment: "where there are outliers"."""
    shows: ClassVar[str] = "have more large values than Gaussian noise"
    """What residuals of this law do that those of the normal law do not."""
    forgiving: ClassVar[bool] = True
    """A large error counts for less than its square."""
    closed: ClassVar[bool] = False
    """The best level of the noise follows in closed form, and may be integrated out."""
    constant: ClassVar[float]
    """Minus the logarithm of the density of no error, at a level of one."""
    excess: ClassVar[float]
    """The weighted information of a fit over the Fisher information: E(weight) / E(score^2)."""
    level_information: ClassVar[float]
    """Fisher information of one sample on the logarithm of the level."""
    censors: ClassVar[bool] = False
    """It takes samples at a rail as "at least" or "at most"."""

    @abstractmethod
    def penalty(self, error: Any) -> Any:
        """What an error at a level of one adds to the cost, zero for none; NumPy's or traced."""

    @abstractmethod
    def weight(self, error: Any) -> Any:
        """The slope of the penalty over the error, also where there is none; NumPy's or traced."""

    @abstractmethod
    def below(self, error: Any) -> Any:
        """The probability of a lower error, at a level of one; traceable."""

    @abstractmethod
    def draws(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        """Errors at a level of one."""

    def cost(
        self, rests: Sequence[Any], numbers: ProblemNumbers, levels_known: Sequence[bool]
    ) -> Any:
        """Negative log-likelihood without constants, and the noise level of each channel.

        A level that is not known is the fixed point of the law's reweighting. The residuals are
        those of each batch, ``(B, C, T)``; ``levels_known`` says of which channels it is.
        """
        counts, fixed = numbers.counts, jnp.asarray(levels_known)
        sigma = jnp.where(fixed, numbers.noise, _pooled(rests, numbers)[1])

        def reweight(_: int, s: Any) -> Any:
            weighted = sum(jnp.sum(r**2 * self.weights(r, s), axis=(0, 2)) for r in rests)
            return jnp.where(fixed, s, jnp.sqrt(weighted / counts + numbers.floor))

        sigma = jax.lax.fori_loop(0, _ROUNDS, reweight, sigma)
        return jnp.sum(self.penalties(rests, sigma) + counts * jnp.log(sigma)), sigma

    def penalties(self, rests: Sequence[Any], sigma: Any) -> Any:
        """The sum of the penalties of each channel, ``(C,)``."""
        level = sigma[None, :, None]
        return sum(jnp.sum(self.penalty(r / level), axis=(0, 2)) for r in rests)

    def weights(self, residual: Any, sigma: Any) -> Any:
        """How much the square of each residual counts, ``(B, C, T)``."""
        return self.weight(residual / sigma[None, :, None])

    def straight(self, residual: Any, sigma: Any, batch: Batch) -> tuple[Any, Any]:
        """Residuals and weights, ``(B, C, T)``, whose squares slope and bend as the law does."""
        return residual, self.weights(residual, sigma)

    def bend(self, rests: Sequence[Any], numbers: ProblemNumbers, sigma: Any) -> list[Any]:
        """Slope of the law's score, by batch; to be broadcast to ``(B, C, T)``.

        It is the mean over the samples of each channel, measured on the residuals.
        """

        def score(error: Any) -> Any:
            return error * self.weight(error)

        total = jnp.zeros_like(sigma)
        for residual, batch in zip(rests, numbers.batches, strict=True):
            error = residual / sigma[None, :, None]
            slope = jax.jvp(score, (error,), (jnp.ones_like(error),))[1]
            total += jnp.where(jnp.isnan(batch.measured), 0.0, slope).sum(axis=(0, 2))
        # of Student's law itself it is 5 / 7; residuals with heavier shoulders may lower it, even
        # below zero, where an information matrix would no longer be one
        return [jnp.maximum(total / numbers.counts, 0.1)[None, :, None] for _ in rests]

    def level_cost(self, residuals: np.ndarray) -> float:
        """Negative log-likelihood of a series at the best level of the noise, with constants."""
        level = float(np.sqrt(np.mean(residuals**2))) or 1e-300
        for _ in range(0 if self.closed else _ROUNDS):
            weights = self.weight(residuals / level)
            level = float(np.sqrt(np.mean(weights * residuals**2))) or 1e-300
        penalties = self.penalty(residuals / level)
        return float(penalties.sum()) + residuals.size * (math.log(level) + self.constant)


def _pooled(rests: Sequence[Any], numbers: ProblemNumbers) -> tuple[Any, Any]:
    """Sums of squares of each channel, and root mean squares."""
    squares = sum(jnp.sum(r**2, axis=(0, 2)) for r in rests)
    return squares, jnp.sqrt(squares / numbers.counts + numbers.floor)


def _namespace(error: Any) -> Any:
    """NumPy for its own arrays: JAX would compile each operation for each length of a log."""
    return np if isinstance(error, np.ndarray) else jnp


@dataclass(frozen=True)
class Gaussian(Law):
    """The normal law: an error counts by its square."""

    word: ClassVar[str] = "gaussian"
    suits: ClassVar[str] = "where errors have no outliers"
    shows: ClassVar[str] = "are Gaussian"
    forgiving: ClassVar[bool] = False
    closed: ClassVar[bool] = True
    constant: ClassVar[float] = 0.5 * math.log(2.0 * math.pi)
    excess: ClassVar[float] = 1.0
    level_information: ClassVar[float] = 2.0

    def penalty(self, error: Any) -> Any:
        return 0.5 * error**2

    def weight(self, error: Any) -> Any:
        return _namespace(error).ones_like(error)

    def cost(
        self, rests: Sequence[Any], numbers: ProblemNumbers, levels_known: Sequence[bool]
    ) -> Any:
        """A level that is not known is the root mean square of the residuals."""
        squares, pooled = _pooled(rests, numbers)
        fixed = jnp.asarray(levels_known)
        sigma = jnp.where(fixed, numbers.noise, pooled)
        cost = jnp.where(fixed, 0.5 * squares / sigma**2, numbers.counts * jnp.log(pooled))
        return jnp.sum(cost), sigma

    def bend(self, rests: Sequence[Any], numbers: ProblemNumbers, sigma: Any) -> list[Any]:
        return [jnp.ones((1, 1, 1)) for _ in rests]

    def level_cost(self, residuals: np.ndarray) -> float:
        """In closed form: summed up, its rounding would move a search along a flat valley."""
        level = float(np.sqrt(np.mean(residuals**2))) or 1e-300
        return residuals.size * (math.log(level) + self.constant + 0.5)

    def below(self, error: Any) -> Any:
        return jax.scipy.stats.norm.cdf(error)

    def draws(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        return rng.standard_normal(shape)


@dataclass(frozen=True)
class StudentT(Law):
    """Student's law of `TAIL` degrees of freedom, which forgives outliers.

    Of n degrees of freedom the weighted information is (n + 3) / (n + 1) times the Fisher
    information (Lange, Little & Taylor 1989).
    """

    word: ClassVar[str] = "student_t"
    suits: ClassVar[str] = "where there are outliers"
    constant: ClassVar[float] = (
        0.5 * math.log(TAIL * math.pi) + math.lgamma(TAIL / 2) - math.lgamma((TAIL + 1) / 2)
    )
    excess: ClassVar[float] = (TAIL + 3) / (TAIL + 1)
    level_information: ClassVar[float] = 2.0 * TAIL / (TAIL + 3)

    def penalty(self, error: Any) -> Any:
        return 0.5 * (TAIL + 1) * _namespace(error).log1p(error**2 / TAIL)

    def weight(self, error: Any) -> Any:
        return (TAIL + 1) / (TAIL + error**2)

    # Both divide squares instead of squaring quotients, as the law was first written: along flat
    # valleys the last digit leads fits of a diagnosis to other ends (the BIC of a rate limit
    # beside a reverse asymmetry to -46 for -346, and a rudder's lag from detectable to missed).

    def penalties(self, rests: Sequence[Any], sigma: Any) -> Any:
        level = sigma[None, :, None]
        scaled = sum(jnp.sum(jnp.log1p(r**2 / (TAIL * level**2)), axis=(0, 2)) for r in rests)
        return 0.5 * (TAIL + 1) * scaled

    def weights(self, residual: Any, sigma: Any) -> Any:
        return (TAIL + 1) / (TAIL + residual**2 / sigma[None, :, None] ** 2)

    def below(self, error: Any) -> Any:
        """The closed form for four degrees of freedom."""
        u = 1.0 + error**2 / TAIL
        return 0.5 + 0.375 * error / jnp.sqrt(u) * (1.0 - error**2 / (12.0 * u))

    def draws(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        return rng.standard_t(TAIL, shape)


_CENSORED_ROUNDS = 100
"""Of the level of the noise: each leaves the share of the samples that stand at a rail."""
_MILLS_TAIL = 30.0
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
        sigma = jax.lax.fori_loop(
            0, _CENSORED_ROUNDS, reweighted, jnp.where(fixed, numbers.noise, first)
        )
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
    far, near = jnp.maximum(-a, _MILLS_TAIL), jnp.maximum(a, -_MILLS_TAIL)
    ratio = jnp.exp(jax.scipy.stats.norm.logpdf(near) - jax.scipy.special.log_ndtr(near))
    room = (1.0 - 2.0 / far**2 + 10.0 / far**4 - 74.0 / far**6) / far
    tail = a < -_MILLS_TAIL
    return jnp.where(tail, far + room, ratio), jnp.where(tail, room, ratio + near)


def at_rails(batch: Batch, records: Sequence[Record], channels: Sequence[str]) -> Batch:
    """A batch in which samples at the rails of censored channels stand at them, and on which side.

    It is made of a ``batch`` of these records without such samples.
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
        return (f"Saturated samples are taken as 'at least' or 'at most': {samples}.",)
    return (
        f"Saturated samples are ignored: {samples}. Only likelihood='simulation' with white "
        "Gaussian noise can take them as 'at least' or 'at most'.",
    )
