"""A law of unknown form: what a port lacks, as a smooth function of one signal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float

from diffthrust._support.errors import InputError
from diffthrust._support.names import nearest
from diffthrust.effects._grammar import ExpressionEffect, expression_of
from diffthrust.models._base.component import registered
from diffthrust.models._base.made_effect import ARRIVING, described_fields, plain_description
from diffthrust.models._base.parameter import Normal, Parameter, parameter
from diffthrust.models._base.signals import Signal, Signals

_DEGREE = 3
"""Degree of the pieces; a curve has as many splines more than pieces."""
_FOURTH = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0
"""Weights of the truncated third powers that make a cubic B-spline on a grid of unit step."""
_BEYOND = 3.0
"""Pieces beyond its grid from which on a curve is zero."""
_LEAST_PIECES, _MOST_PIECES = 3, 200


@registered
class Curve(ExpressionEffect):
    """A law that nobody has written yet: a smooth function of one signal acts at a port.

    Acts on the signal of any port: ``value + times * curve(signal)``. The curve is a cubic spline
    on an even grid from ``low`` to ``high`` and goes back to nothing within three pieces beyond.
    Its coefficients are a ``level``, a ``slope`` (the rise from ``low`` to ``high``) and bends, all
    with normal priors about zero; the bends are independent where the curve is as stiff as
    ``bend`` says, which is the penalty on second differences of P-splines. Null: all coefficients
    zero. Source: Eilers & Marx 1996, section 2; Currie & Durban 2002, section 2 (the priors).

    Of signals that remember (see `Formula`) the time constant or the width is a parameter of the
    curve's own: ``"lag(command**2, T)"`` is what heats a motor, ``"value - play(value, b)"`` what a
    backlash swallows, ``"integral(1)"`` the time since the log began.

    Args:
        port: where it acts.
        signal: an expression of signals that may be read there, such as ``"speed"`` or
            ``"lag(command**2, T)"``; ``"value"`` is what arrives at the port.
        low: lower end of the grid, in the signal's unit.
        high: upper end.
        times: an expression by which the curve is multiplied: ``"value"`` makes it scale what
            arrives, ``"abs(speed)"`` gives a law of two signals. It cannot remember.
        pieces: intervals of the grid.
        size: a typical size of the curve, the scale of its priors.
        bend: standard deviation of the bends, over ``size``; small for stiff curves.
        unit: of the curve.
        shape: values of level, slope and bends to begin with; zeros where empty.
        held: coefficients that are fixed, because other parameters can do their work.
        name: by which the model knows it.
        **parameters: those of the expressions, each a `dft.parameter` or a mapping of its fields
            with "unit" and "value".

    Raises:
        InputError: ends in the wrong order, too few pieces, sizes that are not positive, a shape of
            another length, an expression that is not allowed, a parameter that it does not have or
            that has no value.

    Example:
        >>> curve = dft.effects.Curve(
        ...     "shaft", "speed", -60.0, 60.0, size=50.0, unit="rad/s^2", pieces=4
        ... )
        >>> model = dft.Thruster() + curve
        >>> [name for name in model.parameters if name.startswith("curve.")][:2]
        ['curve.level', 'curve.slope']
        >>> float(curve.at_signal(10.0)), curve.basis([10.0]).shape, curve.shape
        (0.0, (7, 1), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    """

    name = "curve"
    main = "signal"
    options = (
        "name", "port", "signal", "times", "low", "high", "pieces",
    )  # fmt: skip
    signal: str
    times: str
    low: float
    high: float
    pieces: int
    size: float
    bend: float
    unit: str
    held: tuple[str, ...]
    coefficients: tuple[str, ...]
    _weights: Any

    def __init__(
        self,
        /,
        port: str,
        signal: str,
        low: float,
        high: float,
        *,
        times: str = "",
        pieces: int = 8,
        size: float = 1.0,
        bend: float = 1.0,
        unit: str = "",
        shape: Sequence[float] = (),
        held: Sequence[str] = (),
        name: str = "curve",
        **parameters: Any,
    ) -> None:
        label = f"curve of {signal!r:.60} at {port!r:.60}"
        numbers = {"low": low, "high": high, "size": size, "bend": bend, "pieces": pieces}
        _check_kinds(label, numbers, {"signal": signal, "times": times})
        law, factor = expression_of(signal), expression_of(times or "1")
        whole = isinstance(pieces, int | np.integer)
        if not (whole and _LEAST_PIECES <= pieces <= _MOST_PIECES):
            raise InputError(
                f"{label}: expected a whole number of {_LEAST_PIECES} to {_MOST_PIECES} pieces, "
                f"found {pieces!r}.",
                "Write such as pieces=8, without a decimal point.",
            )
        pieces = int(pieces)
        most = pieces + _DEGREE
        for right, expected, actual in (
            (-np.inf < low < high < np.inf, "low < high, both finite", f"{low!r} and {high!r}"),
            (size > 0 and bend > 0, "a positive size and bend", f"{size!r} and {bend!r}"),
            (not factor.memories, "times of what does not remember", repr(times)),
            (len(shape) <= most, f"a shape of at most {most} numbers", str(len(shape))),
        ):
            if not right:
                raise InputError(f"{label}: expected {expected}, found {actual}.", "Correct it.")
        names = ("level", "slope", *(f"bend{k + 1}" for k in range(pieces + 1)))
        for name_held in (each for each in held if each not in names):
            near = nearest(str(name_held), names, "; ")
            raise InputError(
                f"{label}: expected names of coefficients to hold, found {name_held!r}{near}.",
                "Correct the name.",
            )
        for taken in (name for name in parameters if name in names):
            raise InputError(
                f"{label}: a parameter cannot be called {taken!r}, as a coefficient is.",
                "Give it another name.",
            )
        places = {**law.places, **factor.places}
        self._check_parameters(parameters, places, signal)
        descriptions = {n: plain_description(f"curve, {n}", each) for n, each in parameters.items()}
        declared = _coefficients(names, shape, unit, size, bend, held)
        declared |= {n: _own(n, each, n in law.sizes) for n, each in descriptions.items()}
        self._set(signal=signal, times=times, low=float(low), high=float(high), pieces=pieces)
        self._set(size=size, bend=bend, unit=unit, held=tuple(held), coefficients=names)
        self._set(given=descriptions, states={memory.state: "" for memory in law.memories})
        reads = tuple(sorted({*places} - {*descriptions, ARRIVING}))
        self._make(name, port, declared, reads)
        self._set(_weights=_weighed(self.shape))

    @property
    def shape(self) -> tuple[float, ...]:
        """The values of level, slope and bends."""
        return tuple(getattr(self, name) for name in self.coefficients)

    def at_signal(self, x: ArrayLike) -> Signal:
        """The curve at values of its signal, of the same shape."""
        # truncated powers grow without end, and cancel to zero only in exact arithmetic: far
        # signals are brought to where the curve has just ended
        at = jnp.clip(self._on_grid(jnp.asarray(x, float)), -_BEYOND, self.pieces + _BEYOND)
        return truncated_powers(at + _BEYOND, self._weights)

    def basis(self, x: ArrayLike) -> Float[np.ndarray, " coefficients *T"]:
        """The curve's derivatives by its coefficients at values of its signal."""
        at = np.clip(self._on_grid(np.asarray(x, float)), -_BEYOND, self.pieces + _BEYOND)
        starts = np.arange(self.pieces + 7) - _BEYOND
        powers = np.maximum(at - starts.reshape(-1, *[1] * at.ndim), 0.0) ** 3
        return np.tensordot(spline_weights(len(self.coefficients)).T, powers, 1)

    def __call__(self, value: Signal, s: Signals) -> Signal:
        named = self._named(value, s)
        curve = self.at_signal(self._law(named, jnp))
        return value + (expression_of(self.times)(named, jnp) * curve if self.times else curve)

    def _copy(self, **attributes: Any) -> Curve:
        copy = super()._copy(**attributes)
        # here, and not in the loop over time, which would compute them at every step
        copy._set(_weights=_weighed(copy.shape))
        return copy

    def _on_grid(self, x: Any) -> Any:
        return (x - self.low) * (self.pieces / (self.high - self.low))


def _weighed(shape: Sequence[Any]) -> Any:
    """The weight of each truncated power; plain numbers need no compiled program."""
    if all(isinstance(value, int | float | np.number) for value in shape):
        return spline_weights(len(shape)) @ np.array(shape, float)
    return curve_weights(*shape)


# As arrays these two compile faster than as sums of their terms (the fit of a curve by a fifth);
# exported programs write the terms out (export._trace).
@jax.jit
def curve_weights(*coefficients: Signal) -> Signal:
    """The weight of each truncated power in a curve with these coefficients."""
    shape = jnp.stack(jnp.broadcast_arrays(*(jnp.asarray(value, float) for value in coefficients)))
    return jnp.tensordot(jnp.asarray(spline_weights(len(coefficients))), shape, 1)


@jax.jit
def truncated_powers(x: Signal, weights: Signal) -> Signal:
    """The sum of weights times third powers of what ``x`` is above 0, 1, 2, ...; 0 below."""
    x = jnp.broadcast_to(x, jnp.broadcast_shapes(x.shape, weights.shape[1:]))
    starts = jnp.arange(float(len(weights))).reshape(-1, *[1] * x.ndim)
    along = weights.reshape(-1, *[1] * (x.ndim - weights.ndim + 1), *weights.shape[1:])
    return jnp.sum(along * jnp.maximum(x[None] - starts, 0.0) ** 3, axis=0)


def _check_kinds(label: str, numbers: Mapping[str, Any], texts: Mapping[str, Any]) -> None:
    """Raise `InputError` for a number that is none, or a text that is none."""
    for name, value in numbers.items():
        if isinstance(value, bool) or not isinstance(value, int | float | np.number):
            raise InputError(f"{label}: expected a number as {name}, found {value!r}.", "Give one.")
    for name, value in texts.items():
        if not isinstance(value, str):
            raise InputError(f"{label}: expected text as {name}, found {value!r}.", "Quote it.")


def _coefficients(
    names: Sequence[str],
    shape: Sequence[float],
    unit: str,
    size: float,
    bend: float,
    held: Sequence[str],
) -> dict[str, Parameter]:
    """Level, slope and bends, each with a normal prior about zero."""
    begin = [*map(float, shape), *[0.0] * (len(names) - len(shape))]
    # the slope is the rise over the whole grid: a line from -size to +size rises by twice the size
    widths = [width * size for width in (1.0, 2.0, *[bend] * (len(names) - 2))]
    return {
        name: parameter(
            value, unit, null=0.0, size=width, prior=Normal(0.0, width), fixed=name in held
        )
        for name, value, width in zip(names, begin, widths, strict=True)
    }


def _own(name: str, description: str | Mapping[str, Any], size: bool) -> Parameter:
    """A parameter of an expression; a time constant or width is not negative."""
    fields = described_fields(f"curve, {name}", description)
    if "value" not in fields:
        raise InputError(
            f"curve, parameter {name!r}: nothing says where it begins.",
            f'Give it a value: {name}={{"unit": "{fields["unit"]}", "value": ...}}.',
        )
    return parameter(**{**({"bounds": (0.0, None)} if size else {}), **fields})


@lru_cache
def spline_weights(splines: int) -> Float[np.ndarray, "powers coefficients"]:
    """Weights of the truncated powers, by level, slope, and bends with a unit prior.

    The bends are the eigenvectors of the penalty on second differences, each over the root of its
    eigenvalue. Divided by the pieces to the power of 1.5 they have the same size on any grid.
    """
    pieces = splines - _DEGREE
    second = np.diff(np.eye(splines), 2, axis=0)
    # the mixed-model form of P-splines: over the root of their eigenvalues the penalty is a unit
    # prior; the first two, of eigenvalue zero, are level and slope
    values, vectors = np.linalg.eigh(second.T @ second)
    bends = vectors[:, 2:] / np.sqrt(values[2:]) / pieces**1.5
    along = (np.arange(splines) - 1.0) / pieces - 0.5
    columns = np.column_stack([np.ones(splines), along, bends])
    return np.stack([np.convolve(column, _FOURTH) for column in columns.T], axis=1)
