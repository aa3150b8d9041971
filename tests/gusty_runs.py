"""Long runs of vessels under gusts, with and without an effect that the model lacks."""

from __future__ import annotations

import numpy as np
from hidden import excitation
from reference import inputs, noise, vessel

import diffthrust as dft

MISSING = {"nothing": (0.0, 0), "quadratic_surge_drag": (2.0, 0), "quadratic_yaw_drag": (4.0, 3)}
"""What the model lacks: its size for the small vessel of the reference, and by which power of the
vessel's length it grows."""
POWERS = {"m11": 1, "m22": 1, "i33": 3, "d33": 2, "lever_arm": 1}
"""Of the length: at equal speeds a vessel so many times as long takes so many times as long to
answer."""


def model_of(length: float) -> dft.Model:
    """The vessel without what is missing, with values that are some way off."""
    true = {n: v * length ** POWERS.get(n, 0) for n, v in vessel.SIRAMDASU.items()}
    off = {n: v * (1.0 if n in ("lever_arm", "exponent") else 1.3) for n, v in true.items()}
    return dft.Vessel(**off)


def gusty_runs(
    seed: int, missing: str, length: float, memory: float, share: float, count: int = 6
) -> list[dft.Log]:
    """Runs of 200 s at 2 Hz.

    Args:
        seed: of inputs, gusts and sensors.
        missing: one of `MISSING`.
        length: of the vessel, over that of the small one of the reference.
        memory: of the gusts [s].
        share: their standard deviation over the propeller's force, and its moment at 0.4 rad.
        count: of runs.
    """
    rng = np.random.default_rng(seed)
    time = inputs.grid(200.0, 0.5)
    true = {n: v * length ** POWERS.get(n, 0) for n, v in vessel.SIRAMDASU.items()}
    force = share * 98.0 ** true["exponent"]
    size, power = MISSING[missing]
    std = {"surge": 0.02, "sway": 0.02, "yaw_rate": 0.01 / length}
    logs = []
    for i in range(count):
        pushes = (force, force, 0.4 * true["lever_arm"] * force)
        gusts = [noise.ornstein_uhlenbeck(rng, time, push, memory) for push in pushes]
        made = vessel.simulate(
            time,
            excitation.propeller(rng, time / length),
            parameters=true,
            disturbance=np.array(gusts).T,
            method="rk4",
            **({missing: size * length**power} if size else {}),
        )
        made = noise.measure(made, rng, **{n: noise.Sensor(std=s) for n, s in std.items()})
        measured = {name: made.measured[name] for name in std}
        logs.append(dft.Log(made.time, dict(made.inputs), measured, name=f"run {i + 1}"))
    return logs
