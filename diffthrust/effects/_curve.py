"""A static curve of unknown form: what a port lacks, as a smooth function of one signal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any, ClassVar, Literal

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float

from diffthrust._support.errors import InputError
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.parameter import Normal, Parameter, parameter
from diffthrust.models._base.signals import Rate, Relaxing, Signal, Signals

Manner = Literal["adds", "scales"]
_FOURTH = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0
"""A cubic B-spline on a grid of unit step in truncated third powers, from where it begins."""


class Curve(Effect):
    """Something unknown acts at a port: a smooth function of one signal.

    Acts on the signal of any port: added to it, or as a factor 1 + curve. The curve is a cubic
    spline on an even grid from ``low`` to ``high`` and goes back to nothing beyond, within two of
    its pieces. Its coefficients are those of a mixed model: a ``level``, a ``slope`` (the change
    from ``low`` to ``high``) and bends, each of which has the prior Normal(0, ``bend``): the
    penalty on second differences of P-splines. Null: all coefficients zero. Source: Eilers & Marx
    1996, section 2; Currie & Durban 2002, section 2 (the mixed model).

    With ``past`` the curve is one of what the signal was: of its first-order lag with the estimated
    ``time_constant`` [s]. The signal "time" is the time since the log began, "value" what arrives
    at the port.

    Args:
        port: where it acts.
        signal: an input or a state of the model, "time" or "value".
        low: lower end of the grid, in the signal's unit.
        high: upper end.
        manner: whether it is added to what arrives, or scales it.
        pieces: intervals of the grid.
        past: first guess of the time constant of the signal's lag [s]; 0 for the signal itself.
        size: a typical size of the curve, in the port's unit; the scale of its priors.
        bend: standard deviation of the priors of the bends, over ``size``; small for stiff curves.
        unit: of what it adds.
        held: coefficients that stay at zero, as other parameters do what they would.
        name: by which the model knows it.
        **coefficients: values of ``level``, ``slope``, ``bend1``, ... and ``time_constant``.

    Raises:
        InputError: ends in the wrong order, fewer than three pieces, an unknown manner.

    Example:
        >>> curve = dft.effects.Curve("load", "speed", -40.0, 40.0, size=5.0, slope=2.0)
        >>> float(curve.at_signal(20.0))
        1.5
    """

    name: ClassVar[str] = "curve"
    port: ClassVar[str] = "?"
    options: ClassVar[tuple[str, ...]] = (
        "name", "port", "signal", "low", "high", "manner", "pieces", "lagged"
    )  # fmt: skip

    def __init__(
        self,
        port: str,
        signal: str,
        low: float,
        high: float,
        *,
        manner: Manner = "adds",
        pieces: int = 8,
        past: float = 0.0,
        size: float = 1.0,
        bend: float = 1.0,
        unit: str = "",
        held: tuple[str, ...] = (),
        name: str = "curve",
        **coefficients: float | Parameter,
    ) -> None:
        if not low < high:
            raise InputError(
                f"Curve of {signal} at '{port}': expected low < high, found {low:g} and {high:g}.",
                "Give the lowest and the highest value of the signal in the logs.",
            )
        if pieces < 3 or manner not in ("adds", "scales"):
            raise InputError(
                f"Curve of {signal} at '{port}': expected three pieces or more and the manner "
                f"'adds' or 'scales', found {pieces} and {manner!r}.",
                "Correct what differs.",
            )
        declared = _coefficients(pieces, size, bend, unit if manner == "adds" else "")
        declared |= {n: replace(declared[n], fixed=True) for n in held}
        if past:
            declared["time_constant"] = parameter(past, "s", bounds=(1e-3 * past, None))
        self._set(port=port, ports=(port,), name=name, signal=signal, low=low, high=high)
        self._set(manner=manner, pieces=pieces, past=past, size=size, bend=bend, unit=unit, held=held)
        lagged = bool(past) or signal == "time"
        self._set(lagged=lagged, states={"past": "s" if signal == "time" else ""} if lagged else {})
        self._set(declared=declared)
        super().__init__(**coefficients)
        self._set(_weights=self._weighed())

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of the coefficients of the curve."""
        return ("level", "slope", *(f"bend{k + 1}" for k in range(self.pieces + 1)))

    def at_signal(self, x: ArrayLike) -> Signal:
        """The curve at values of its signal, of the same shape."""
        return self._curve(jnp.asarray(x, float))

    def basis(self, x: ArrayLike) -> Float[np.ndarray, "coefficients *T"]:
        """The curve's derivatives by its coefficients at values of its signal."""
        powers = _powers(self._reached(np.asarray(x, float)), self.pieces)
        return np.tensordot(_mixed(self.pieces).T, powers, 1)

    def __call__(self, value: Signal, s: Signals) -> Signal:
        """The signal of the port with the curve in it."""
        x = s.past if self.lagged else value if self.signal == "value" else s[self.signal]
        curve = self._curve(x)
        return value + curve if self.manner == "adds" else value * (1.0 + curve)

    def rates(self, value: Signal, s: Signals) -> Mapping[str, Rate]:
        """First-order lag of the signal; the clock of a log runs on."""
        if self.signal == "time":
            return {"past": jnp.ones_like(s.past)}
        x = value if self.signal == "value" else s[self.signal]
        decay = 1.0 / self.time_constant
        return {"past": Relaxing(decay * (x - s.past), decay)}

    def initial(self, value: Signal, s: Signals) -> Mapping[str, Signal | float]:
        """Settled at what the signal is when the log begins."""
        if self.signal == "time":
            return {}
        return {"past": value if self.signal == "value" else s[self.signal]}

    def _copy(self, **attributes: Any) -> Curve:
        other = super()._copy(**attributes)
        # here, not in the loop over time, where they would be worked out at each step
        other._set(_weights=other._weighed())
        return other

    def _weighed(self) -> list[Any]:
        """The weight of each truncated power."""
        values = [getattr(self, name) for name in self.coefficients]
        return [
            sum(float(w) * v for w, v in zip(row, values, strict=True))
            for row in _mixed(self.pieces)
        ]

    def _reached(self, x: Any) -> Any:
        step = (self.high - self.low) / self.pieces
        return (x - self.low) / step

    def _curve(self, x: Signal) -> Signal:
        at = jnp.clip(self._reached(x), -3.0, self.pieces + 3.0)
        total = jnp.zeros_like(at)
        for k, weight in enumerate(self._weights):
            total = total + weight * jnp.maximum(at - (k - 3.0), 0.0) ** 3
        return total


def _coefficients(pieces: int, size: float, bend: float, unit: str) -> dict[str, Parameter]:
    ends = {"level": 1.0, "slope": 2.0}
    return {
        name: parameter(
            0.0, unit, null=0.0, size=width * size, prior=Normal(0.0, width * size)
        )
        for name, width in {
            **ends,
            **{f"bend{k + 1}": bend for k in range(pieces + 1)},
        }.items()
    }


def _powers(at: Float[np.ndarray, "*T"], pieces: int) -> Float[np.ndarray, "powers *T"]:
    at = np.clip(at, -3.0, pieces + 3.0)
    return np.stack([np.maximum(at - (k - 3.0), 0.0) ** 3 for k in range(pieces + 7)])


@lru_cache
def _mixed(pieces: int) -> Float[np.ndarray, "powers coefficients"]:
    """Weights of truncated powers by level, slope and bends of unit prior.

    The bends are the eigenvectors of the penalty on second differences, each over the root of its
    eigenvalue and times the pieces squared, so that a bend means as much on any grid.
    """
    splines = pieces + 3
    second = np.diff(np.eye(splines), 2, axis=0)
    values, vectors = np.linalg.eigh(second.T @ second)
    bends = vectors[:, 2:] / np.sqrt(values[2:])
    along = (np.arange(splines) - 1.0) / pieces - 0.5
    columns = np.column_stack([np.ones(splines), along, bends[:, ::1] / pieces**1.5])
    return np.stack([np.convolve(column, _FOURTH) for column in columns.T], axis=1)
