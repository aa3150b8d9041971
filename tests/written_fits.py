"""Fits to logs that a user writes in us, rpm and kgf; the numbers are efforts, rad/s and N."""

from __future__ import annotations

from functools import cache

import numpy as np

import diffthrust as dft
from diffthrust.effects import CommandDeadband
from diffthrust.logs import PWM, Written

RPM, KGF, WIDTH = 60 / (2 * np.pi), 1 / 9.80665, 400.0
"""What one rad/s, one N and one full effort are to the user."""
TRUTH = dft.SpeedLoopThruster(gain=330.0, time_constant=0.15, ct=4.5e-4) + CommandDeadband(
    half_width=0.0625
)
WRITTEN = {
    "command": Written("us", "pwm", PWM(1500.0, 1900.0)),
    "speed": Written("rpm", "rpm"),
    "thrust": Written("kgf", "load"),
}


@cache
def log(seed: int = 0) -> dft.Log:
    """A staircase of efforts, 12 s at 50 Hz, with noise."""
    rng = np.random.default_rng(seed)
    command = np.repeat(rng.uniform(-0.9, 0.9, 15), 40)
    units = {"command": "effort", "speed": "rad/s", "thrust": "N"}
    plain = dft.Log(0.02 * np.arange(command.size), {"command": command})
    out = dft.simulate(TRUTH, plain.replaced(units={"command": "effort"}))
    measured = {
        name: out[name] + level * rng.standard_normal(command.size)
        for name, level in (("speed", 2.0), ("thrust", 0.5))
    }
    return dft.Log(plain.time, plain.inputs, measured, units=units, written=WRITTEN)


@cache
def fit(deadband: bool = True) -> dft.estimation.Fit:
    """The thruster behind its controller, with the dead band or without."""
    model = dft.SpeedLoopThruster()
    return dft.fit(model + CommandDeadband() if deadband else model, log(), starts=1)
