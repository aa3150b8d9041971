"""One axis of a vehicle under thrust (Yoerger, Cooke and Slotine 1990, section V)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .integrate import Rotor, pieces, solve
from .records import Record

Array = np.ndarray

#: One axis of Jason Jr., section IV of the paper: kg and N s^2/m^2.
JASON_JR = {"mass": 340.0, "drag": 67.0}


def simulate(
    time: Array,
    thrust: Array,
    *,
    mass: float = JASON_JR["mass"],
    drag: float = JASON_JR["drag"],
    friction: float = 0.0,
    disturbance: Array | None = None,
    initial_position: float = 0.0,
    initial_velocity: float = 0.0,
    hold: str = "zero",
    method: str = "dop853",
    substeps: int = 8,
) -> Record:
    """Solve M x'' = T - CD x'|x'| - friction sign(x') for a thrust series [N].

    ``friction`` [N] is dry (a guided rig), ``disturbance`` [N] adds to the thrust. The record
    holds ``position`` [m] and ``velocity`` [m/s].
    """
    time = np.asarray(time, float)
    thrust = np.asarray(thrust, float)
    extra = np.zeros(len(time)) if disturbance is None else np.asarray(disturbance, float)
    segments = pieces(time, [(time, thrust), (time, extra)], hold)

    def rates(t: float, x: Sequence[float], u: Sequence[float], direction: int) -> list[float]:
        force = u[0] + u[1] - drag * x[1] * abs(x[1]) - friction * direction
        return [x[1], force / mass if direction else 0.0]

    rotor = Rotor(1, lambda t, x, u: u[0] + u[1], friction)
    start = [initial_position, initial_velocity]
    states = solve(rates, segments, time, start, rotor=rotor, method=method, substeps=substeps)
    truth = {"position": states[:, 0].copy(), "velocity": states[:, 1].copy()}
    parameters = {"mass": mass, "drag": drag, "friction": friction}
    return Record(time, {"thrust": thrust}, dict(truth), truth, parameters)
