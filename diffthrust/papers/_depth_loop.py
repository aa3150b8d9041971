"""A depth loop in time: the printed transfer function as a model, between sensor and motor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from diffthrust.control import PID, Loop
from diffthrust.models._base.effect import Effect, Ports
from diffthrust.models._base.model import Model
from diffthrust.models._base.parameter import parameter
from diffthrust.models._base.signals import RatesAndOutputs, Signal, Signals

SUPPLY = 13.0
"""Voltage of the open-loop record [V]."""
_SAMPLING = 1000.0
"""Of the paper's controller [Hz], section 4.2."""


class DepthPlant(Model):
    """From the thruster's voltage to the depth sensor's: a transfer function of the second order.

        reading = surface + (s1 s + s0) / (s^2 + p1 s + p0) command

    The defaults are the printed G(s), and 1.848 V, the printed reading in air. It is a model like
    any other: the open-loop record can be fitted, and a loop closed around it.

    Source: Aras et al. 2013, equation 12 and section 4.2.

    Example:
        >>> plant = dft.papers.aras.DepthPlant()
        >>> plant.inputs, plant.outputs
        ({'command': 'V'}, {'reading': 'V'})
    """

    name = "depth_plant"
    inputs: ClassVar[Mapping[str, str]] = {"command": "V"}
    states: ClassVar[Mapping[str, str]] = {"slow": "V s^2", "fast": "V s"}
    outputs: ClassVar[Mapping[str, str]] = {"reading": "V"}
    ports: ClassVar[Mapping[str, str]] = {"drive": "voltage at the thruster [V]"}
    # poles at 0.37 and 44.7 1/s: the fast one sets the step
    time_scales: ClassVar[tuple[float, float]] = (0.005, 10.0)

    s1: float = parameter(-28.77, "1/s", size=10.0)
    s0: float = parameter(16.28, "1/s^2", size=10.0)
    p1: float = parameter(45.09, "1/s", bounds=(0, None))
    p0: float = parameter(16.33, "1/s^2", bounds=(0, None))
    surface: float = parameter(1.848, "V", size=1.0, doc="at the surface")

    def equations(self, s: Signals, port: Ports) -> RatesAndOutputs:
        """Equation 12 in its controllable form."""
        drive = port("drive", s.command)
        rates = {"slow": s.fast, "fast": drive - self.p1 * s.fast - self.p0 * s.slow}
        return rates, {"reading": self.surface + self.s0 * s.slow + self.s1 * s.fast}


class SensorRange(Effect):
    """The depth sensor ends where its range does.

    Acts on the reported reading [V], which stays within low and high. Null: low and high infinite.
    Source: Aras et al. 2013, table 2: 0.2 V at 20 kPa to 4.9 V at 250 kPa.

    Example:
        >>> model = dft.papers.aras.DepthPlant() + dft.papers.aras.SensorRange()
        >>> print(model)
        depth_plant + sensor_range
    """

    name = "sensor_range"
    port = "reading"
    low: float = parameter(0.2, "V", null=-math.inf, size=1.0, fixed=True)
    high: float = parameter(4.9, "V", null=math.inf, size=1.0, fixed=True)

    def __call__(self, value: Signal, s: Signals) -> Signal:
        """The reading within the range."""
        return jnp.clip(value, self.low, self.high)


def depth_loop(gain: float = 1.0, *, limit: float = SUPPLY) -> Loop:
    """The depth loop of section 6.2 in time: proportional, with the ranges of sensor and motor.

    The set point is a reading of the sensor [V]; the thruster turns both ways. At rest a gain of
    1 leaves half of the way from the surface, and a set point beyond the sensor's range leaves the
    loop blind: the reading stays at its end, whatever the depth.

    Args:
        gain: volts at the thruster by volts of the sensor.
        limit: largest voltage [V]; the supply's, as the paper prints none.

    Example:
        >>> run = dft.papers.aras.depth_loop().simulate(dft.control.Step(3.0), 10.0)
        >>> round(float(run["measured.reading"][-1]), 2)
        2.42
    """
    controller = PID(of="reading", kp=gain, limit=limit)
    return Loop(thruster=DepthPlant() + SensorRange(), controller=controller, rate=_SAMPLING)
