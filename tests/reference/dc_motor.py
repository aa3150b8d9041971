"""The DC-motor thruster of Aras et al. 2013.

V = R I + L dI/dt + ke w
J dw/dt = km I - b w - friction sign(w) - kq w|w|
T = kt0 w + kt w|w|
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from .integrate import Rotor, pieces, solve
from .records import Record

Array = np.ndarray

#: Motor constants of the paper in SI, where km = ke. The propeller's kq, kt0 and kt are not
#: printed: plausible ones, near 370 rad/s and 7 N at 13 V.
ARAS = {
    "resistance": 2.5604031,
    "inductance": 0.0046909,
    "ke": 0.0182595,
    "km": 0.0182595,
    "inertia": 7.2019e-5,
    "viscous": 9.1358e-5,
    "friction": 0.00033109,
    "kq": 1.0e-7,
    "kt0": 0.0,
    "kt": 5.0e-5,
}


def simulate(
    time: Array,
    voltage: Array,
    *,
    parameters: Mapping[str, float] = ARAS,
    disturbance: Array | None = None,
    hold: str = "zero",
    method: str = "dop853",
    substeps: int = 16,
) -> Record:
    """Run the motor from rest under a voltage series [V].

    ``disturbance`` is a torque [N m]. The record holds ``current`` [A], ``speed`` [rad/s] and
    ``thrust`` [N].
    """
    time = np.asarray(time, float)
    voltage = np.asarray(voltage, float)
    extra = np.zeros(len(time)) if disturbance is None else np.asarray(disturbance, float)
    segments = pieces(time, [(time, voltage), (time, extra)], hold)
    p = {**ARAS, **parameters}

    def rates(t: float, x: Sequence[float], u: Sequence[float], direction: int) -> list[float]:
        current, speed = x
        torque = p["km"] * current + u[1] - p["viscous"] * speed - p["friction"] * direction
        torque -= p["kq"] * speed * abs(speed)
        electric = (u[0] - p["resistance"] * current - p["ke"] * speed) / p["inductance"]
        return [electric, torque / p["inertia"] if direction else 0.0]

    rotor = Rotor(1, lambda t, x, u: p["km"] * x[0] + u[1], p["friction"])
    states = solve(rates, segments, time, [0.0, 0.0], rotor=rotor, method=method, substeps=substeps)
    current, speed = states.T.copy()
    thrust = p["kt0"] * speed + p["kt"] * speed * np.abs(speed)
    truth = {"current": current, "speed": speed, "thrust": thrust}
    return Record(time, {"voltage": voltage}, dict(truth), truth, p)
