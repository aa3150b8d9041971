"""Controllers: three terms on one channel, and of position, with the thruster taken for ideal."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, Literal

import jax.numpy as jnp
from jaxtyping import Array

from diffthrust._support.errors import InputError
from diffthrust.control._base import Controller, Kept, rate_of
from diffthrust.models._base.parameter import Parameter, parameter
from diffthrust.models._base.signals import Signals

_GIVES = ("command", "thrust")


class PID(Controller):
    """Proportional, integral and derivative action on one channel: P, PI or PID by its gains.

        output = kp e + integral of ki e - kd d(measured)/dt,   e = wanted - measured

    The output is held within -limit and limit. While it is, the integral is drawn back with the
    time constant ``unwinding`` [s], so that it does not wind up; kp / ki is a usual choice, and
    infinite none at all. The derivative is that of the measurement (a step of the reference does
    not kick), through a low-pass of the time constant ``smoothing`` [s].

    Gains are per unit of the channel: kp in V/(rad/s) for a speed, N/m for a position that gives
    a thrust. Sources: Aras et al. 2013, section 3.1 (a PI speed loop with kp = 5, ki = 15);
    Åström & Hägglund 2006, sections 3.4 and 3.5 (derivative of the measurement, back-calculation).

    Args:
        of: the channel that follows the reference: "speed", "position", or another of the loop.
        gives: "command" [V], straight to the thruster, or "thrust" [N], through a compensator.
        **gains: kp, ki, kd, limit, unwinding, smoothing.

    Raises:
        InputError: something else to give, an unknown gain, or a value outside its bounds.

    Example:
        >>> dft.control.PID(kp=5.0, ki=15.0, limit=13.0).kp
        5.0
    """

    states: ClassVar[Mapping[str, str]] = {"integral": "", "smoothed": "", "begun": ""}
    options: ClassVar[tuple[str, ...]] = ("of", "gives")

    kp: float = parameter(1.0, bounds=(0, None), transform="linear", size=1.0)
    ki: float = parameter(0.0, bounds=(0, None), transform="linear", size=1.0)
    kd: float = parameter(0.0, bounds=(0, None), transform="linear", size=1.0)
    limit: float = parameter(math.inf, bounds=(0, None), null=math.inf, fixed=True)
    unwinding: float = parameter(0.5, "s", bounds=(0, None), null=math.inf, fixed=True)
    smoothing: float = parameter(0.0, "s", bounds=(0, None), transform="linear", fixed=True)

    def __init__(
        self,
        of: str = "speed",
        gives: Literal["command", "thrust"] = "command",
        **gains: float | Parameter,
    ) -> None:
        if gives not in _GIVES:
            raise InputError(
                f"PID, gives: expected {' or '.join(_GIVES)}, found {gives!r}.", "Correct it."
            )
        self._set(of=of, gives=gives, reads=(of,))
        super().__init__(**gains)

    def __call__(self, s: Signals, kept: Kept, period: Array) -> tuple[Array, Kept]:
        """The output within its limits, and the integral drawn back to it."""
        measured = s[self.of]
        error = s.wanted - measured
        rate, smoothed = rate_of(measured, kept["smoothed"], kept["begun"], self.smoothing, period)
        free = self.kp * error + kept["integral"] - self.kd * rate
        output = jnp.clip(free, -self.limit, self.limit)
        # the implicit form of (output - free) / unwinding: stable for any period
        back = (output - free) * period / (self.unwinding + period)
        back = jnp.where(self.ki > 0, back, 0.0)  # without integral action nothing winds up
        integral = kept["integral"] + period * self.ki * error + back
        return output, {"integral": integral, "smoothed": smoothed, "begun": jnp.ones(())}


class PositionController(Controller):
    """Tracks a position with errors that would die out at one bandwidth, were the thruster ideal.

        thrust = drag x'|x'| + mass (xd'' - 2 bandwidth e' - bandwidth^2 e),   e = x - xd

    With exact ``mass`` and ``drag`` and the thrust as wanted, e'' + 2 bandwidth e' +
    bandwidth^2 e = 0. Source: Yoerger, Cooke & Slotine 1990, section V A.

    Example:
        >>> dft.control.PositionController(bandwidth=1.0, mass=340.0, drag=67.0).parameters[
        ...     "bandwidth"
        ... ].unit
        'rad/s'
    """

    reads: ClassVar[tuple[str, ...]] = ("position", "velocity")

    bandwidth: float = parameter(1.0, "rad/s", bounds=(0, None))
    mass: float = parameter(340.0, "kg", bounds=(0, None), fixed=True)
    drag: float = parameter(67.0, "N s^2/m^2", bounds=(0, None), transform="linear", fixed=True)

    def __call__(self, s: Signals, kept: Kept, period: Array) -> tuple[Array, Kept]:
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
        >>> dft.control.PD(frequency=1.0, damping=0.707, mass=340.0).parameters["mass"].unit
        'kg'
    """

    reads: ClassVar[tuple[str, ...]] = ("position", "velocity")

    frequency: float = parameter(1.0, "rad/s", bounds=(0, None))
    damping: float = parameter(0.707, bounds=(0, None))
    mass: float = parameter(340.0, "kg", bounds=(0, None), fixed=True)

    def __call__(self, s: Signals, kept: Kept, period: Array) -> tuple[Array, Kept]:
        """Yoerger et al. 1990, section IV."""
        near = self.frequency**2 * (s.wanted - s.position)
        calm = 2.0 * self.damping * self.frequency * (s.wanted_rate - s.velocity)
        return self.mass * (near + calm), {}
