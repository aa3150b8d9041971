"""What controllers and compensators have in common, and checks that all loops share."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, ClassVar, Self

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from diffthrust._support.errors import InputError
from diffthrust._support.validation import check_known, finite, whole_number
from diffthrust.models._base.component import Component, changed
from diffthrust.models._base.parameter import Parameter
from diffthrust.models._base.signals import Signals

Kept = Mapping[str, Array]
"""What a block remembers from sample to sample, by the names in its ``states``."""


class Block(Component):
    """Something that is worked out at every sample of the controller.

    A subclass names the measured channels that it ``reads``, what it remembers from one sample to
    the next in ``states`` (name to unit), and declares its gains with `parameter`. It is evaluated
    with traced numbers: functions of ``jax.numpy`` only, ``jnp.where`` rather than ``if``.

    Example:
        >>> block = dft.control.PD(frequency=1.0)
        >>> block.start(), block.parameters["frequency"].value
        ({}, 1.0)
        >>> block.replace(frequency=2.0).frequency
        2.0
    """

    reads: ClassVar[tuple[str, ...]] = ()
    states: ClassVar[Mapping[str, str]] = {}

    def start(self) -> Mapping[str, float]:
        """What is remembered at the first sample; zero by default."""
        return {}

    @property
    def parameters(self) -> dict[str, Parameter]:
        """The gains by name."""
        return {name: self._present(name) for name in self._parameters}

    def replace(self, **more: Any) -> Self:
        """The block with some gains changed: by a value, a `Parameter`, or some fields.

        Raises:
            InputError: a name that the block does not have, or a value outside its bounds.
        """
        named = self.parameters
        for name, new in more.items():
            check_known(name, named, f"{type(self).__name__} has no gain")
            named[name] = changed(named[name], new, name)
            named[name].check(name)
        return self._with_parameters(named)

    def __repr__(self) -> str:
        listed = ", ".join(f"{k}={getattr(self, k):.4g}" for k in self._parameters)
        return f"{type(self).__name__}({listed})"


class Controller(Block):
    """From the reference and the measurements to the thrust that is wanted, or to a command.

    ``gives`` says which: ``"thrust"`` [N], which a `Compensator` turns into the command, or
    ``"command"`` [V], which goes to the thruster as it is. ``of`` is the channel that the
    reference is for.

    Example:
        >>> issubclass(dft.control.PD, dft.control.Controller)
        True
    """

    of: str = "position"
    gives: str = "thrust"

    def __call__(self, s: Signals, kept: Kept, period: Array) -> tuple[Array, Kept]:
        """What is wanted at this sample, and what is to be remembered.

        Args:
            s: the measured channels by name, the reference ``wanted`` with its derivatives
                ``wanted_rate`` and ``wanted_acceleration``, and ``time`` [s].
            kept: what was remembered at the last sample.
            period: time between two samples [s].
        """
        raise InputError(
            f"Controller '{type(self).__name__}' has no __call__.",
            "Define def __call__(self, s, kept, period): return thrust, {}.",
        )


def rate_of(
    value: Array, last: Array, begun: Array, smoothing: Array | float, period: Array
) -> tuple[Array, Array]:
    """The rate of a sampled signal through a first-order low-pass, by backward differences.

    Args:
        value: the present sample.
        last: the low-passed signal at the last sample.
        begun: 0 at the first sample, where the rate is unknown and taken as zero; 1 after it.
        smoothing: time constant of the low-pass [s]; at zero the difference of two samples.
        period: time between two samples [s].

    Returns:
        The rate, and the low-passed signal to remember.

    Example:
        >>> rate, smoothed = dft.control.rate_of(
        ...     jnp.array(1.0), jnp.array(0.0), jnp.array(1.0), jnp.array(0.1), jnp.array(0.02)
        ... )
        >>> rate.shape
        ()
    """
    ahead = (value - last) / (smoothing + period)
    # without it the first difference is that from zero: a step of the whole measurement
    rate = begun * ahead
    return rate, jnp.where(begun > 0, last + period * ahead, value)


def check_noise(who: str, noise: Any, channels: Collection[str]) -> None:
    """Raise `InputError` for standard deviations that cannot be meant."""
    example = f'{{"{next(iter(channels))}": 0.3}}'
    for name, level in mapping(f"{who}, noise", noise, example, channels).items():
        finite(f"{who}, noise of '{name}'", level, lambda x: x >= 0, "zero or more")


def mapping(
    what: str,
    values: Any,
    example: str,
    names: Collection[str] | None = None,
    kind: str = "channel",
) -> Mapping[str, Any]:
    """What was given by the names of channels, or of another kind."""
    if not isinstance(values, Mapping):
        raise InputError(
            f"{what}: expected a dictionary by the names of {kind}s, found {values!r}.",
            f"Write {example}.",
        )
    for name in values:
        if names is not None:
            check_known(name, names, f"{what}: there is no {kind}", present="there are")
    return values


def seeded(seed: Any) -> np.random.Generator:
    """The generator of the measurement noise."""
    return np.random.default_rng(whole_number("seed", seed, 0, mend="Write seed=0."))
