"""What noise a simulation's residuals are taken for: white, or of a kind that lasts.

A noise model is one class: its parameters, what it makes of the residuals, and what a fit says
where they are not of its kind. `_registry` lists them by the words of `fit`; `_ar1` has one that
lasts.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from diffthrust.estimation._laws import Law
from diffthrust.estimation._numbers import Batch, ProblemNumbers
from diffthrust.models._base.parameter import Parameter

WHITE = 0.1
"""Errors with no reason to be correlated at all are reported beyond this lag-one correlation."""
_CORRELATED = 0.5
"""The same for residuals of a simulation, which always are a little."""


class Whiteness(NamedTuple):
    """Where errors are correlated that a likelihood takes as white.

    Args:
        limit: the lag-one correlation beyond which it is said.
        sentence: with ``{}`` for the channels.
        whole_runs: it is the residuals of whole runs that are looked at, rather than what the
            likelihood sums.
    """

    limit: float
    sentence: str
    whole_runs: bool = False


class Likeliest(NamedTuple):
    """How likely a noise makes residuals, at its best parameters.

    Args:
        cost: negative log-likelihood, with all constants.
        lag_one: correlation from one step to the next.
    """

    cost: float
    lag_one: float = 0.0


class NoiseModel(ABC):
    """A model of measurement noise; fixes the compiled code of a problem."""

    word: ClassVar[str]
    """Its name among the noise models of `fit`."""
    lasts: ClassVar[bool] = True
    """From sample to sample: what a likelihood sums is what is new in each, and a noise level that
    a log gives is not its level."""

    def parameters(self, channels: Sequence[str]) -> dict[str, Parameter]:
        """Its parameters, by name, which are estimated with those of the model."""
        return {}

    def guesses(self, names: Collection[str]) -> tuple[Mapping[str, float], ...]:
        """Values of them from which to start, in turn; those not named stay as they are."""
        return ({},)

    def arranged(self, numbers: ProblemNumbers, step: float) -> ProblemNumbers:
        """The numbers with what it needs to know of the samples.

        Args:
            numbers: of a problem; where its restarts are is known.
            step: shortest step of the logs [s].
        """
        return numbers

    def new(
        self,
        channels: Sequence[str],
        rests: Sequence[Any],
        log: Batch,
        numbers: ProblemNumbers,
        values: Mapping[str, Any],
    ) -> Sequence[Any]:
        """What is new in each residual of one log, ``(T,)`` by channel; traceable."""
        return rests

    def levels(
        self, channels: Sequence[str], numbers: ProblemNumbers, values: Mapping[str, Any]
    ) -> Any:
        """The level of what is new over that of the noise, ``(C,)``."""
        return np.ones(len(channels))

    def likeliest(
        self, runs: Sequence[np.ndarray], times: Sequence[np.ndarray], law: Law, step: float
    ) -> Likeliest | None:
        """How likely it makes the residuals of one channel, without a fit.

        Args:
            runs: residuals of each run, ``(n,)``; NaN where nothing was measured.
            times: of the samples [s].
            law: of what is new in each residual.
            step: in which correlations are counted [s].

        Returns:
            ``None`` where it does not say: the advice on noise leaves it out.
        """
        return None

    def independent(
        self, channels: Sequence[str], numbers: ProblemNumbers, values: Mapping[str, float]
    ) -> float:
        """How many independent samples tell as much about a mean."""
        return float(np.sum(numbers.counts))

    @abstractmethod
    def whiteness(self, tables: bool) -> Whiteness:
        """What is said where the residuals are not of this kind.

        Args:
            tables: the logs are tables of readings, without a time of their own.
        """


@dataclass(frozen=True)
class White(NoiseModel):
    """Noise that knows nothing of the sample before."""

    word: ClassVar[str] = "white"
    lasts: ClassVar[bool] = False

    def likeliest(
        self, runs: Sequence[np.ndarray], times: Sequence[np.ndarray], law: Law, step: float
    ) -> Likeliest:
        """By the law alone."""
        return Likeliest(law.level_cost(np.concatenate([run[np.isfinite(run)] for run in runs])))

    def whiteness(self, tables: bool) -> Whiteness:
        """Residuals of a simulation are seldom white: a little correlation is no news."""
        return Whiteness(
            _CORRELATED,
            "Residuals are correlated from sample to sample ({}): something is missing from the "
            "model, or the noise is coloured. The standard errors assume white noise and are too "
            "small" + ("." if tables else "; see Comparison.noise_advice."),
            whole_runs=True,
        )
