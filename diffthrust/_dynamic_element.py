"""A fitted model as the nonlinear element of a loop: a describing function of two arguments."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._channels import listing
from diffthrust._errors import InputError
from diffthrust._integrate import integrate
from diffthrust._model import Model
from diffthrust._nonlinearity import Nonlinearity
from diffthrust._signals import Ports, Relaxing, Signals
from diffthrust._simulate import equations_of
from diffthrust.effects import CommandDelay

_STEPS = 256
"""Steps per period while a describing function is mapped."""
_SHOTS = 16
_HELD = 1e-12
"""Keeps Newton's method where it is if a state does not move at all, as within a dead band."""
_PORTION = 64
"""Points of one call: one size, compiled once."""


class ModelElement(Nonlinearity):
    """From a model's input to one of its outputs, with all its effects but those of the sensors.

    Its describing function is the fundamental of the settled answer to a sine, found by shooting:
    Newton's method on the states after one period. It reads the true output that acts on the
    vehicle, not what a sensor makes of it.

    Args:
        model: the model, with its effects and at its parameter values.
        input: the input that the loop drives; others the model cannot have.
        output: what goes on to the linear part.

    A `CommandDelay` is taken out and kept as ``delay`` [s]: a loop counts it with the dead time of
    its linear part, which is the same, for whatever else acts on the command does not care when it
    comes.

    Raises:
        InputError: an input or output that the model does not have, a model without states, or an
            effect that reads earlier samples of the input.

    Example:
        >>> ModelElement(fit.model).describing(1.0, 0.5)
    """

    odd = False  # effects may tell forward from reverse

    def __init__(self, model: Any, *, input: str = "command", output: str = "thrust") -> None:
        self.model, self.delay = _without_delay(checked_model(model), input)
        self.input, self.output = input, output
        for what, name, known in (
            ("input", input, self.model.inputs),
            ("output", output, self.model.outputs),
        ):
            if name not in known:
                raise InputError(
                    f"The model '{self.model}' has no {what} '{name}'; it has {listing(known)}.",
                    f"Name one of them: {what}='{next(iter(known), '')}'.",
                )
        others = [name for name in self.model.inputs if name != input]
        if others:
            raise InputError(
                f"The model '{self.model}' needs {listing(others)} besides '{input}'; a loop with "
                "one nonlinear element drives one input only.",
                "Use a model with one input.",
            )
        if not self.model.all_states:
            raise InputError(
                f"The model '{self.model}' has no states.",
                "Give its curve as a dft.StaticNonlinearity.",
            )
        late = [e.name for e in self.model.effects if e.memory and input in e.ports]
        if late:
            raise InputError(
                f"The effect {listing(late)} reads earlier samples of '{input}', which a loop in "
                "continuous time does not have.",
                f'Take it out (model - "{late[0]}") and let an effect with a state stand for it, '
                "such as dft.effects.ActuatorLag; or simulate the loop with its samples: "
                "dft.control.",
            )

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states that are integrated."""
        return tuple(self.model.all_states)

    @property
    def values(self) -> dict[str, Any]:
        """The parameter values, by full name."""
        return {name: jnp.asarray(p.value, float) for name, p in self.model.parameters.items()}

    @property
    def structure(self) -> tuple[Any, ...]:
        """What fixes the compiled code."""
        return (type(self), self.model.structure, self.input, self.output)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ModelElement) and self.structure == other.structure

    def __hash__(self) -> int:
        return hash(self.structure)

    def evaluate(
        self, values: Mapping[str, Any], states: Mapping[str, Any], command: Any, time: Any
    ) -> tuple[dict[str, Any], Any]:
        """Rates of the states and the output; traceable, elementwise.

        Args:
            values: parameter values by full name.
            states: by name.
            command: the input, in the model's unit.
            time: [s].
        """
        model = self.model.bind(values)
        outer = Ports(model.effects, Signals({self.input: command, "time": time}))
        s = Signals({**states, self.input: outer(self.input, command), "time": time})
        port = Ports(model.effects, s)
        rates, outputs = equations_of(model, s, port)
        return {**rates, **port.rates}, outputs[self.output]

    def describing(self, amplitude: Any, frequency: Any) -> np.ndarray:
        """The describing function by shooting; NaN where no settled answer was found."""
        a, w = np.broadcast_arrays(np.asarray(amplitude, float), np.asarray(frequency, float))
        return settled(self, a.reshape(-1), w.reshape(-1))[0].reshape(a.shape)

    def orbit(self, amplitude: float, frequency: float) -> np.ndarray:
        """States over a settled period, evenly spaced from the sine's rise, ``(states, n)``."""
        return settled(self, np.array([amplitude]), np.array([frequency]))[1]

    def quasi_linear(
        self, n: complex, amplitude: float, frequency: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """A gain with a first-order lag, as in Yoerger et al. 1990, where the phase allows it."""
        if not (n.real > 0 > n.imag):
            return super().quasi_linear(n, amplitude, frequency)
        pole = frequency * n.real / -n.imag
        gain = abs(n) * math.hypot(1.0, frequency / pole)
        return np.array([gain * pole]), np.array([1.0, pole])

    def __str__(self) -> str:
        return str(self.model)


def checked_model(model: Any) -> Model:
    """A model, or the model of a fit.

    Raises:
        InputError: neither.
    """
    found = getattr(model, "model", model)
    if not isinstance(found, Model):
        raise InputError(
            f"Expected a model or a fit, found {model!r}.", "Give dft.Thruster() or a fit."
        )
    return found


def _without_delay(model: Model, input: str) -> tuple[Model, float]:
    """A model without the delays of an input, and the dead time [s] that they amount to."""
    found = [e for e in model.effects if isinstance(e, CommandDelay) and input in e.ports]
    for effect in found:
        model = model - effect.name
    return model, float(sum(effect.delay for effect in found))


def plain_rate(rate: Any) -> Any:
    """The number in a rate that may be `Relaxing`."""
    return rate.rate if isinstance(rate, Relaxing) else rate


def settled(
    element: ModelElement, amplitude: np.ndarray, frequency: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Describing function and orbits.

    Where the steps prove too long for a fast model, the period is cut more finely.

    Args:
        element: the model.
        amplitude: of the sine at its input, ``(n,)``.
        frequency: [rad/s], ``(n,)``.

    Returns:
        N, complex ``(n,)``, NaN where no settled answer was found; and the states over the period
        of the last point, ``(states, steps)``.
    """
    found = np.full(amplitude.shape, np.nan + 0j)
    orbit = np.full((len(element.states), 1), np.nan)
    for steps in (_STEPS, 12 * _STEPS):
        left = np.flatnonzero(np.isnan(found))
        for first in range(0, left.size, _PORTION):
            part = left[first : first + _PORTION]
            taken = np.resize(part, _PORTION)
            n, x = _shoot(element, steps, element.values, amplitude[taken], frequency[taken])
            found[part] = np.asarray(n)[: part.size]
            if part[-1] == found.size - 1:
                orbit = np.asarray(x)[part.size - 1]
    return found, orbit


@partial(jax.jit, static_argnums=(0, 1))
def _shoot(element: ModelElement, steps: int, values: Any, amplitude: Any, frequency: Any) -> Any:
    return jax.vmap(lambda a, w: _settle(element, steps, values, a, w))(amplitude, frequency)


def _settle(element: ModelElement, steps: int, values: Any, a: Any, w: Any) -> tuple[Any, Any]:
    names = element.states
    length = jnp.full(steps, 2.0 * math.pi / steps) / w
    clock = jnp.arange(steps + 1.0) * length[0]
    instants = {"time": (clock[:-1], clock[1:])}

    def rates(x: Mapping[str, Any], u: Mapping[str, Any]) -> dict[str, Any]:
        return element.evaluate(values, x, a * jnp.sin(w * u["time"]), u["time"])[0]

    def course(x: Any) -> dict[str, Any]:
        begin = dict(zip(names, x, strict=True))
        return integrate(rates, begin, instants, length, {}, uniform=True)

    def after(x: Any) -> tuple[Any, Any]:
        path = course(x)
        gap = jnp.stack([path[name][-1] for name in names]) - x
        return gap, gap

    held = _HELD * jnp.eye(len(names))

    def shot(state: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
        x, _, count = state
        slopes, gap = jax.jacfwd(after, has_aux=True)(x)
        # from rest one period is run through first: there the slopes can mislead
        step = jnp.where(count == 0, gap, -jnp.linalg.solve(slopes - held, gap))
        return x + step, jnp.abs(step).max() / (jnp.abs(x).max() + 1e-300), count + 1

    def going(state: tuple[Any, Any, Any]) -> Any:
        return (state[1] > 1e-10) & (state[2] < _SHOTS)

    x = jnp.zeros(len(names))
    x, _, _ = jax.lax.while_loop(going, shot, (x, jnp.asarray(math.inf), 0))
    path = course(x)
    missed = jnp.stack([path[name][-1] for name in names]) - x
    swing = jnp.stack([jnp.ptp(path[name]) for name in names]) + jnp.abs(x)
    fine = jnp.all(jnp.abs(missed) <= 1e-7 * swing + 1e-300)
    y = element.evaluate(values, path, a * jnp.sin(w * clock), clock)[1][:-1]
    angle = w * clock[:-1]
    inphase, quadrature = jnp.mean(y * jnp.sin(angle)), jnp.mean(y * jnp.cos(angle))
    n = 2.0 / a * inphase, 2.0 / a * quadrature
    orbit = jnp.stack([path[name][:-1] for name in names])
    return jax.lax.complex(*(jnp.where(fine, part, jnp.nan) for part in n)), orbit
