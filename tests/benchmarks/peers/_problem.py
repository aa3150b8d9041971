"""The problem that all solve: a thruster with a held command and two noisy sensors. NumPy alone."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

TRUTH = (0.037, 42.0, 0.019)
"""alpha, beta and ct of the thruster."""
GUESS = (0.03, 35.0, 0.015)
NOISE = {"speed": 0.3, "thrust": 0.5}
STEP = 0.01
SAMPLES = 1000
"""In each of many logs."""
STARTS = 16
WALKERS, WARMUP, DRAWS = 32, 200, 400
"""Of a posterior; walkers times steps are the evaluations of the likelihood."""


class Record(NamedTuple):
    """What was recorded, ``(n,)`` each."""

    time: np.ndarray
    command: np.ndarray
    speed: np.ndarray
    thrust: np.ndarray


def rk4(w: Any, command: tuple[Any, Any, Any], alpha: Any, beta: Any, h: Any) -> Any:
    """One step of the speed; the command at its begin, middle and end. For any kind of number."""
    k1 = beta * command[0] - alpha * w * abs(w)
    y = w + 0.5 * h * k1
    k2 = beta * command[1] - alpha * y * abs(y)
    y = w + 0.5 * h * k2
    k3 = beta * command[1] - alpha * y * abs(y)
    y = w + h * k3
    k4 = beta * command[2] - alpha * y * abs(y)
    return w + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def record(samples: int, seed: int = 0, spread: float = 0.0) -> Record:
    """A log with white sensor noise; the thruster's parameters lie ``spread`` about the truth."""
    rng = np.random.default_rng(seed)
    time = STEP * np.arange(samples)
    command = 1.5 * np.sin(np.cumsum(0.05 * rng.normal(size=samples)))
    noise = rng.normal(size=(2, samples))
    alpha, beta, ct = np.asarray(TRUTH) * np.exp(spread * rng.normal(size=3))
    speed = [0.0]
    for c in command[:-1].tolist():
        speed.append(rk4(speed[-1], (c, c, c), alpha, beta, STEP))
    clean = np.array(speed)
    thrust = ct * clean * np.abs(clean)
    return Record(
        time, command, clean + NOISE["speed"] * noise[0], thrust + NOISE["thrust"] * noise[1]
    )


def many_records(count: int) -> list[Record]:
    """Logs of as many thrusters."""
    return [record(SAMPLES, seed, spread=0.15) for seed in range(count)]


def guesses(starts: int) -> np.ndarray:
    """The first guess, and others about it, a decade to either side, ``(starts, 3)``."""
    away = 10.0 ** np.random.default_rng(0).uniform(-1.0, 1.0, (starts, 3))
    away[0] = 1.0
    return np.asarray(GUESS) * away


def grids(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Amplitudes [V] and frequencies [rad/s] of a square map."""
    side = round(points**0.5)
    return np.geomspace(0.05, 10.0, side), np.geomspace(0.1, 30.0, side)
