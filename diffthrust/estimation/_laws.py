"""Laws of errors: how likely a residual is beside the level of the noise."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust.estimation._numbers import Batch, ProblemNumbers

TAIL = 4.0
"""Degrees of freedom of the Student-t law behind ``loss="student_t"``."""


class Law(ABC):
    """A law of errors; fixes the compiled code of a problem."""

    word: ClassVar[str]
    """Its name among the losses of `fit`."""
    forgiving: ClassVar[bool]
    """A large error counts for less than its square."""
    closed: ClassVar[bool]
    """The best level of the noise follows in closed form, and may be integrated out."""
    excess: ClassVar[float]
    """The weighted information of a fit over the Fisher information."""
    censors: ClassVar[bool] = False
    """It takes samples at a rail as "at least" or "at most"."""

    @abstractmethod
    def cost(self, rests: Sequence[Any], numbers: ProblemNumbers, known: Sequence[bool]) -> Any:
        """Negative log-likelihood, and the noise level of each channel, known or estimated.

        Args:
            rests: residuals of each batch, ``(B, C, T)``.
            numbers: of the problem.
            known: whether the level of a channel is.
        """

    @abstractmethod
    def weights(self, rest: Any, sigma: Any) -> Any:
        """How much the square of each residual counts, ``(B, C, T)``."""

    def straight(self, rest: Any, sigma: Any, batch: Batch) -> tuple[Any, Any]:
        """Residuals and weights, ``(B, C, T)``, whose squares slope and bend as the law does."""
        return rest, self.weights(rest, sigma)

    @abstractmethod
    def bend(self, rests: Sequence[Any], numbers: ProblemNumbers, sigma: Any) -> list[Any]:
        """Slope of the law's score, by batch; to be broadcast to ``(B, C, T)``."""

    @abstractmethod
    def below(self, error: Any) -> Any:
        """The probability of a lower error, at a level of one; traceable."""

    @abstractmethod
    def draws(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        """Errors at a level of one."""


def _pooled(rests: Sequence[Any], numbers: ProblemNumbers) -> tuple[Any, Any]:
    squares = sum(jnp.sum(r**2, axis=(0, 2)) for r in rests)
    return squares, jnp.sqrt(squares / numbers.counts + numbers.floor)


@dataclass(frozen=True)
class Gaussian(Law):
    """The normal law: an error counts by its square."""

    word: ClassVar[str] = "gaussian"
    forgiving: ClassVar[bool] = False
    closed: ClassVar[bool] = True
    excess: ClassVar[float] = 1.0

    def cost(self, rests: Sequence[Any], numbers: ProblemNumbers, known: Sequence[bool]) -> Any:
        """A level that is not known is the root mean square of the residuals."""
        squares, pooled = _pooled(rests, numbers)
        given = jnp.asarray(known)
        sigma = jnp.where(given, numbers.noise, pooled)
        cost = jnp.where(given, 0.5 * squares / sigma**2, numbers.counts * jnp.log(pooled))
        return jnp.sum(cost), sigma

    def weights(self, rest: Any, sigma: Any) -> Any:
        """All are one."""
        return jnp.ones_like(rest)

    def bend(self, rests: Sequence[Any], numbers: ProblemNumbers, sigma: Any) -> list[Any]:
        """One, for the score is the error itself."""
        return [jnp.ones((1, 1, 1)) for _ in rests]

    def below(self, error: Any) -> Any:
        """Of the normal law."""
        return jax.scipy.stats.norm.cdf(error)

    def draws(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        """Normal numbers."""
        return rng.standard_normal(shape)


@dataclass(frozen=True)
class StudentT(Law):
    """Student's law of `TAIL` degrees of freedom, which forgives outliers.

    Of n degrees of freedom the weighted information is (n + 3) / (n + 1) times the Fisher
    information (Lange, Little & Taylor 1989).
    """

    word: ClassVar[str] = "student_t"
    forgiving: ClassVar[bool] = True
    closed: ClassVar[bool] = False
    excess: ClassVar[float] = (TAIL + 3) / (TAIL + 1)

    def cost(self, rests: Sequence[Any], numbers: ProblemNumbers, known: Sequence[bool]) -> Any:
        """A level that is not known is the fixed point of the law's reweighting."""
        counts, given = numbers.counts, jnp.asarray(known)
        sigma = jnp.where(given, numbers.noise, _pooled(rests, numbers)[1])

        def again(_: int, s: Any) -> Any:
            weighted = sum(jnp.sum(r**2 * self.weights(r, s), axis=(0, 2)) for r in rests)
            return jnp.where(given, s, jnp.sqrt(weighted / counts + numbers.floor))

        sigma = jax.lax.fori_loop(0, 60, again, sigma)
        level = sigma[None, :, None]
        scaled = sum(jnp.sum(jnp.log1p(r**2 / (TAIL * level**2)), axis=(0, 2)) for r in rests)
        return jnp.sum(0.5 * (TAIL + 1) * scaled + counts * jnp.log(sigma)), sigma

    def weights(self, rest: Any, sigma: Any) -> Any:
        """The less, the further an error is out."""
        return (TAIL + 1) / (TAIL + rest**2 / sigma[None, :, None] ** 2)

    def bend(self, rests: Sequence[Any], numbers: ProblemNumbers, sigma: Any) -> list[Any]:
        """The mean over the samples of each channel, measured on the residuals."""
        total = jnp.zeros_like(sigma)
        for rest, batch in zip(rests, numbers.batches, strict=True):
            square = (rest / sigma[None, :, None]) ** 2
            slope = (TAIL + 1) * (TAIL - square) / (TAIL + square) ** 2
            total += jnp.where(jnp.isnan(batch.measured), 0.0, slope).sum(axis=(0, 2))
        # of the law itself it is 5 / 7; a law with heavier shoulders may lower it, not to nothing
        return [jnp.maximum(total / numbers.counts, 0.1)[None, :, None] for _ in rests]

    def below(self, error: Any) -> Any:
        """The closed form for four degrees of freedom."""
        u = 1.0 + error**2 / TAIL
        return 0.5 + 0.375 * error / jnp.sqrt(u) * (1.0 - error**2 / (12.0 * u))

    def draws(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        """Numbers of the law."""
        return rng.standard_t(TAIL, shape)
