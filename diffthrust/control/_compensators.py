"""Compensators of the thruster's lag, in series behind a position controller.

All turn the thrust that is wanted [N] into the command [V]. Their nominal values are those of the
thruster that the designer believes in, which need not be the one in the loop.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Self

import jax.numpy as jnp
from jaxtyping import Array

from diffthrust._support.errors import InputError
from diffthrust.control._base import Block, Kept, rate_of
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
