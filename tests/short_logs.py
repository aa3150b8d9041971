"""Short logs of a thruster with noise of a given kind, and fits of them that share compilations."""

from functools import cache

import numpy as np
from reference import inputs, noise, thruster

import diffthrust as dft

TRUE = {"alpha": 0.037, "beta": 42.0, "ct": 0.02}
MODEL = dft.Thruster(**TRUE)
LEVELS = {"speed": 0.3, "thrust": 0.5}


class TwiceTheSame(dft.Effect):
    """A gain on the drive: the same as beta."""

    name = "drive_gain"
    port = "drive"
    gain: float = dft.parameter(1.0, bounds=(0, None))

    def __call__(self, value, s):
        return self.gain * value


@cache
def clean(count):
    """A staircase and a chirp at 20 Hz, without noise; simulated by the reference once."""
    time = inputs.grid((count - 1) * 0.05, 0.05)
    levels = [1.0, -1.2, 1.6, -0.7, 0.4, -1.8, 1.2, 0.2] * (1 + count // 400)
    chirp = 0.5 * np.sin(2 * np.pi * (0.1 + 0.03 * (time % 20.0)) * (time % 20.0))
    command = inputs.staircase(time, levels, 2.5) + chirp
    return thruster.simulate(time, command, **TRUE, method="rk4")


def made_log(seed, count=400, correlation=0.0, law="normal", **kwargs):
    """A log with noise of a given correlation from sample to sample, or Student's t of 4."""
    made = clean(count)
    rng = np.random.default_rng(seed)
    measured = {}
    for name, level in LEVELS.items():
        if law == "student_t":
            error = level * rng.standard_t(4, count)
        else:
            error = noise.ar1(rng, count, level, correlation)
        measured[name] = made.truth[name] + error
    return dft.Log(time=made.time, inputs=dict(made.inputs), measured=measured, **kwargs)


def fitted(log, **kwargs):
    """A fit from the truth: one start, milliseconds after the first."""
    return dft.fit(MODEL, log, starts=1, **kwargs)
