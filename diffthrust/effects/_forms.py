"""What effects of several places share: forms, kinds of parameters, and what memory does to series.

A form becomes an effect of a place by a subclass with a name, a port, and its parameters. Series
have any increasing time stamps; one that repeats (a log padded at its end) changes nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import Any

import jax
import jax.numpy as jnp
from jax.core import Tracer

from diffthrust.models._base.effect import Effect
from diffthrust.models._base.parameter import Relative, parameter
from diffthrust.models._base.signals import Signal, Signals

_marked: ContextVar[bool] = ContextVar("marked", default=False)


@contextmanager
def marked() -> Iterator[None]:
    """Within it, what is traced calls these functions by their names, as an export needs it."""
    token = _marked.set(True)
    try:
        yield
    finally:
        _marked.reset(token)


def _recognisable(function: Callable[..., Signal]) -> Callable[..., Signal]:
    named = jax.jit(function)

    @wraps(function)
    def called(*given: Signal | float) -> Signal:
        # where nothing traces it, a scan would be compiled again at each call
        traced = any(isinstance(argument, Tracer) for argument in given)
        return (function if traced and not _marked.get() else named)(*given)

    return called


@_recognisable
def delayed(time: Signal, series: Signal, delay: Signal | float) -> Signal:
    """A series ``delay`` seconds later, ``(T,)``: linear between samples, the first value before.

    The derivative at zero delay is the one towards positive delays. Of a series that is held from
    sample to sample, on a uniform grid, this is the mean of the delayed staircase over each
    interval: what the staircase does to a system that is slower than the step.
    """
    at = time - delay
    after = jnp.clip(jnp.searchsorted(time, at), 1, max(time.shape[0] - 1, 0))
    gap = time[after] - time[after - 1]
    # a repeated stamp has a gap of zero: the divisor is replaced before, since a NaN in the branch
    # that is not taken still reaches the derivative
    back = (time[after] - at) / jnp.where(gap > 0, gap, 1.0)
    between = series[after] - back * (series[after] - series[after - 1])
    return jnp.where(at > time[0], between, series[0])


@_recognisable
def rate_limited(time: Signal, series: Signal, rate: Signal | float) -> Signal:
    """A series followed at no more than ``rate`` per second, ``(T,)``; all of it where infinite."""
    gap = jnp.diff(time)
    most = jnp.where(gap > 0, rate * jnp.where(gap > 0, gap, 1.0), 0.0)

    def follow(last: Signal, x: tuple[Signal, Signal]) -> tuple[Signal, Signal]:
        wanted, reach = x
        reached = jnp.clip(wanted, last - reach, last + reach)
        return reached, reached

    _, after = jax.lax.scan(follow, series[0], (series[1:], most))
    return jnp.concatenate([series[:1], after])


@_recognisable
def lagged(time: Signal, series: Signal, time_constant: Signal | float) -> Signal:
    """The first-order lag of a series that is linear between samples, ``(T,)``, settled at first.

    Exact for any ratio of step and time constant; at zero exactly the series, its derivative there
    being the slope that ends at each sample.
    """
    gap = jnp.diff(time)
    gap = jnp.where(gap > 0, gap, 1.0)
    ratio = gap / (time_constant + 1e-9)
    kept = jnp.where(jnp.diff(time) > 0, jnp.exp(-ratio), 1.0)
    # the exact response to a ramp over one gap
    mean = time_constant / gap * -jnp.expm1(-ratio)
    pushed = (mean - kept) * series[:-1] + (1.0 - mean) * series[1:]

    def follow(last: Signal, x: tuple[Signal, Signal]) -> tuple[Signal, Signal]:
        share, push = x
        value = share * last + push
        return value, value

    _, after = jax.lax.scan(follow, series[0], (kept, pushed))
    return jnp.concatenate([series[:1], after])


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
