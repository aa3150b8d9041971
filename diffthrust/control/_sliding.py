"""Sliding control of the propeller's speed, with fixed and with adapted estimates."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from diffthrust.control._base import Kept, rate_of
from diffthrust.control._compensators import Compensator
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.quadratic_load import QuadraticLoad
from diffthrust.models._base.signals import Signals


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
