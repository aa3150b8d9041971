"""The numbers of an estimation problem: what its compiled code is given beside the coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import jax
import numpy as np
from jaxtyping import Bool, Float, Int, PyTree

AnyArray = np.ndarray | jax.Array
"""Of NumPy where it is made, as many arrays of JAX would cost time; of JAX in compiled code."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Restart:
    """Where simulations set a state to its measured value.

    Args:
        series: the measured values, NaN where there are none.
        value: those that the state is set to; NaN where it runs on.
        unsigned: the sensor reports the absolute value.
    """

    series: Float[AnyArray, "logs time"]
    value: Float[AnyArray, "logs time"]
    unsigned: Bool[AnyArray, " logs"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Batch:
    """Logs of the same inputs and of similar length, padded to one length.

    In compiled code also one log of a batch, without the first dimension.

    Args:
        time: time stamps [s]; a padded step has no length.
        inputs: series by name.
        measured: NaN where nothing was measured.
        start: initial values of the states that are estimated, then how far the parameters that
            differ by log are from their means, in coordinates.
        held: initial values of the others, by name.
        unsigned: the sensor of a channel reports the absolute value.
        restarts: by state.
        links: what the noise model needs to know of each sample.
        beyond: 1 where a sample says "at least", -1 where it says "at most", 0 elsewhere; of laws
            that censor.
    """

    time: Float[AnyArray, "logs time"]
    inputs: Mapping[str, Float[AnyArray, "logs time"]]
    measured: Float[AnyArray, "logs channels time"]
    start: Float[AnyArray, "logs local"]
    held: Mapping[str, Float[AnyArray, " logs"]]
    unsigned: Bool[AnyArray, "logs channels"]
    restarts: Mapping[str, Restart]
    links: PyTree[AnyArray] = None
    beyond: Int[AnyArray, "logs channels time"] | None = None


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Varying:
    """A parameter that differs from log to log, as coordinates have it.

    Args:
        scale: of a coordinate of one, in the parameter's unit; 1 for a logarithm.
        width: standard deviation of the values about their mean, in coordinates.
        low: lower bound of a value.
        high: its upper bound.
    """

    scale: Float[AnyArray, ""]
    width: Float[AnyArray, ""]
    low: Float[AnyArray, ""]
    high: Float[AnyArray, ""]


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class ProblemNumbers:
    """The numeric part of a problem.

    Args:
        batches: the logs.
        values: of all parameters, those of the noise included, by name.
        scales: of the free parameters.
        noise: known noise levels; 1 where a level is estimated.
        floor: what is added to an estimated variance, so that its logarithm stays finite.
        counts: of the measured values.
        prior: mean and standard deviation, by name of the parameter.
        clip: size of a large one-step error.
        reach: errors are limited at so many times that.
        varying: the parameters that differ by log, in their order.
        chosen: places of the coordinates that are moved, where the layout has a width.
        gaps: what the noise model needs to know of all samples together.
        substeps: integrator steps per sample, where the grids leave them to the numbers.
    """

    batches: Sequence[Batch]
    values: Mapping[str, Float[AnyArray, ""]]
    scales: Float[AnyArray, " free"]
    noise: Float[AnyArray, " channels"]
    floor: Float[AnyArray, " channels"]
    counts: Float[AnyArray, " channels"]
    prior: Mapping[str, tuple[Float[AnyArray, ""], Float[AnyArray, ""]]]
    clip: Float[AnyArray, " channels"]
    reach: Float[AnyArray, ""]
    varying: Mapping[str, Varying] = field(default_factory=dict)
    chosen: Int[AnyArray, " width"] | None = None
    gaps: PyTree[AnyArray] = None
    substeps: Float[AnyArray, ""] | None = None

    def split(self, z: AnyArray, shared: int) -> tuple[AnyArray, list[AnyArray]]:
        """The first coordinates, so many, and by batch those of each log, ``(logs, local)``."""
        at, starts = shared, []
        for batch in self.batches:
            count, states = batch.start.shape
            starts.append(z[at : at + count * states].reshape(count, states))
            at += count * states
        return z[:shared], starts
