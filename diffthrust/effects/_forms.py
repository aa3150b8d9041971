"""What effects of several places share: forms with their equation, and kinds of parameters.

A form becomes an effect of a place by a subclass with a name, a port, and its parameters.
"""

import math
from typing import Any

import jax.numpy as jnp

from diffthrust.effects._recorded import delayed, rate_limited
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.parameter import Relative, parameter
from diffthrust.models._base.signals import Signal, Signals

Probes = Relative | tuple[float, ...]


def from_zero(value: float, unit: str, *, size: float, probes: Probes) -> Any:
    """A parameter that is not negative, and at zero leaves everything as it is."""
    return parameter(value, unit, bounds=(0, None), null=0.0, size=size, probes=probes)


def ceiling(value: float, unit: str, *, probes: Probes) -> Any:
    """A parameter that is not negative, and where infinite leaves everything as it is."""
    return parameter(value, unit, bounds=(0, None), null=math.inf, transform="log", probes=probes)


class Offset(Effect, abstract=True):
    """A zero that is off: value + offset."""

    offset: float

    def __call__(self, value: Signal, s: Signals) -> Signal:
        return value + self.offset


class Scale(Effect, abstract=True):
    """A factor that is off: (1 + change) * value."""

    change: float = parameter(0.05, bounds=(-1, None), null=0.0, size=0.2, probes=(-0.1, 0.1))

    def __call__(self, value: Signal, s: Signals) -> Signal:
        return value * (1.0 + self.change)


class Delay(Effect, abstract=True):
    """A series that comes later: value(time - delay), linear between samples."""

    memory = True
    delay: float

    def __call__(self, value: Signal, s: Signals) -> Signal:
        return delayed(s.time, value, self.delay)


class RateLimit(Effect, abstract=True):
    """A series that is followed by at most ``rate``, from sample to sample."""

    memory = True
    rate: float

    def __call__(self, value: Signal, s: Signals) -> Signal:
        return rate_limited(s.time, value, self.rate)


class ReverseAsymmetry(Effect, abstract=True):
    """What passes is 1 + change times as large where it is negative."""

    change: float = parameter(-0.1, bounds=(-1, None), null=0.0, size=0.3, probes=(-0.3, 0.3))

    def __call__(self, value: Signal, s: Signals) -> Signal:
        return value * (1.0 + jnp.where(value < 0, self.change, 0.0))


class ReverseSpeedAsymmetry(ReverseAsymmetry, abstract=True):
    """What passes is 1 + change times as large where the speed is negative."""

    def __call__(self, value: Signal, s: Signals) -> Signal:
        return value * (1.0 + jnp.where(s.speed < 0, self.change, 0.0))
