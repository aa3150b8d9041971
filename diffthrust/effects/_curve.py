"""A law of unknown form: what a port lacks, as a smooth function of one signal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float

from diffthrust._support.errors import InputError
from diffthrust.effects._grammar import expression_of
from diffthrust.models._base.component import registered
from diffthrust.models._base.made_effect import ARRIVING, MadeEffect
from diffthrust.models._base.parameter import Normal, parameter
from diffthrust.models._base.signals import Rate, Relaxing, Signal, Signals

CLOCK = "clock"
"""The signal that is the time since the log began."""
_FOURTH = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0
"""A cubic B-spline on a grid of unit step in truncated third powers, from where it begins."""
_BEYOND = 3.0
"""So many pieces beyond its grid a spline is zero."""
_LEAST_PIECES = 3


@registered
class Curve(MadeEffect):
    """A law that nobody has written yet: a smooth function of one signal acts at a port.

    Acts on the signal of any port: ``value + times * curve(signal)``. The curve is a cubic spline
    on an even grid from ``low`` to ``high`` and goes back to nothing within three pieces beyond.
    Its coefficients are a ``level``, a ``slope`` (the rise from ``low`` to ``high``) and bends, all
    with normal priors about zero; the bends are independent where the curve is as stiff as
    ``bend`` says, which is the penalty on second differences of P-splines. Null: all coefficients
    zero. Source: Eilers & Marx 1996, section 2; Currie & Durban 2002, section 2 (the priors).

    With ``past`` the curve is one of what the signal was: of its first-order lag, whose
    ``time_constant`` [s] is estimated. So a square of the command with a past is what heats a
    motor. ``clock`` is the time since the log began.

    Args:
        port: where it acts.
        signal: an expression of signals that may be read there, such as ``"speed"`` or
            ``"command**2"``; ``"value"`` is what arrives at the port, ``"clock"`` the time since
            the log began.
        low: lower end of the grid, in the signal's unit.
        high: upper end.
        times: an expression by which the curve is multiplied: ``"value"`` makes it scale what
            arrives, ``"abs(speed)"`` gives a law of two signals.
        past: first guess of the time constant of the signal's lag [s]; 0 for the signal itself.
        pieces: intervals of the grid.
        size: a typical size of the curve, the scale of its priors.
        bend: standard deviation of the bends, over ``size``; small for stiff curves.
        unit: of the curve.
        shape: values of level, slope and bends to begin with; zeros where empty.
        held: coefficients that stay where they are, as other parameters do what they would.
        name: by which the model knows it.

    Raises:
        InputError: ends in the wrong order, too few pieces, sizes that are not positive, a shape of
            another length, an expression that is not allowed.

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
    options: ClassVar[tuple[str, ...]] = (
        "name",
        "port",
        "signal",
        "times",
        "low",
        "high",
        "pieces",
        "lags",
    )
    signal: str
    times: str
    low: float
    high: float
    past: float
    pieces: int
    size: float
    bend: float
    unit: str
    held: tuple[str, ...]
    coefficients: tuple[str, ...]
    time_constant: float
    lags: bool
    _weights: list[Any]

    def __init__(
        self,
        port: str,
        signal: str,
        low: float,
        high: float,
        *,
        times: str = "",
        past: float = 0.0,
        pieces: int = 8,
        size: float = 1.0,
        bend: float = 1.0,
        unit: str = "",
        shape: Sequence[float] = (),
        held: Sequence[str] = (),
        name: str = "curve",
    ) -> None:
        number = pieces + 3
        for right, expected, found in (
            (low < high, "low < high", f"{low!r} and {high!r}"),
            (pieces >= _LEAST_PIECES, f"{_LEAST_PIECES} pieces or more", repr(pieces)),
            (size > 0 and bend > 0, "a positive size and bend", f"{size!r} and {bend!r}"),
            (past >= 0, "a past of no less than 0 s", repr(past)),
            (len(shape) <= number, f"a shape of at most {number} numbers", str(len(shape))),
        ):
            if not right:
                raise InputError(
                    f"curve of {signal!r:.60} at {port!r:.60}: expected {expected}, found {found}.",
                    "Correct it.",
                )
        begin = [*map(float, shape), *[0.0] * (number - len(shape))]
        widths = [1.0, 2.0, *[bend] * (pieces + 1)]
        names = ("level", "slope", *(f"bend{k + 1}" for k in range(pieces + 1)))
        declared = {
            n: parameter(
                value, unit, null=0.0, size=width * size, prior=Normal(0.0, width * size),
                fixed=n in held,
            )
            for n, value, width in zip(names, begin, widths, strict=True)
        }  # fmt: skip
        if past:
            declared["time_constant"] = parameter(past, "s", bounds=(0.01 * past, 100.0 * past))
        self._set(signal=signal, times=times, low=float(low), high=float(high), pieces=pieces)
        self._set(past=past, size=size, bend=bend, unit=unit, held=tuple(held), coefficients=names)
        self._set(lags=bool(past) or signal == CLOCK)
        self._set(states={"past": ""} if self.lags else {})
        read = {*expression_of(signal).places, *expression_of(times or "0").places}
        self._make(name, port, declared, tuple(sorted(read - {ARRIVING, CLOCK})))
        self._set(_weights=self._weighed())

    @property
    def shape(self) -> tuple[float, ...]:
        """The values of level, slope and bends."""
        return tuple(getattr(self, name) for name in self.coefficients)

    def at_signal(self, x: ArrayLike) -> Signal:
        """The curve at values of its signal, of the same shape."""
        return self._curve(jnp.asarray(x, float))

    def basis(self, x: ArrayLike) -> Float[np.ndarray, " coefficients *T"]:
        """The curve's derivatives by its coefficients at values of its signal."""
        at = np.clip(self._on_grid(np.asarray(x, float)), -_BEYOND, self.pieces + _BEYOND)
        starts = np.arange(self.pieces + 7) - _BEYOND
        powers = np.maximum(at - starts.reshape(-1, *[1] * at.ndim), 0.0) ** 3
        return np.tensordot(_weights(self.pieces).T, powers, 1)

    def read(self, expression: str, value: Signal, s: Mapping[str, Signal]) -> Signal:
        """An expression at the port, from what arrives there and the signals."""

        def named(name: str) -> Any:
            return value if name == ARRIVING else s[name]

        return expression_of(expression)(named, jnp)

    def __call__(self, value: Signal, s: Signals) -> Signal:
        """The signal of the port with the curve in it."""
        curve = self._curve(s.past if self.lags else self.read(self.signal, value, s))
        return value + (self.read(self.times, value, s) * curve if self.times else curve)

    def rates(self, value: Signal, s: Signals) -> Mapping[str, Rate]:
        """First-order lag of the signal; the clock runs on."""
        if self.signal == CLOCK:
            return {"past": jnp.ones_like(s.past)}
        decay = 1.0 / self.time_constant
        return {"past": Relaxing(decay * (self.read(self.signal, value, s) - s.past), decay)}

    def initial(self, value: Signal, s: Signals) -> Mapping[str, Signal | float]:
        """Settled at what the signal is when the log begins; the clock at zero."""
        return {} if self.signal == CLOCK else {"past": self.read(self.signal, value, s)}

    def _copy(self, **attributes: Any) -> Curve:
        other = super()._copy(**attributes)
        # here, not in the loop over time, where they would be worked out at each step
        other._set(_weights=other._weighed())
        return other

    def _weighed(self) -> list[Any]:
        """The weight of each truncated power."""
        return [
            sum(float(w) * v for w, v in zip(row, self.shape, strict=True))
            for row in _weights(self.pieces)
        ]

    def _on_grid(self, x: Any) -> Any:
        return (x - self.low) * (self.pieces / (self.high - self.low))

    def _curve(self, x: Signal) -> Signal:
        at = jnp.clip(self._on_grid(x), -_BEYOND, self.pieces + _BEYOND)
        total = jnp.zeros_like(at)
        for k, weight in enumerate(self._weights):
            total = total + weight * jnp.maximum(at - (k - _BEYOND), 0.0) ** 3
        return total


@lru_cache
def _weights(pieces: int) -> Float[np.ndarray, "powers coefficients"]:
    """Weights of truncated powers by level, slope, and bends of unit prior.

    The bends are the eigenvectors of the penalty on second differences, each over the root of its
    eigenvalue; over the pieces to the power of 1.5 they mean as much on any grid.
    """
    splines = pieces + 3
    second = np.diff(np.eye(splines), 2, axis=0)
    values, vectors = np.linalg.eigh(second.T @ second)
    bends = vectors[:, 2:] / np.sqrt(values[2:]) / pieces**1.5
    along = (np.arange(splines) - 1.0) / pieces - 0.5
    columns = np.column_stack([np.ones(splines), along, bends])
    return np.stack([np.convolve(column, _FOURTH) for column in columns.T], axis=1)
