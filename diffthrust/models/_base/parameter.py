"""Parameters: a value with its unit, bounds, prior, and the way the optimiser sees it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any, Literal, TypeGuard, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.report import Rows
from diffthrust._support.words import number

_Numbers = TypeVar("_Numbers", float, np.ndarray, jax.Array)  # one number or many


@dataclass(frozen=True)
class Normal:
    """A Gaussian prior on a parameter, in the parameter's own unit.

    Example:
        >>> model = dft.Thruster().replace(ct={"prior": dft.models.Normal(mean=0.02, std=0.002)})
        >>> model.parameters["ct"].prior
        Normal(mean=0.02, std=0.002)
    """

    mean: float
    std: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.mean) and self.std > 0 and math.isfinite(self.std)):
            raise InputError(
                f"A Normal prior needs a finite mean and a positive std, found {self}.",
                "Give std > 0, in the parameter's unit.",
            )


@dataclass(frozen=True)
class Relative:
    """Trial values as multiples of a signal's level in the logs; made by `relative_to`."""

    signal: str
    factors: tuple[float, ...]
    power: float = 1.0


def relative_to(signal: str, *factors: float, power: float = 1.0) -> Relative:
    """Trial values of an effect's parameter that follow the size of a signal in the logs.

    A diagnosis tries the parameter at each factor times ``level ** power``, where the level is the
    90th percentile of the signal's absolute value over the logs.

    Args:
        signal: an input, state or output of the model, the value at one of its ports, or
            "duration" (the length of the longest log [s]).
        *factors: multiples of the level; give both signs where both are possible.
        power: exponent of the level; -1 for a parameter that multiplies the signal.

    Example:
        >>> probes = dft.models.relative_to("drive", 0.02, 0.1)
        >>> probes.signal, probes.factors
        ('drive', (0.02, 0.1))
    """
    return Relative(signal, factors, power)


@dataclass(frozen=True)
class Parameter:
    """One number of a model or an effect, and all that the library needs to know of it.

    Args:
        value: the present value; where a fit starts.
        unit: the unit of the value, in the notation of pint; "" for a pure number. It may follow
            a channel of the model: ``"{command}"`` has the unit of the command, whatever that is,
            and ``"rad/({command} s^2)"`` is per that unit.
        bounds: lower and upper limit, ``None`` where there is none; both ends belong to the range.
        fixed: a fixed parameter is not estimated.
        prior: a `Normal`, or ``None``; where given, the fit counts it as one more measurement.
        transform: "log" for quantities that are positive by nature and uncertain by factors
            (the optimiser moves their logarithm), "linear" for all others.
        size: a typical magnitude, used to draw starts of a "linear" parameter without bounds.
        null: the value at which an effect does nothing; ``None`` for a model's parameter.
        probes: trial values of an effect's parameter, numbers or `relative_to` a signal, from
            which a diagnosis starts.
        doc: one line for people.
        pattern: the unit as declared, where it follows a channel; set by the model.
        per_log: it differs from log to log (a current, a tare, a battery): a fit estimates a value
            for each log, of which ``value`` is the mean.
        width: the standard deviation of these values about their mean, which a fit estimates; in
            the unit of the value, and of a "log" parameter that of the logarithm. Before any fit
            ``None``.

    Raises:
        InputError: by `check`, when a model is made of it: a value outside its bounds, bounds in
            the wrong order, a "log" parameter that is not positive, a field of the wrong kind.

    Example:
        >>> alpha = dft.Parameter(0.037, unit="1/rad", bounds=(0, None), transform="log")
        >>> alpha.limits, alpha.range_text()
        ((0.0, inf), '[0, inf) 1/rad')
        >>> half_width = dft.Parameter(2.0, unit="{command}", bounds=(0, 8), size=4.0)
        >>> in_volts = half_width.in_units({"command": "V"})
        >>> in_volts.unit, in_volts.channel, in_volts.limited(9.0), in_volts.with_value(3).value
        ('V', 'command', 8.0, 3.0)
        >>> in_volts.scale, in_volts.to_coordinate(2.0), in_volts.from_coordinate(0.5)
        (4.0, 0.5, 2.0)
        >>> in_volts.coordinate_limits(), in_volts.check("half_width")
        ((0.0, 2.0), None)
    """

    value: float
    unit: str = ""
    bounds: tuple[float | None, float | None] = (None, None)
    fixed: bool = False
    prior: Normal | None = None
    transform: Literal["linear", "log"] = "linear"
    size: float | None = None
    null: float | None = None
    doc: str = ""
    probes: Relative | tuple[float, ...] = ()
    pattern: str = ""
    per_log: bool = False
    width: float | None = None

    def in_units(self, units: Mapping[str, str]) -> Parameter:
        """The same parameter with its unit written out, from those of the channels it follows."""
        pattern = self.pattern or self.unit
        if "{" not in pattern:
            return self
        return replace(self, unit=_spelt(pattern, units), pattern=pattern)

    @property
    def channel(self) -> str:
        """The channel in whose unit, or whose unit per something, it is; empty if none."""
        above = self.pattern.partition("/")[0]
        return above[1:-1] if above.startswith("{") else ""

    def check(self, name: str) -> None:
        """Raise `InputError` where the description contradicts itself."""
        ends = self.bounds if isinstance(self.bounds, tuple | list) else ()
        is_prior = isinstance(self.prior, Normal) or self.prior is None
        size, width = (
            v is None or (_number(v) and 0 < v < math.inf) for v in (self.size, self.width)
        )
        for field, right, expected in (
            ("value", _number(self.value), f"a number in {self.unit or 'no unit'}"),
            ("bounds", len(ends) == 2 and all(b is None or _number(b) for b in ends),
             "a pair of numbers, None where there is no bound"),
            ("fixed", isinstance(self.fixed, bool), "true or false"),
            ("prior", is_prior, "a dft.models.Normal or None"),
            ("transform", self.transform in ("linear", "log"), "'linear' or 'log'"),
            ("size", size, "a positive finite number or None"),
            ("per_log", isinstance(self.per_log, bool), "true or false"),
            ("width", width, "a positive finite number or None"),
        ):  # fmt: skip
            if not right:
                raise InputError(
                    f"Parameter '{name}', {field}: expected {expected}, "
                    f"found {getattr(self, field)!r}.",
                    f"Correct the {field}.",
                )
        low, high = self.limits
        if not low < high:
            raise InputError(
                f"Parameter '{name}': the lower bound {low:g} is not below the upper one {high:g}.",
                "Swap the bounds; to hold a parameter at a value, give fixed = true.",
            )
        # an infinite limit is how a saturation does nothing: allowed as a null only
        infinite = not math.isfinite(self.value) and self.value != self.null
        if infinite or not low <= self.value <= high:
            raise InputError(
                f"Parameter '{name}': expected a value within {self.range_text()}, "
                f"found {self.value:g}.",
                "Change the value or widen the bounds.",
            )
        if self.transform == "log" and self.value <= 0:
            raise InputError(
                f"Parameter '{name}': expected a positive value, found {self.value:g}.",
                "Start from a small positive value, or give the parameter a linear transform.",
            )

    @property
    def limits(self) -> tuple[float, float]:
        """The bounds as numbers, infinite where there is none."""
        low, high = self.bounds
        return (-math.inf if low is None else float(low), math.inf if high is None else float(high))

    def limited(self, value: float) -> float:
        """A value within the bounds."""
        low, high = self.limits
        return min(max(float(value), low), high)

    @property
    def scale(self) -> float:
        """The unit length of a linear coordinate: what counts as a moderate change."""
        if self.size is not None:
            return self.size
        low, high = self.limits
        if math.isfinite(low) and math.isfinite(high):
            return 0.5 * (high - low)
        return abs(self.value) or 1.0

    def with_value(self, value: float) -> Parameter:
        """The same parameter at another value."""
        return self if value is self.value else replace(self, value=float(value))

    def to_coordinate(self, value: _Numbers) -> _Numbers:
        """The optimiser's coordinate of a value: its logarithm, or the value over the scale."""
        if self.transform == "log":
            return _of(value).log(value)
        return value / self.scale  # pyright: ignore[reportReturnType]

    def from_coordinate(self, coordinate: _Numbers) -> _Numbers:
        """The value at a coordinate."""
        if self.transform == "log":
            return _of(coordinate).exp(coordinate)
        return coordinate * self.scale

    def coordinate_limits(self) -> tuple[float, float]:
        """The bounds in the optimiser's coordinate.

        A logarithm has no zero: where a "log" parameter may fall to zero, the optimiser is
        stopped fifteen decades below the start, and `at_bound` says so.
        """
        low, high = self.limits
        if self.transform == "linear":
            return low / self.scale, high / self.scale
        return (
            math.log(low) if low > 0 else math.log(self.value) - 35.0,
            math.log(high) if math.isfinite(high) else math.log(self.value) + 35.0,
        )

    def range_text(self) -> str:
        """The bounds for people, such as ``[0, inf) 1/rad``."""
        low, high = self.limits
        lower = "(-inf" if low == -math.inf else f"[{low:g}"
        right = "inf)" if high == math.inf else f"{high:g}]"
        return f"{lower}, {right} {self.unit}".rstrip()


def means_note(names: Sequence[str]) -> tuple[str, ...]:
    """A note where parameters that differ by log stand for all logs; none where none do."""
    if not names:
        return ()
    return (f"By log: {listing(names)}. What stands here is the mean of all logs.",)


def parameter_rows(parameters: Mapping[str, Parameter]) -> Rows:
    """Parameters by name as a table, with what is special about them."""
    rows = []
    for name, p in parameters.items():
        low, high = ("" if bound is None else f"{bound:g}" for bound in p.bounds)
        remark = ", ".join(["fixed"] * p.fixed + ["differs by log"] * p.per_log)
        rows.append((name, number(p.value), p.unit, low, high, remark, p.doc))
    headings = ("Parameter", "Value", "Unit", "From", "to", "", "")
    return Rows.of(headings, rows, numbers=(1, 3, 4))


def _spelt(pattern: str, units: Mapping[str, str]) -> str:
    """A unit that follows a channel, in words where the channel's has no symbol to divide by."""
    channel = pattern[pattern.index("{") + 1 : pattern.index("}")]
    unit, place = units.get(channel, f"the unit of {channel}"), f"{{{channel}}}"
    above, _, below = pattern.partition("/")
    if place in above:
        return f"{unit}/{below}" if unit and below else unit
    # "rad/(V s^2)" reads well; a command without a symbol is spelt out: "rad/s^2 per full effort"
    if unit and unit != "effort" and unit.isalpha():
        return pattern.replace(place, unit)
    remaining = below.strip("()").replace(place, "").strip()
    per = {"effort": "full effort", "": f"the unit of {channel}"}.get(unit, unit)
    return f"{above}/{remaining} per {per}" if remaining else f"{above} per {per}"


def _of(value: object) -> Any:
    """NumPy or JAX, by the value: JAX takes a hundred times as long for a plain number."""
    return jnp if isinstance(value, jax.Array) else np


def _number(value: object) -> TypeGuard[float]:
    return isinstance(value, Real) and not isinstance(value, bool)


def parameter(
    value: float,
    unit: str = "",
    *,
    bounds: tuple[float | None, float | None] = (None, None),
    fixed: bool = False,
    prior: Normal | None = None,
    transform: Literal["linear", "log"] | None = None,
    size: float | None = None,
    null: float | None = None,
    doc: str = "",
    probes: Relative | tuple[float, ...] = (),
) -> Any:
    """Declare a parameter in the body of a `Model` or an `Effect`.

    The arguments are those of `Parameter`. Without a ``transform``, a parameter that is positive
    by its bounds and has no null value is moved by its logarithm.

    Example:
        >>> class Damped(dft.Effect):
        ...     '''Friction in proportion to speed.'''
        ...
        ...     name, port = "damped", "shaft"
        ...     damping: float = dft.parameter(1.0, unit="1/s", bounds=(0.0, None), null=0.0)
        >>> Damped(damping=2.0).damping
        2.0
    """
    if transform is None:
        low = bounds[0] if isinstance(bounds, tuple | list) and bounds else None
        positive = _number(low) and _number(value) and low >= 0 and value > 0
        transform = "log" if positive and null is None else "linear"
    value = float(value) if _number(value) else value  # `Parameter.check` refuses what is none
    return Parameter(value, unit, bounds, fixed, prior, transform, size, null, doc, probes)
