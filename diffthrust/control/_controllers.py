"""Controllers: what they share with compensators; three terms on one channel; of position."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Literal, Self

import jax.numpy as jnp
from jaxtyping import Array

from diffthrust._support.errors import InputError
from diffthrust._support.validation import check_known
from diffthrust.models._base.component import Component, changed
from diffthrust.models._base.parameter import Parameter, parameter
from diffthrust.models._base.signals import Signals

Kept = Mapping[str, Array]
"""What a block remembers from sample to sample, by the names in its ``states``."""


class Block(Component):
    """Something that is worked out at every sample of the controller.

    A subclass names the measured channels that it ``reads``, what it remembers from one sample to
    the next in ``states`` (name to unit), and declares its gains with `parameter`. It is evaluated
    with traced numbers: functions of ``jax.numpy`` only, ``jnp.where`` rather than ``if``.

    Example:
        >>> block = dft.control.PD(frequency=1.0)
        >>> block.start(), block.parameters["frequency"].value
        ({}, 1.0)
        >>> block.replace(frequency=2.0).frequency
        2.0
    """

    reads: ClassVar[tuple[str, ...]] = ()
    states: ClassVar[Mapping[str, str]] = {}

    def start(self) -> Mapping[str, float]:
        """What is remembered at the first sample; zero by default."""
        return {}

    @property
    def parameters(self) -> dict[str, Parameter]:
        """The gains by name."""
        return {name: self._present(name) for name in self._parameters}

    def replace(self, **more: Any) -> Self:
        """The block with some gains changed: by a value, a `Parameter`, or some fields.

        Raises:
            InputError: a name that the block does not have, or a value outside its bounds.
        """
        named = self.parameters
        for name, new in more.items():
            check_known(name, named, f"{type(self).__name__} has no gain")
            named[name] = changed(named[name], new, name)
            named[name].check(name)
        return self._with_parameters(named)

    def __repr__(self) -> str:
        listed = ", ".join(f"{k}={getattr(self, k):.4g}" for k in self._parameters)
        return f"{type(self).__name__}({listed})"


class Controller(Block):
    """From the reference and the measurements to the thrust that is wanted, or to a command.

    ``gives`` says which: ``"thrust"`` [N], which a `Compensator` turns into the command, or
    ``"command"`` [V], which goes to the thruster as it is. ``of`` is the channel that the
    reference is for.

    Example:
        >>> issubclass(dft.control.PD, dft.control.Controller)
        True
    """

    of: str = "position"
    gives: str = "thrust"

    def __call__(self, s: Signals, kept: Kept, period: Array) -> tuple[Array, Kept]:
        """What is wanted at this sample, and what is to be remembered.

        Args:
            s: the measured channels by name, the reference ``wanted`` with its derivatives
                ``wanted_rate`` and ``wanted_acceleration``, and ``time`` [s].
            kept: what was remembered at the last sample.
            period: time between two samples [s].
        """
        raise InputError(
            f"Controller '{type(self).__name__}' has no __call__.",
            "Define def __call__(self, s, kept, period): return thrust, {}.",
        )


def rate_of(
    value: Array, last: Array, begun: Array, smoothing: Array | float, period: Array
) -> tuple[Array, Array]:
    """The rate of a sampled signal through a first-order low-pass, by backward differences.

    Args:
        value: the present sample.
        last: the low-passed signal at the last sample.
        begun: 0 at the first sample, where the rate is unknown and taken as zero; 1 after it.
        smoothing: time constant of the low-pass [s]; at zero the difference of two samples.
        period: time between two samples [s].

    Returns:
        The rate, and the low-passed signal to remember.

    Example:
        >>> rate, smoothed = dft.control.rate_of(
        ...     jnp.array(1.0), jnp.array(0.0), jnp.array(1.0), jnp.array(0.1), jnp.array(0.02)
        ... )
        >>> rate.shape
        ()
    """
    ahead = (value - last) / (smoothing + period)
    # without it the first difference is that from zero: a step of the whole measurement
    rate = begun * ahead
    return rate, jnp.where(begun > 0, last + period * ahead, value)


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
