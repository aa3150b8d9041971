"""The signals that equations and effects read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing

Signal = Float[Array, "*time"]
"""One signal at one instant (a number) or over a whole log."""


class Relaxing(NamedTuple):
    """The rate of a state that may be much faster than the log's step.

    Args:
        rate: the full time derivative of the state.
        decay: a non-negative estimate of -d(rate)/d(state) [1/s] from parameters and inputs; where
            it reads a state, the value at the start of the log is used throughout. The integrator
            treats this part exactly, so that a time constant far below the step neither blows up
            nor gives a wrong answer.

    Example:
        >>> rate = dft.models.Relaxing(rate=(1.0 - 0.2) / 0.1, decay=1 / 0.1)
        >>> rate.decay
        10.0
    """

    rate: Signal
    decay: Signal | float


Rate: TypeAlias = Signal | Relaxing
RatesAndOutputs: TypeAlias = tuple[Mapping[str, Rate], Mapping[str, Signal]]
"""What the equations of a model give: the rates of its states, and its outputs."""


class UnknownSignal(InputError):
    """Equations read a signal that neither the log nor the model has.

    Attributes:
        signal: its name.
    """

    def __init__(self, signal: str, present: Iterable[str]) -> None:
        self.signal = signal
        super().__init__(
            f"The equations read the signal '{signal}', which this log and model do not have; "
            f"there are {listing(n for n in present if '.' not in n)}.",
            f"Give the log an input '{signal}', or use a model or effect that does without it.",
        )


class Signals(Mapping[str, Signal]):
    """Named signals at one instant (numbers) or over a whole log (arrays).

    Signals are read as attributes: ``s.speed``, ``s.command``, ``s.time``.

    Example:
        >>> s = dft.models.Signals({"command": 1.0, "speed": 10.0})
        >>> s.speed, "thrust" in s, s.also({"thrust": 2.0})["thrust"]
        (10.0, False, 2.0)
    """

    def __init__(self, values: Mapping[str, Signal | ArrayLike]) -> None:
        self._values: dict[str, Any] = dict(values)

    def __getattr__(self, name: str) -> Signal:
        # copy and pickle look for special methods on half-made objects: no message for those
        if name.startswith("__"):
            raise AttributeError(name)
        try:
            return self._values[name]
        except KeyError:
            raise UnknownSignal(name, self._values) from None

    def __getitem__(self, name: str) -> Signal:
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def also(self, values: Mapping[str, Signal | float]) -> Signals:
        """These signals with some added or replaced."""
        return Signals({**self._values, **values})


@contextmanager
def elementwise(where: str) -> Iterator[None]:
    """Say in plain words where a signal that is not yet known was used as if it were."""
    try:
        yield
    except (jax.errors.ConcretizationTypeError, jax.errors.TracerArrayConversionError):
        raise InputError(
            f"{where}: a Python 'if', 'and', 'or', 'min', 'max' or 'float', or a function of math "
            "or numpy, acts on a signal or parameter; these stand for whole series here.",
            "Use jnp.where(condition, a, b) rather than if, and functions of jax.numpy.",
        ) from None


def expect(where: str, what: str, names: Iterable[str], returned: Mapping[str, object]) -> None:
    """Raise `InputError` where a mapping that the user's code returned lacks a name."""
    missing = [name for name in names if name not in returned]
    if missing:
        raise InputError(
            f"{where}: expected a {what} {listing(missing)}, found {listing(returned)}.",
            f"Return a value for {listing(missing)}.",
        )


def power_law(command: Signal, exponent: Any) -> Signal:
    """sign(command) |command|^exponent, with a derivative also at rest."""
    turning = command != 0
    # 1 in the place of a command of 0: 0 ** p by p is 0 * log 0, a NaN that `where` does not keep
    # out of the derivative
    strength = jnp.where(turning, jnp.abs(command), 1.0) ** exponent
    return jnp.where(turning, jnp.sign(command) * strength, 0.0)
