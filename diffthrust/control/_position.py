"""Controllers of position that know the vehicle and take the thruster for ideal."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp

from diffthrust.control._base import Controller, Kept
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.signals import Signals


class PositionController(Controller):
    """Tracks a position with errors that would die out at one bandwidth, were the thruster ideal.

        thrust = drag x'|x'| + mass (xd'' - 2 bandwidth e' - bandwidth^2 e),   e = x - xd

    With exact ``mass`` and ``drag`` and the thrust as wanted, e'' + 2 bandwidth e' +
    bandwidth^2 e = 0. Source: Yoerger, Cooke & Slotine 1990, section V A.

    Example:
        >>> controller = dft.control.PositionController(bandwidth=1.0, mass=340.0, drag=67.0)
    """

    reads = ("position", "velocity")

    bandwidth: float = parameter(1.0, "rad/s", bounds=(0, None))
    mass: float = parameter(340.0, "kg", bounds=(0, None), fixed=True)
    drag: float = parameter(67.0, "N s^2/m^2", bounds=(0, None), transform="linear", fixed=True)

    def __call__(self, s: Signals, kept: Kept, period: Any) -> tuple[Any, Kept]:
        """Yoerger et al. 1990, section V A, the vehicle position controller."""
        error, rate = s.position - s.wanted, s.velocity - s.wanted_rate
        pull = 2.0 * self.bandwidth * rate + self.bandwidth**2 * error
        drag = self.drag * s.velocity * jnp.abs(s.velocity)
        return drag + self.mass * (s.wanted_acceleration - pull), {}


class PD(Controller):
    """Position and velocity gains that would place the poles of a pure inertia.

        thrust = mass (frequency^2 (xd - x) + 2 damping frequency (xd' - x'))

    Around a thruster with dynamics of its own this loop has a limit cycle. Source: Yoerger, Cooke
    & Slotine 1990, section IV, figures 13 and 14.

    Example:
        >>> controller = dft.control.PD(frequency=1.0, damping=0.707, mass=340.0)
    """

    reads = ("position", "velocity")

    frequency: float = parameter(1.0, "rad/s", bounds=(0, None))
    damping: float = parameter(0.707, bounds=(0, None))
    mass: float = parameter(340.0, "kg", bounds=(0, None), fixed=True)

    def __call__(self, s: Signals, kept: Kept, period: Any) -> tuple[Any, Kept]:
        """Yoerger et al. 1990, section IV."""
        near = self.frequency**2 * (s.wanted - s.position)
        calm = 2.0 * self.damping * self.frequency * (s.wanted_rate - s.velocity)
        return self.mass * (near + calm), {}
