"""Long runs of a small vessel under gusts: over which horizon should its model be fitted?

    train, unseen, model = gusty.drawn(seed)

Runs of 200 s at 2 Hz by the reference simulator. Gusts push at all three degrees of freedom with a
memory of seconds, sensors are noisy, and the basic model lacks nothing but the gusts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from reference import noise, vessel

import diffthrust as dft

from . import excitation

STEP, LENGTH = 0.5, 200.0
MEASURED = ("surge", "sway", "yaw_rate")
#: Boats slower than that of the bench: inertias as if they were so many times as heavy.
HEAVIER = 4.0


class Gusty(NamedTuple):
    """Training runs, unseen ones, and the basic model at values some 20 % off."""

    train: tuple[dft.Log, ...]
    unseen: tuple[dft.Log, ...]
    model: dft.Model


def drawn(seed: int, gust: float = 0.1, train: int = 3, unseen: int = 2) -> Gusty:
    """Runs of one boat.

    Args:
        seed: of boat, experiments, gusts and sensors.
        gust: standard deviation of the gusts, as a share of the largest thrust and its moment.
        train: number of training runs.
        unseen: number of unseen ones.
    """
    rng = np.random.default_rng([1913, seed])
    boat = {name: value * 1.3 ** rng.uniform(-1, 1) for name, value in vessel.SIRAMDASU.items()}
    boat |= {name: HEAVIER * boat[name] for name in ("m11", "m22", "i33")}
    memory = rng.uniform(2.0, 15.0)
    logs = [run(rng, boat, gust, memory, f"run {k + 1}") for k in range(train + unseen)]
    off = {
        name: value * np.exp(0.2 * rng.standard_normal())
        for name, value in boat.items()
        if name != "lever_arm"
    }
    model = dft.Vessel(**off).replace(lever_arm=boat["lever_arm"])
    return Gusty(tuple(logs[:train]), tuple(logs[train:]), model)


def run(
    rng: np.random.Generator, boat: dict[str, float], gust: float, memory: float, name: str
) -> dft.Log:
    """One run under gusts [ratio to A] with a memory [s]."""
    time = STEP * np.arange(int(LENGTH / STEP) + 1)
    inputs = excitation.propeller(rng, time)
    force = 98.0 ** boat["exponent"]
    turning = 0.4 * boat["lever_arm"] * force
    sizes = gust * np.array([force, 0.5 * force, turning])
    gusts = np.array([noise.ornstein_uhlenbeck(rng, time, size, memory) for size in sizes]).T
    record = vessel.simulate(
        time, inputs, parameters=boat, disturbance=gusts, method="rk4", substeps=4
    )
    speed = force / boat["d11"]
    ranges = {"surge": speed, "sway": 0.4 * speed, "yaw_rate": turning / boat["d33"]}
    read = {
        channel: record.measured[channel] + noise.white(rng, len(time), 0.01 * most)
        for channel, most in ranges.items()
    }
    return dft.Log(time, inputs, read, name=name)
