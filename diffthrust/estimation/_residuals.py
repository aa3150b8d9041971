"""What a fit sums: errors of a simulation over whole runs or segments, or of one-step predictions.

A likelihood of either kind has a law of errors and a noise, each an object of its own; all are
static and hashable, and fix the compiled code of a problem.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Float

from diffthrust.estimation._laws import Gaussian, Law
from diffthrust.estimation._noise import WHITE, NoiseModel, White, Whiteness
from diffthrust.estimation._numbers import Batch, ProblemNumbers
from diffthrust.estimation._observer import Limits, Observer, guesses, innovations, observer_for
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Parameter
from diffthrust.simulation._errors import wrapped
from diffthrust.simulation._record import Record
from diffthrust.simulation._starts import felt
from diffthrust.simulation._trajectory import Grid, trajectory


@dataclass(frozen=True)
class Likelihood(ABC):
    """What the residuals of a fit are, what noise they are taken for, and of which law."""

    noise: NoiseModel = field(default_factory=White)
    law: Law = field(default_factory=Gaussian)

    word: ClassVar[str]
    """Its name among the likelihoods of `fit`."""
    corrects: ClassVar[bool]
    """The states are corrected at every sample: there are no segments, and a noise level that a log
    gives is the sensor's, not that of the residuals."""

    @classmethod
    def of(cls, model: Model, records: Sequence[Record], noise: NoiseModel, law: Law) -> Likelihood:
        """For a model and what its records measure.

        Raises:
            InputError: logs that it cannot be made for.
        """
        return cls(noise, law)

    @abstractmethod
    def starts(self, model: Model, records: Sequence[Record]) -> tuple[str, ...]:
        """The states whose initial values may be estimated."""

    def parameters(
        self, channels: Sequence[str], records: Sequence[Record]
    ) -> dict[str, Parameter]:
        """What is estimated with the model's parameters, by name."""
        return self.noise.parameters(channels)

    def guesses(self, names: Collection[str]) -> tuple[Mapping[str, float], ...]:
        """Values of them from which to start, in turn; those not named are drawn."""
        return self.noise.guesses(names)

    @abstractmethod
    def residuals(
        self,
        channels: Sequence[str],
        model: Model,
        grid: Grid,
        values: Mapping[str, Any],
        numbers: ProblemNumbers,
        log: Batch,
        states: Mapping[str, Any],
    ) -> Float[jax.Array, "channels time"]:
        """What is summed of one log; zero where nothing was measured; traceable.

        Of the ``channels`` that any log measures, from initial ``states``; ``values`` are those of
        all parameters, by name.
        """

    def whiteness(self, tables: bool) -> Whiteness:
        """What a fit says where its errors are not what they are taken for."""
        return self.noise.whiteness(tables)


@dataclass(frozen=True)
class SimulationError(Likelihood):
    """Measured minus simulated, over whole runs or segments; of a noise that lasts, what is new."""

    word: ClassVar[str] = "simulation"
    corrects: ClassVar[bool] = False

    def starts(self, model: Model, records: Sequence[Record]) -> tuple[str, ...]:
        """All that no log prescribes, and that a measured output feels."""
        free = felt(model, records)
        return tuple(n for n in free if not any(n in record.inputs for record in records))

    def residuals(
        self,
        channels: Sequence[str],
        model: Model,
        grid: Grid,
        values: Mapping[str, Any],
        numbers: ProblemNumbers,
        log: Batch,
        states: Mapping[str, Any],
    ) -> Float[jax.Array, "channels time"]:
        anew = {name: (restart.value, restart.unsigned) for name, restart in log.restarts.items()}
        outputs, _ = trajectory(model, grid, log.time, log.inputs, states, anew)
        rests = []
        for i, name in enumerate(channels):
            modelled, measured = outputs[name], log.measured[i]
            modelled = jnp.where(log.unsigned[i], jnp.abs(modelled), modelled)
            residual = jnp.where(jnp.isnan(measured), 0.0, measured) - modelled
            residual = wrapped(residual) if name in model.angles else residual
            # Zero, not NaN: sums run over gaps and padding, and lasting noise reads sample 0 with a
            # weight of zero where a sample has no earlier one, and zero times NaN is NaN.
            rests.append(jnp.where(jnp.isnan(measured), 0.0, residual))
        return jnp.stack(self.noise.new(channels, rests, log, numbers, values))


@dataclass(frozen=True)
class Innovations(Likelihood):
    """Errors of predicting each sample from all earlier ones; see `_observer`.

    Errors that last are the observer's own, so that what is left is taken as white.
    """

    observer: Observer = field(kw_only=True)

    word: ClassVar[str] = "innovations"
    corrects: ClassVar[bool] = True

    @classmethod
    def of(
        cls, model: Model, records: Sequence[Record], noise: NoiseModel, law: Law
    ) -> Innovations:
        return cls(noise, law, observer=observer_for(model, records))

    def starts(self, model: Model, records: Sequence[Record]) -> tuple[str, ...]:
        """Those that are measured: the others come from the corrections.

        And those of effects that no correction reaches, unless the records say where they begin.
        """
        unknown = (n for n in felt(model, records) if n in model.free_starts)
        free = tuple(n for n in unknown if any(n not in record.start for record in records))
        fed = (n for n in self.observer.fed if n in model.states)
        return (*fed, *self.observer.follow, *free)

    def parameters(
        self, channels: Sequence[str], records: Sequence[Record]
    ) -> dict[str, Parameter]:
        longest = max(record.duration for record in records)
        step = min(record.step for record in records)
        return self.observer.parameters(longest, step)

    def guesses(self, names: Collection[str]) -> tuple[Mapping[str, float], ...]:
        """Gains; memories are drawn."""
        return guesses(names)

    def residuals(
        self,
        channels: Sequence[str],
        model: Model,
        grid: Grid,
        values: Mapping[str, Any],
        numbers: ProblemNumbers,
        log: Batch,
        states: Mapping[str, Any],
    ) -> Float[jax.Array, "channels time"]:
        limits = Limits(numbers.clip, numbers.reach)
        return innovations(self.observer, model, grid, values, log, states, limits)[0]

    def whiteness(self, tables: bool) -> Whiteness:
        """Nothing in them has a reason to be correlated."""
        return Whiteness(
            WHITE,
            "One-step errors are correlated from sample to sample ({}): something is missing from "
            "the model. The standard errors assume that nothing is and are too small.",
        )
