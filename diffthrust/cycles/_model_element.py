"""A fitted model as the nonlinear element of a loop: a describing function of two arguments."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import ArrayLike

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing
from diffthrust._support.transfer import Transfer
from diffthrust.cycles._element import Nonlinearity, NotSimulated, positive
from diffthrust.cycles._model_loop import balanced_states, course_of, simulated_states
from diffthrust.cycles._oscillation import CycleSeries, LoopCourse
from diffthrust.describing._periodic.harmonic_balance import HarmonicBalance
from diffthrust.describing._periodic.period import Cycle, Lane
from diffthrust.describing._periodic.respond import Reason, respond, some
from diffthrust.describing._periodic.shooting import Shooting
from diffthrust.effects import CommandDelay
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.quadratic_load import SQUARED_SINE
from diffthrust.models._base.signals import Relaxing, Signals
from diffthrust.simulation._trajectory import bare, equations_of

_STEPS = (256, 3072)
"""Steps per period while a describing function is mapped, then those for a model that is too fast
for them. They are fixed: a search that follows slopes must not see them change."""


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
        >>> element = dft.cycles.ModelElement(fit.model)
        >>> list(element.states), list(element.values)
        (['speed'], ['alpha', 'beta', 'ct'])
        >>> bool(abs(element.describing(1.0, 0.5)) > abs(element.describing(1.0, 5.0)))
        True
    """

    odd = False  # effects may tell forward from reverse

    def __init__(self, model: Any, *, input: str = "command", output: str = "thrust") -> None:
        direct, delay = _without_delay(checked_model(model), input)
        self.model: Model = direct
        self.delay: float = delay
        self.input: str = input
        self.output: str = output
        for what, name, names in (
            ("input", input, self.model.inputs),
            ("output", output, self.model.outputs),
        ):
            if name not in names:
                raise InputError(
                    f"The model '{self.model}' has no {what} '{name}'; it has {listing(names)}.",
                    f"Name one of them: {what}='{next(iter(names), '')}'.",
                )
        further = [name for name in self.model.inputs if name != input]
        if further:
            raise InputError(
                f"The model '{self.model}' needs {listing(further)} besides '{input}'; a loop "
                "with one nonlinear element drives one input only.",
                "Use a model with one input.",
            )
        if not self.model.all_states:
            raise InputError(
                f"The model '{self.model}' has no states.",
                "Give its curve as a dft.cycles.StaticNonlinearity.",
            )
        self.unit: str = self.model.inputs[input]
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
    def values(self) -> dict[str, Array]:
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
        self,
        values: Mapping[str, Array],
        states: Mapping[str, Array],
        command: Array,
        time: Array,
    ) -> tuple[dict[str, Array | Relaxing], Array]:
        """Rates of the states and the output; traceable, elementwise, in the model's units."""
        model = self.model.bind(values)
        outer = Ports(model.effects, Signals({self.input: command, "time": time}))
        s = Signals({**states, self.input: outer(self.input, command), "time": time})
        port = Ports(model.effects, s)
        rates, outputs = equations_of(model, s, port)
        return {**rates, **port.rates}, outputs[self.output]

    def describing(self, amplitude: ArrayLike, frequency: ArrayLike) -> np.ndarray:
        """The describing function by shooting; NaN where no settled answer was found."""
        a, w = np.broadcast_arrays(np.asarray(amplitude, float), np.asarray(frequency, float))
        lanes = self._lanes(a.reshape(-1), w.reshape(-1))
        solver = Shooting(self._driven, len(self.model.all_states))
        n = np.full(a.size, np.nan + 0j)
        for steps in _STEPS:
            # few points need the fine steps, which are twelve times the work
            unsettled = np.flatnonzero(np.isnan(n))
            if unsettled.size:
                answers = respond(solver, self._cycle, some(lanes, unsettled), samples=steps)
                n[unsettled] = np.where(answers.reason == Reason.SETTLED, answers.first, np.nan)
        return n.reshape(a.shape)

    def answer(self, amplitude: float, frequency: float, harmonics: int) -> np.ndarray:
        """The states' answer to a sine: coefficients, complex ``(states, harmonics + 1)``.

        The real part of sum c_k exp(j k w t); NaN where none was found.
        """
        lanes = self._lanes(np.array([amplitude]), np.array([frequency]))
        solver = HarmonicBalance(self._driven, len(self.model.all_states), harmonics)
        settled = respond(solver, self._cycle, lanes)
        x = np.where(settled.reason[0] == Reason.SETTLED, settled.x[0], np.nan)
        # cosine and sine coefficients (a, b) are a - j b in the real part of c exp(j k w t)
        return np.concatenate([x[:, :1], x[:, 1::2] - 1j * x[:, 2::2]], axis=1)

    def balanced(
        self, transfer: Transfer, amplitude: float, frequency: float, harmonics: int
    ) -> CycleSeries | None:
        """The cycle near a solution of the describing function; the states take part."""
        answer = self.answer(amplitude, frequency, harmonics)
        return balanced_states(transfer, self, answer, amplitude, frequency)

    def courses(
        self, transfer: Transfer, cycle: CycleSeries, factors: tuple[float, ...], periods: int
    ) -> list[LoopCourse]:
        """Simulate the loop from starts on a cycle whose states are known.

        Raises:
            NotSimulated: they are not.
            InputError: both the linear part and the model pass a step at once.
        """
        if cycle.states is None:
            raise NotSimulated("the balance of harmonics did not converge")
        return simulated_states(transfer, self, cycle, cycle.states, factors, periods)

    def course(
        self, transfer: Transfer, output: float, period: float, duration: float
    ) -> LoopCourse:
        """Simulate the loop from rest: see `course_of`."""
        return course_of(transfer, self, output, period, duration)

    @property
    def _driven(self) -> Model:
        """The model without the effects of its sensors: what acts is the true output."""
        return bare(self.model)

    @property
    def _cycle(self) -> Cycle:
        return Cycle(self.input, self.output, 1, states=tuple(self.model.all_states))

    def _lanes(self, a: np.ndarray, w: np.ndarray) -> Lane:
        values = {n: np.full(a.size, p.value) for n, p in self._driven.parameters.items()}
        return Lane(a, w, values, np.zeros(a.size), {}, np.zeros(a.size))

    def quasi_linear(
        self, n: complex, amplitude: float, frequency: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """A gain with a first-order lag, as in Yoerger et al. 1990, where the phase allows it."""
        # a phase between 0 and -90 degrees is what a first-order lag can have
        if not (n.real > 0 > n.imag):
            return super().quasi_linear(n, amplitude, frequency)
        pole = frequency * n.real / -n.imag
        gain = abs(n) * math.hypot(1.0, frequency / pole)
        return np.array([gain * pole]), np.array([1.0, pole])

    def __str__(self) -> str:
        return str(self.model)


class PropelledAxis(ModelElement):
    """From a thruster's command to the velocity of the vehicle that it drives.

        mass * d(velocity)/dt = thrust - drag * velocity |velocity|

    The mass [kg] is with the water that moves along, the drag [N s^2/m^2] above zero. The
    describing function is that of the thruster times the quasi-linear vehicle, whose drag
    coefficient is 8/(3 pi) drag times the amplitude of the velocity; the balance of harmonics and
    the simulation take the drag as it is. Source: Yoerger, Cooke & Slotine 1990, section IV.
    """

    def __init__(self, model: Any, *, mass: float, drag: float) -> None:
        super().__init__(model)
        self.mass, self.drag = positive("mass", mass), positive("drag", drag)

    @property
    def states(self) -> tuple[str, ...]:
        """The thruster's states and the velocity."""
        return (*super().states, "vehicle.velocity")

    @property
    def values(self) -> dict[str, Array]:
        """The thruster's parameters, mass and drag."""
        vehicle = {"vehicle.mass": self.mass, "vehicle.drag": self.drag}
        return {**super().values, **{name: jnp.asarray(value) for name, value in vehicle.items()}}

    def evaluate(
        self,
        values: Mapping[str, Array],
        states: Mapping[str, Array],
        command: Array,
        time: Array,
    ) -> tuple[dict[str, Array | Relaxing], Array]:
        """Rates of the states, and the velocity."""
        thruster_states = {
            name: value for name, value in states.items() if name != "vehicle.velocity"
        }
        rates, thrust = super().evaluate(values, thruster_states, command, time)
        v = states["vehicle.velocity"]
        force = thrust - values["vehicle.drag"] * v * jnp.abs(v)
        return {**rates, "vehicle.velocity": force / values["vehicle.mass"]}, v

    def describing(self, amplitude: ArrayLike, frequency: ArrayLike) -> np.ndarray:
        """That of the thruster times that of the vehicle, one after the other."""
        n = super().describing(amplitude, frequency)
        w = np.asarray(frequency, float)
        with np.errstate(invalid="ignore"):  # where the thruster has no settled answer
            return n / (1j * w * self.mass + self._damping(np.abs(n) * amplitude, w))

    def answer(self, amplitude: float, frequency: float, harmonics: int) -> np.ndarray:
        """Coefficients of the thruster's states, and of the velocity by its describing function."""
        thruster = super().answer(amplitude, frequency, harmonics)
        velocity = np.zeros((1, harmonics + 1), complex)
        # the answers are to a sine, whose coefficient is -j
        velocity[0, 1] = -1j * amplitude * complex(self.describing(amplitude, frequency))
        return np.concatenate([thruster, velocity])

    def quasi_linear(
        self, n: complex, amplitude: float, frequency: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """The thruster's lag and the vehicle's."""
        vehicle = [self.mass, SQUARED_SINE * self.drag * abs(n) * amplitude]
        thrust = n * complex(vehicle[1], frequency * vehicle[0])
        num, den = super().quasi_linear(thrust, amplitude, frequency)
        return num, np.polymul(den, vehicle)

    def _damping(self, force: np.ndarray, w: np.ndarray) -> np.ndarray:
        """8/(3 pi) drag V for the velocity V that solves |j w M + 8/(3 pi) drag V| V = force."""
        inertia = (w * self.mass) ** 2
        squared = 2.0 * (SQUARED_SINE * self.drag * force) ** 2
        # (-b + sqrt(b^2 + 4 c)) / 2 without the loss of digits at small drag
        return np.sqrt(squared / (inertia + np.sqrt(inertia**2 + 2.0 * squared)))

    def __str__(self) -> str:
        return f"{self.model} on a vehicle of {self.mass:.4g} kg with drag {self.drag:.4g} N s2/m2"


def checked_model(model: Any) -> Model:
    """A model, or the model of a fit."""
    bare_model = getattr(model, "model", model)
    if not isinstance(bare_model, Model):
        raise InputError(
            f"Expected a model or a fit, found {model!r}.", "Give dft.Thruster() or a fit."
        )
    return bare_model


def _without_delay(model: Model, input: str) -> tuple[Model, float]:
    """A model without the delays of an input, and the dead time [s] that they amount to."""
    delays = [e for e in model.effects if isinstance(e, CommandDelay) and input in e.ports]
    for effect in delays:
        model = model - effect.name
    return model, float(sum(effect.delay for effect in delays))
