"""The static map of a thruster by a plain least squares: settled speed and thrust, no time.

    alpha w |w| (|w| / 40)^(exponent - 2) + damping w = beta deadband(u) (1 + share (V / 24 - 1))
    thrust = ct w |w|, times 1 + change where w < 0

Noise levels are estimated, so that the sum of the logarithms of both mean squares is minimised.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

ALPHA, REFERENCE, NOMINAL = 0.1, 40.0, 24.0
START = {"beta": 300.0, "ct": 3.7e-4, "share": 0.8, "band": 0.7}
FURTHER = {"exponent": 1.4, "damping": 40.0, "change": -0.2, "limit": 15.0}
"""Where the sizes that not every law has begin."""


class Points(NamedTuple):
    """Rows of maps: command and supply [V], measured speed [rad/s] and thrust [N]."""

    command: np.ndarray
    supply: np.ndarray
    speed: np.ndarray
    thrust: np.ndarray


def settled(points: Points, size: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Speed and thrust at every row; ``damping`` and another ``exponent`` exclude each other."""
    u = np.clip(points.command, -size.get("limit", np.inf), size.get("limit", np.inf))
    push = np.maximum(np.abs(u) - abs(size["band"]), 0.0)
    push *= size["beta"] * (1.0 + size["share"] * (points.supply / NOMINAL - 1.0))
    if "damping" in size:
        rate = size["damping"]
        w = (np.sqrt(rate**2 + 4.0 * ALPHA * np.abs(push)) - rate) / (2.0 * ALPHA)
    else:
        power = size.get("exponent", 2.0)
        w = (np.abs(push) / ALPHA * REFERENCE ** (power - 2.0)) ** (1.0 / power)
    w = np.sign(u) * w
    return w, size["ct"] * w * np.abs(w) * np.where(w < 0, 1.0 + size.get("change", 0.0), 1.0)


def errors(points: Points, size: Mapping[str, float]) -> np.ndarray:
    """Root mean squares of both channels."""
    w, thrust = settled(points, size)
    return np.sqrt([np.mean((points.speed - w) ** 2), np.mean((points.thrust - thrust) ** 2)])


def fitted(points: Points, further: Sequence[str]) -> dict[str, float]:
    """The likeliest sizes of a law, from several starts."""
    begin = {**START, **{name: FURTHER[name] for name in further}}
    names = list(begin)
    scale = np.array([begin[name] for name in names])

    def cost(z: np.ndarray) -> float:
        return float(np.sum(np.log(errors(points, dict(zip(names, z * scale, strict=True))))))

    options = {"maxiter": 8000, "maxfev": 8000, "xatol": 1e-7, "fatol": 1e-10, "adaptive": True}
    ends = [
        minimize(cost, np.where(scale == begin["beta"], drive, 1.0), method="Nelder-Mead",
                 options=options)
        for drive in (0.7, 1.4, 7.0)
    ]  # fmt: skip
    return dict(zip(names, min(ends, key=lambda end: end.fun).x * scale, strict=True))
