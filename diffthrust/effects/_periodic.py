"""A force that is periodic in time, whatever the model does: waves, a blade, a pump."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import jax.numpy as jnp

from diffthrust._support.words import number
from diffthrust.models._base.component import registered
from diffthrust.models._base.made_effect import MadeEffect
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.signals import Rate, Signal, Signals

_NEARBY = 0.02
"""The size of a change of the frequency, as a share of it: over more than a cycle or two of a log a
fit that starts farther off finds another of the likelihood's many maxima."""


@registered
class PeriodicForce(MadeEffect):
    """A force of one frequency, shared by all logs; how large it is and its phase differ by log.

    Acts on the signal of any port inside a model: with the phase 2 pi frequency t since the log
    began, ``value + amplitude * (sine * sin(phase) + cosine * cos(phase))``. ``sine`` and
    ``cosine`` are states that do not change: where they begin a fit estimates for each log
    (`Fit.initial`), and `compare` from each unseen log, as of any state that no sensor tells of. So
    in an unseen log only the frequency is a prediction, and two numbers are that log's own. The
    amplitude is the unit of both and is held. Null: amplitude = 0.
    Source: Fossen 2011, section 8.2: waves of one frequency.

    Args:
        port: where it acts.
        frequency: [Hz].
        amplitude: of a log whose ``sine`` and ``cosine`` have the length 1.
        unit: of the amplitude, that of the port.
        name: by which the model knows it.

    Raises:
        InputError: a name or a port that is none, or a frequency that is not positive.

    Example:
        >>> waves = dft.effects.PeriodicForce("shaft", 0.7, 25.0, unit="rad/s^2")
        >>> model = dft.Thruster() + waves
        >>> model.parameters["periodic_force.frequency"].range_text()
        '[0, inf) Hz'
        >>> log = dft.Log([0.0, 0.1, 0.2], {"command": [0.0, 0.0, 0.0]})
        >>> swung = dft.simulate(model, log, initial={"periodic_force.sine": 0.0})
    """

    name = "periodic_force"
    main = "port"
    states = {"phase": "rad", "sine": "", "cosine": ""}
    free_starts = ("sine", "cosine")
    unit: str
    frequency: float
    amplitude: float

    def __init__(
        self,
        /,
        port: str,
        frequency: float = 1.0,
        amplitude: float = 1.0,
        *,
        unit: str = "",
        name: str = "periodic_force",
    ) -> None:
        size = _NEARBY * frequency if frequency > 0 else None
        declared = {
            "frequency": parameter(frequency, "Hz", bounds=(0, None), size=size),
            "amplitude": parameter(
                amplitude, unit, bounds=(0, None), null=0.0, size=amplitude or 1.0, fixed=True
            ),
        }
        self._set(unit=unit)
        self._make(name, port, declared)

    def __call__(self, value: Signal, s: Signals) -> Signal:
        swing = s.sine * jnp.sin(s.phase) + s.cosine * jnp.cos(s.phase)
        return value + self.amplitude * swing

    def rates(self, value: Signal, s: Signals) -> Mapping[str, Rate]:
        """The phase goes on evenly, which is integrated exactly however few the samples a cycle."""
        still = 0.0 * s.phase
        return {"phase": still + 2.0 * math.pi * self.frequency, "sine": still, "cosine": still}

    def initial(self, value: Signal, s: Signals) -> Mapping[str, Signal | float]:
        """A sine from the beginning of the log, where nothing else is known."""
        return {"phase": 0.0, "sine": 1.0, "cosine": 0.0}

    def size_words(self, starts: Sequence[Mapping[str, float]]) -> str:
        """Its amplitude in the logs: of all, or the smallest and the largest."""
        sizes = [self.amplitude * math.hypot(s["sine"], s["cosine"]) for s in starts]
        low, high = (number(size, 2) for size in (min(sizes), max(sizes)))
        return f"amplitude {low if low == high else f'{low} to {high}'} {self.unit}".rstrip()

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments that make it again, its parameters at their present values.

        Example:
            >>> dft.effects.PeriodicForce("shaft", 0.7).arguments["frequency"]
            0.7
        """
        values = {"frequency": self.frequency, "amplitude": self.amplitude}
        return {**super().arguments, **values}
