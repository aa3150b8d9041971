"""A thruster on one axis of a vehicle with quadratic drag, as one nonlinear element."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import ArrayLike

from diffthrust.cycles._element import positive
from diffthrust.cycles._model_element import ModelElement
from diffthrust.models._base.quadratic_load import SQUARED_SINE
from diffthrust.models._base.signals import Relaxing


class PropelledAxis(ModelElement):
    """From a thruster's command to the velocity of the vehicle that it drives.

        mass * d(velocity)/dt = thrust - drag * velocity |velocity|

    The describing function is that of the thruster times the quasi-linear vehicle, whose drag
    coefficient is 8/(3 pi) drag times the amplitude of the velocity; the balance of harmonics and
    the simulation take the drag as it is.

    Args:
        model: the thruster, with its effects.
        mass: of the vehicle, with the water that moves along [kg].
        drag: [N s^2/m^2], above zero.

    Raises:
        InputError: a mass or drag that is not positive, or a model that `ModelElement` refuses.

    Source: Yoerger, Cooke & Slotine 1990, section IV.

    Example:
        >>> PropelledAxis(dft.Thruster(), mass=340.0, drag=67.0).describing(0.6, 1.0)
    """

    def __init__(self, model: Any, *, mass: float, drag: float) -> None:
        super().__init__(model)
        self.mass, self.drag = positive("mass", mass), positive("drag", drag)
        self.thruster = ModelElement(model)

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
        n = self.thruster.describing(amplitude, frequency)
        w = np.asarray(frequency, float)
        with np.errstate(invalid="ignore"):  # where the thruster has no settled answer
            return n / (1j * w * self.mass + self._damping(np.abs(n) * amplitude, w))

    def answer(self, amplitude: float, frequency: float, harmonics: int) -> np.ndarray:
        """Coefficients of the thruster's states, and of the velocity by its describing function."""
        thruster = self.thruster.answer(amplitude, frequency, harmonics)
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
        num, den = self.thruster.quasi_linear(thrust, amplitude, frequency)
        return num, np.polymul(den, vehicle)

    def _damping(self, force: np.ndarray, w: np.ndarray) -> np.ndarray:
        """8/(3 pi) drag V for the velocity V that solves |j w M + 8/(3 pi) drag V| V = force."""
        inertia = (w * self.mass) ** 2
        squared = 2.0 * (SQUARED_SINE * self.drag * force) ** 2
        # (-b + sqrt(b^2 + 4 c)) / 2 without the loss of digits at small drag
        return np.sqrt(squared / (inertia + np.sqrt(inertia**2 + 2.0 * squared)))

    def __str__(self) -> str:
        return f"{self.model} on a vehicle of {self.mass:.4g} kg with drag {self.drag:.4g} N s2/m2"
