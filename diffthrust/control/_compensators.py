"""Compensators of the thruster's lag, in series behind a position controller.

All turn the thrust that is wanted [N] into the command [V]. Their nominal values are those of the
thruster that the designer believes in, which need not be the one in the loop.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array

from diffthrust._support.errors import InputError
from diffthrust.control._controllers import Block, Kept, rate_of
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import Parameter, parameter
from diffthrust.models._base.quadratic_load import QuadraticLoad
from diffthrust.models._base.signals import Signals


class Compensator(Block):
    """From the thrust that is wanted to the command.

    Example:
        >>> lead = dft.control.Lead.of(dft.Thruster(alpha=0.037, beta=42.0, ct=0.022))
        >>> round(lead.thrust_per_volt, 2)
        24.97
    """

    @classmethod
    def of(cls, thruster: Model, **given: float | Parameter) -> Self:
        """The compensator for a thruster whose torque follows the command, like `Thruster`.

        Args:
            thruster: the nominal thruster, a model with `quadratic_load`; its effects are ignored.
            **given: gains that are not to follow from it.

        Raises:
            InputError: the model is no such thruster.
        """
        nominal = thruster.quadratic_load if isinstance(thruster, Model) else None
        if nominal is None:
            gains = ", ".join(f"{name}=..." for name in cls._gains(QuadraticLoad(1.0, 1.0, 1.0)))
            raise InputError(
                f"{cls.__name__}.of: expected a thruster whose torque follows the command, like "
                f"dft.Thruster with its parameters 'alpha', 'beta' and 'ct', found {thruster!s}.",
                f"Give the nominal values by name: {cls.__name__}({gains}).",
            )
        return cls(**{**cls._gains(nominal), **given})

    @classmethod
    def _gains(cls, nominal: QuadraticLoad) -> dict[str, float]:
        """The gains that follow from the nominal thruster."""
        return {"thrust_per_volt": nominal.thrust_per_command}

    def __call__(self, thrust: Array, s: Signals, kept: Kept, period: Array) -> tuple[Array, Kept]:
        """The command for a wanted thrust [N]; other arguments as those of a controller."""
        raise InputError(
            f"Compensator '{type(self).__name__}' has no __call__.",
            "Define def __call__(self, thrust, s, kept, period): return command, {}.",
        )


class NoCompensator(Compensator):
    """The command whose steady thrust is the one wanted: the thruster's lag is not looked at.

    command = thrust / thrust_per_volt, which is ct beta / alpha. Source: Yoerger, Cooke & Slotine
    1990, section IV.

    Example:
        >>> dft.control.NoCompensator.of(
        ...     dft.Thruster(alpha=0.04, beta=40.0, ct=0.02)
        ... ).thrust_per_volt
        20.0
    """

    thrust_per_volt: float = parameter(21.6, "N/V", bounds=(0, None), fixed=True)

    def __call__(self, thrust: Array, s: Signals, kept: Kept, period: Array) -> tuple[Array, Kept]:
        """Yoerger et al. 1990, section II: thrust is proportional to the command at rest."""
        return thrust / self.thrust_per_volt, {}


class Lead(Compensator):
    """A lead network of unit gain at rest: (s / zero + 1) / (s / pole + 1).

    The zero lies where the thruster's lag is at one size of command, the pole well above. The
    network is linear, so that at other sizes it cancels too little or too much. It is worked out
    as the analogue network would answer to a staircase, exactly. Source: Yoerger, Cooke & Slotine
    1990, section V B: (s + 2.43) / (s + 6.5), for a time constant of 0.75 s at 1 V.

    Example:
        >>> lead = dft.control.Lead.of(dft.Thruster(), pole=20.0)
        >>> lead.pole, lead.states
        (20.0, {'lagged': 'N'})
    """

    states: ClassVar[Mapping[str, str]] = {"lagged": "N"}

    zero: float = parameter(2.43, "rad/s", bounds=(0, None))
    pole: float = parameter(6.5, "rad/s", bounds=(0, None))
    thrust_per_volt: float = parameter(21.6, "N/V", bounds=(0, None), fixed=True)

    def __call__(self, thrust: Array, s: Signals, kept: Kept, period: Array) -> tuple[Array, Kept]:
        """Yoerger et al. 1990, section V B."""
        lagged = kept["lagged"]
        ahead = thrust + (self.pole / self.zero - 1.0) * (thrust - lagged)
        # exact over a held sample, so that any rate of the controller will do
        followed = lagged - (thrust - lagged) * jnp.expm1(-self.pole * period)
        return ahead / self.thrust_per_volt, {"lagged": followed}


class PoleCancellation(Compensator):
    """Cancels the lag of the thruster with a zero that moves as the lag does.

        u* = u + (du/dt) / (rate sqrt(max(|u|, floor)))

    with u the wanted thrust [N]. This is the inverse of the thruster model: with
    rate = 2 alpha / sqrt(ct), u* / thrust_per_volt is the command under which the thrust is u at
    all times, but for the ``floor`` that keeps the lag's frequency away from zero. The rate of u
    is a backward difference through a low-pass of the time constant ``smoothing`` [s].

    Source: Yoerger, Cooke & Slotine 1990, section V C, whose 0.49 sqrt(u) goes with u in newtons
    (2 alpha / sqrt(ct) is 0.50 for alpha = 0.037, ct = 0.022); with u in volts it would be 2.5.

    Example:
        >>> cancelling = dft.control.PoleCancellation.of(dft.Thruster())
        >>> cancelling.states
        {'smoothed': 'N', 'begun': ''}
    """

    states: ClassVar[Mapping[str, str]] = {"smoothed": "N", "begun": ""}

    rate: float = parameter(0.49, "1/(s N^0.5)", bounds=(0, None))
    floor: float = parameter(1.0, "N", bounds=(0, None), fixed=True)
    smoothing: float = parameter(
        0.0, "s", bounds=(0, None), transform="linear", size=0.1, fixed=True
    )
    thrust_per_volt: float = parameter(21.6, "N/V", bounds=(0, None), fixed=True)

    @classmethod
    def _gains(cls, nominal: QuadraticLoad) -> dict[str, float]:
        return {**super()._gains(nominal), "rate": 2.0 * nominal.load / nominal.thrust_gain**0.5}

    def __call__(self, thrust: Array, s: Signals, kept: Kept, period: Array) -> tuple[Array, Kept]:
        """Yoerger et al. 1990, section V C."""
        growth, smoothed = rate_of(thrust, kept["smoothed"], kept["begun"], self.smoothing, period)
        fastness = self.rate * jnp.sqrt(jnp.maximum(jnp.abs(thrust), self.floor))
        command = (thrust + growth / fastness) / self.thrust_per_volt
        return command, {"smoothed": smoothed, "begun": jnp.ones(())}


class Sliding(Compensator):
    """Drives the propeller to the speed that gives the wanted thrust, robustly.

        sliding error  s = speed - wanted speed
        command = load speed |speed| + inertia d(wanted speed)/dt - gain sat(s / width)

    ``load`` and ``inertia`` are the estimates of alpha / beta and 1 / beta. ``gain`` [V] must
    exceed what they are wrong by; within the boundary layer |s| < ``width`` [rad/s] the error s
    behaves as a first-order lag of the frequency gain / (inertia width). The wanted speed is
    thrust / sqrt(thrust_coefficient (|thrust| + floor)): a square root whose slope stays finite
    where the thrust changes its sign. Its rate is a backward difference through a low-pass of the
    time constant ``smoothing`` [s]. The command is held within -limit and limit.

    Source: Yoerger, Cooke & Slotine 1990, section V D; the thruster takes 10 V (section II A).

    Example:
        >>> sliding = dft.control.Sliding.of(dft.Thruster(), gain=3.0, width=4.0)
        >>> sliding.gain
        3.0
    """

    reads: ClassVar[tuple[str, ...]] = ("speed",)
    states: ClassVar[Mapping[str, str]] = {
        "wanted_speed": "rad/s",
        "sliding_error": "rad/s",
        "smoothed": "rad/s",
        "begun": "",
    }

    load: float = parameter(0.037 / 42.0, "V s^2/rad^2", bounds=(0, None), transform="linear")
    inertia: float = parameter(1.0 / 42.0, "V s^2/rad", bounds=(0, None), transform="linear")
    thrust_coefficient: float = parameter(0.019, "N s^2/rad^2", bounds=(0, None), fixed=True)
    gain: float = parameter(3.0, "V", bounds=(0, None))
    width: float = parameter(4.0, "rad/s", bounds=(0, None))
    floor: float = parameter(1.0, "N", bounds=(0, None), fixed=True)
    smoothing: float = parameter(
        0.0, "s", bounds=(0, None), transform="linear", size=0.1, fixed=True
    )
    limit: float = parameter(math.inf, "V", bounds=(0, None), null=math.inf, fixed=True)

    @classmethod
    def _gains(cls, nominal: QuadraticLoad) -> dict[str, float]:
        return {
            "load": nominal.load / nominal.drive_gain,
            "inertia": 1.0 / nominal.drive_gain,
            "thrust_coefficient": nominal.thrust_gain,
        }

    def __call__(self, thrust: Array, s: Signals, kept: Kept, period: Array) -> tuple[Array, Kept]:
        """Yoerger et al. 1990, section V D."""
        free, memory, *_ = self._free(thrust, s, kept, period, self.load, self.inertia)
        return jnp.clip(free, -self.limit, self.limit), memory

    def _free(
        self,
        thrust: Array,
        s: Signals,
        kept: Kept,
        period: Array,
        load: Array | float,
        inertia: Array | float,
    ) -> tuple[Array, Kept, Array, Array]:
        """The command but for its limit, memory, and what the estimates are multiplied with."""
        speed = thrust / jnp.sqrt(self.thrust_coefficient * (jnp.abs(thrust) + self.floor))
        rate, smoothed = rate_of(speed, kept["smoothed"], kept["begun"], self.smoothing, period)
        error = s.speed - speed
        swept = s.speed * jnp.abs(s.speed)
        inside = jnp.clip(error / self.width, -1.0, 1.0)
        free = load * swept + inertia * rate - self.gain * inside
        memory = {
            "wanted_speed": speed,
            "sliding_error": error,
            "smoothed": smoothed,
            "begun": jnp.ones(()),
        }
        return free, memory, swept, rate


class AdaptiveSliding(Sliding):
    """Sliding control that learns the thruster while its error is outside the boundary layer.

        s_delta = s - width sat(s / width)
        d(load)/dt    = -load_rate    speed |speed|          s_delta
        d(inertia)/dt = -inertia_rate d(wanted speed)/dt     s_delta

    Inside the layer nothing is adapted, so the estimates do not drift, and a load that plain
    sliding bears there is never learned (``examples/papers_yoerger_adaptive.py``). Nor do they wind
    up where the command is at its ``limit``: there only what draws it back is learned. They begin
    at ``load`` and ``inertia``, zero unless given (`of` gives those of the thruster), and are
    recorded as ``load_estimate`` and ``inertia_estimate``.

    Source: Yoerger, Cooke & Slotine 1990, section V E; Slotine & Coetsee 1986.

    Example:
        >>> unknowing = dft.control.AdaptiveSliding(thrust_coefficient=0.019)
        >>> sorted(unknowing.start())
        ['inertia_estimate', 'load_estimate']
    """

    states: ClassVar[Mapping[str, str]] = {
        **Sliding.states,
        "load_estimate": "V s^2/rad^2",
        "inertia_estimate": "V s^2/rad",
    }

    load: float = parameter(0.0, "V s^2/rad^2", bounds=(0, None), size=1e-3)
    inertia: float = parameter(0.0, "V s^2/rad", bounds=(0, None), size=0.02)
    load_rate: float = parameter(2e-9, "V s^4/rad^5", bounds=(0, None), transform="log")
    inertia_rate: float = parameter(5e-6, "V s^4/rad^3", bounds=(0, None), transform="log")

    def start(self) -> Mapping[str, float]:
        """The estimates with which the run begins."""
        return {"load_estimate": self.load, "inertia_estimate": self.inertia}

    def __call__(self, thrust: Array, s: Signals, kept: Kept, period: Array) -> tuple[Array, Kept]:
        """Yoerger et al. 1990, section V E."""
        load, inertia = kept["load_estimate"], kept["inertia_estimate"]
        free, memory, swept, rate = self._free(thrust, s, kept, period, load, inertia)
        command = jnp.clip(free, -self.limit, self.limit)
        error = memory["sliding_error"]
        # a dead zone of adaptation: inside the layer the error is noise and unmodelled dynamics, by
        # which estimates would drift (Slotine & Coetsee 1986)
        outside = error - jnp.clip(error, -self.width, self.width)
        # both estimates move the command against the error: where that is away from the limit that
        # holds it, as at 30 V for a motor that takes 10, nothing is learned
        outside = jnp.where((free - command) * outside < 0, 0.0, outside)
        learned = {
            "load_estimate": load - period * self.load_rate * swept * outside,
            "inertia_estimate": inertia - period * self.inertia_rate * rate * outside,
        }
        return command, {**memory, **learned}
