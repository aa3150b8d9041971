"""What a craft is built on: a body that moves under forces."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.models._base.component import Component
from diffthrust.models._base.effect import Ports
from diffthrust.models._base.signals import Rate, RatesAndOutputs, Signal, Signals
from diffthrust.models._craft.kinematics import Kinematics, kinematics_of
from diffthrust.models._craft.six import Six


class Body(Component):
    """A hull under the forces of the actuators on it: the part of a `Craft` that moves.

    A subclass names ``states``, ``outputs``, ``optional_inputs`` and ``ports`` as a `Model` does,
    declares its parameters, and implements `motion` and `equations`. Names must not have a dot.

    Example:
        >>> class Cart(dft.bodies.Body):
        ...     '''A cart on rails.'''
        ...
        ...     name = "cart"
        ...     states = outputs = {"velocity": "m/s"}
        ...     ports = {"force": "net force [N]"}
        ...     mass: float = dft.parameter(10.0, "kg", bounds=(0, None))
        ...
        ...     def motion(self, s, port):
        ...         return dft.bodies.Six(surge=s.velocity)
        ...
        ...     def equations(self, s, port, water, forces):
        ...         rate = port("force", forces.surge) / self.mass
        ...         return {"velocity": rate}, {"velocity": s.velocity}
        >>> cart = dft.Craft(Cart(), fan=dft.Thruster().at((0, 0, 0)))
        >>> list(cart.parameters)[:4]
        ['mass', 'fan.alpha', 'fan.beta', 'fan.ct']
    """

    library: ClassVar[dict[str, type[Body]]] = {}
    states: ClassVar[Mapping[str, str]] = {}
    outputs: ClassVar[Mapping[str, str]] = {}
    optional_inputs: ClassVar[Mapping[str, str]] = {}
    ports: ClassVar[Mapping[str, str]] = {}
    angles: ClassVar[tuple[str, ...]] = ()
    time_scales: ClassVar[tuple[float, float]] = (0.05, 40.0)
    horizon: ClassVar[float | None] = None
    start_outputs: ClassVar[tuple[str, ...]] = ()
    quaternions: ClassVar[tuple[tuple[str, ...], ...]] = ()

    def motion(self, s: Signals, port: Ports) -> Six:
        """The velocities through the water, along and about the body's axes.

        Example:
            >>> s = dft.models.Signals({"velocity": 0.5, "position": 2.0})
            >>> dft.bodies.Axis().motion(s, dft.models.Ports((), s)).surge
            0.5
        """
        raise self._lacks("motion(self, s, port): return Six(surge=s.surge)")

    def equations(self, s: Signals, port: Ports, water: Six, forces: Six) -> RatesAndOutputs:
        """Rates and outputs of the body.

        Args:
            s: the signals.
            port: the ports.
            water: what `motion` returned.
            forces: forces and moments of all actuators about the origin.

        Example:
            >>> s = dft.models.Signals({"velocity": 0.0, "position": 0.0})
            >>> body, port = dft.bodies.Axis(mass=2.0), dft.models.Ports((), s)
            >>> rates, _ = body.equations(s, port, dft.bodies.Six(), dft.bodies.Six(surge=4.0))
            >>> float(rates["velocity"])
            2.0
        """
        raise self._lacks("equations(self, s, port, water, forces): return {...}, {...}")

    def kinematics(self, s: Signals, rates: Mapping[str, Rate]) -> Kinematics:
        """How it moves over ground, for the sensors on it: by states of the usual names.

        A body whose states have others must define it.

        Args:
            s: the signals.
            rates: of its states.

        Example:
            >>> s = dft.models.Signals({"velocity": 0.5, "position": 2.0})
            >>> dft.bodies.Axis().kinematics(s, {"velocity": 0.1}).velocity.surge
            0.5
        """
        return kinematics_of(s, rates)

    def initial(self, s: Signals) -> Mapping[str, Signal | float]:
        """Initial states where nothing gives them, as `Model.initial`.

        Example:
            >>> dft.bodies.Planar().initial(dft.models.Signals({}))
            {}
        """
        return {}

    def start_from(self, first: Mapping[str, Any]) -> Mapping[str, Any]:
        """States at the start that follow from first measurements of outputs; see `Model`.

        Where a sensor on the craft tells the attitude, its quaternion is among them.

        Example:
            >>> first = {"qw": 0.0, "qx": 0.0, "qy": 0.0, "qz": -1.0}
            >>> round(float(dft.bodies.Planar().start_from(first)["heading"]), 6)
            -3.141593
        """
        if "qw" not in first or "heading" not in self.states:
            return {}
        maths = jnp if isinstance(first["qw"], jax.Array) else np
        heading = 2.0 * maths.arctan2(first["qz"], first["qw"])
        # one of the headings that are two turns apart, which have this quaternion and not -1 times
        measured = first.get("heading", heading)
        turns = maths.round((heading - measured) / (2.0 * np.pi))
        return {"heading": measured + 2.0 * np.pi * turns}

    def _telling(self, channels: Collection[str]) -> tuple[str, ...]:
        """As `Model._telling`; the craft asks its sensors, too."""
        return ()

    def _lacks(self, line: str) -> InputError:
        return InputError(f"Body '{self.name}' has no equations.", f"Define def {line}.")


BODIES = Body.library
"""The library's bodies, by name."""
