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
    """Where simulations set a state to its measured value."""

    series: Float[AnyArray, "logs time"]  # as measured, NaN where it was not
    value: Float[AnyArray, "logs time"]  # those that the state is set to; NaN where it runs on
    unsigned: Bool[AnyArray, " logs"]  # the sensor reports the absolute value


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Batch:
    """Logs of the same inputs and of similar length, padded to one length.

    In compiled code also one log of a batch, without the first dimension. ``start`` are the initial
    values of the states that are estimated, then how far the parameters that differ by log are from
    their means, in coordinates; ``held`` those of the other states.
    """

    time: Float[AnyArray, "logs time"]  # [s]; a padded step has no length
    inputs: Mapping[str, Float[AnyArray, "logs time"]]
    measured: Float[AnyArray, "logs channels time"]  # NaN where nothing was
    start: Float[AnyArray, "logs local"]
    held: Mapping[str, Float[AnyArray, " logs"]]
    unsigned: Bool[AnyArray, "logs channels"]  # the sensor reports the absolute value
    restarts: Mapping[str, Restart]  # by state
    links: PyTree[AnyArray] = None  # what the noise model needs to know of each sample
    # 1 where a sample says "at least", -1 where it says "at most", 0 elsewhere; of laws that censor
    beyond: Int[AnyArray, "logs channels time"] | None = None


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Varying:
    """A parameter that differs from log to log, as coordinates have it."""

    scale: Float[AnyArray, ""]  # of a coordinate of one, in the parameter's unit; 1 for a logarithm
    width: Float[AnyArray, ""]  # standard deviation of the values about their mean, in coordinates
    low: Float[AnyArray, ""]  # bounds of a value
    high: Float[AnyArray, ""]


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class ProblemNumbers:
    """The numeric part of a problem."""

    batches: Sequence[Batch]
    values: Mapping[str, Float[AnyArray, ""]]  # of all parameters, those of the noise included
    scales: Float[AnyArray, " free"]
    noise: Float[AnyArray, " channels"]  # known levels; 1 where a level is estimated
    floor: Float[AnyArray, " channels"]  # added to estimated variances: their logarithm is finite
    counts: Float[AnyArray, " channels"]  # of the measured values
    prior: Mapping[str, tuple[Float[AnyArray, ""], Float[AnyArray, ""]]]  # mean, deviation
    clip: Float[AnyArray, " channels"]  # size of a large one-step error,
    reach: Float[AnyArray, ""]  # and at how many times that errors are limited
    varying: Mapping[str, Varying] = field(default_factory=dict)  # what differs by log, in order
    chosen: Int[AnyArray, " width"] | None = None  # moved coordinates, where there is a width
    gaps: PyTree[AnyArray] = None  # what the noise model needs to know of all samples together
    substeps: Float[AnyArray, ""] | None = None  # per sample, where the grids leave them to numbers

    def split(self, z: AnyArray, shared: int) -> tuple[AnyArray, list[AnyArray]]:
        """The first coordinates, so many, and by batch those of each log, ``(logs, local)``."""
        at, starts = shared, []
        for batch in self.batches:
            count, states = batch.start.shape
            starts.append(z[at : at + count * states].reshape(count, states))
            at += count * states
        return z[:shared], starts
