"""The signals that equations and effects read, and the ports where effects act."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import jax

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing

if TYPE_CHECKING:
    from diffthrust.models._base.effect import Effect


class Relaxing(NamedTuple):
    """The rate of a state that may be much faster than the log's step.

    Args:
        rate: the full time derivative of the state.
        decay: a non-negative estimate of -d(rate)/d(state) [1/s] from parameters and inputs; where
            it reads a state, the value at the start of the log is used throughout. The integrator
            treats this part exactly, so that a time constant far below the step neither blows up
            nor lies.

    Example:
        >>> Relaxing(rate=(target - current) / tau, decay=1 / tau)
    """

    rate: Any
    decay: Any


class Signals(Mapping[str, Any]):
    """Named signals at one instant (numbers) or over a whole log (arrays).

    Signals are read as attributes: ``s.speed``, ``s.command``, ``s.time``.
    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        self._values = dict(values)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        try:
            return self._values[name]
        except KeyError:
            raise InputError(
                f"The equations read the signal '{name}', which this log and model do not have; "
                f"there are {listing(n for n in self._values if '.' not in n)}.",
                f"Give the log an input '{name}', or use a model or effect that does without it.",
            ) from None

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    def __iter__(self) -> Any:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def also(self, values: Mapping[str, Any]) -> Signals:
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


def expect(where: str, what: str, names: Iterable[str], found: Mapping[str, Any]) -> None:
    """Raise `InputError` where a mapping that the user's code returned lacks a name."""
    missing = [name for name in names if name not in found]
    if missing:
        raise InputError(
            f"{where}: expected a {what} {listing(missing)}, found {listing(found) or 'none'}.",
            f"Return a value for {listing(missing)}.",
        )


class Ports:
    """Passes a value through the effects that act at a port, in the order they were added.

    One instance serves one evaluation of a model's equations; it collects the rates of the
    effects' own states on the way. With ``starting=True`` those states are set to their initial
    values instead, as the value arrives.
    """

    def __init__(self, effects: Sequence[Effect], signals: Signals, starting: bool = False) -> None:
        self._effects = effects
        self._signals = signals
        self._starting = starting
        self.rates: dict[str, Any] = {}
        self.initial: dict[str, Any] = {}

    def tell(self, **signals: Any) -> None:
        """Let the effects at the ports that follow read what the model has worked out."""
        self._signals = self._signals.also(signals)

    def __call__(self, port: str, value: Any) -> Any:
        for effect in self._effects:
            if port in effect.ports:
                value = self._through(effect, port, value)
        return value

    def _through(self, effect: Effect, port: str, value: Any) -> Any:
        where = type(effect).__name__
        if not effect.states:
            with elementwise(where):
                return effect.at(port, value, self._signals)
        own = {name: f"{effect.name}.{name}" for name in effect.states}
        if self._starting:
            start = effect.initial(value, self._signals)
            self.initial.update({own[name]: start.get(name, 0.0) for name in own})
            signals = self._signals.also({name: self.initial[own[name]] for name in own})
        else:
            signals = self._signals.also({name: self._signals[own[name]] for name in own})
        with elementwise(where):
            rates = effect.rates(value, signals)
            leaving = effect.at(port, value, signals)
        expect(f"{where}.rates", "rate of the state", own, rates)
        self.rates.update({own[name]: rates[name] for name in own})
        return leaving
