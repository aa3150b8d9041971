"""Logs as strangers write them: a thruster and a boat, simulated outside the package."""

from pathlib import Path

import numpy as np

STEP = 0.02
ALPHA, BETA, CT = 0.05, 2500.0, 4e-4
"""The thruster's: 1/rad, rad/s^2 per full effort, N s^2/rad^2."""


def staircase(seed, size=1500, low=-1.0, high=1.0, held=50):
    """Levels at random, the first of them rest."""
    levels = np.random.default_rng(seed).uniform(low, high, size // held)
    levels[0] = 0.0
    return np.repeat(levels, held)


def thruster(seed=1):
    """Columns of a bench: time [s], effort, speed [rad/s], thrust [N], with noise."""
    rng = np.random.default_rng(seed)
    effort = np.round(400 * staircase(seed)) / 400
    speed = np.zeros(effort.size)
    for k, u in enumerate(effort[:-1]):
        x = speed[k]
        for _ in range(20):
            x += STEP / 20 * (BETA * u - ALPHA * x * abs(x))
        speed[k + 1] = x
    thrust = CT * speed * abs(speed)
    return {
        "time": STEP * np.arange(effort.size),
        "effort": effort,
        "speed": speed + rng.normal(0, 0.3, effort.size),
        "thrust": thrust + rng.normal(0, 0.1, effort.size),
    }


def boat(seed=1):
    """Columns of a boat with two thrusters: time, efforts, surge, yaw rate [rad/s], heading."""
    left, right = (staircase(seed + k, low=-0.2) for k in (10, 20))
    surge, turn, heading = np.zeros((3, left.size))
    for k in range(left.size - 1):
        surge[k + 1] = surge[k] + STEP * (30 * (left[k] + right[k]) - 12 * surge[k]) / 20
        turn[k + 1] = turn[k] + STEP * (9 * (left[k] - right[k]) - 5 * turn[k]) / 3
        heading[k + 1] = heading[k] + STEP * turn[k]
    rng = np.random.default_rng(seed)
    return {
        "time": STEP * np.arange(left.size),
        "left": left,
        "right": right,
        "surge": surge + rng.normal(0, 0.01, left.size),
        "yaw_rate": turn + rng.normal(0, 0.005, left.size),
        "heading": np.degrees(heading) % 360,
    }


def write_table(path: Path, columns, separator=",", decimal="."):
    """Write columns of numbers or texts under a header."""

    def cell(value):
        return value if isinstance(value, str) else f"{value:.14g}".replace(".", decimal)

    rows = [separator.join(map(cell, row)) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join([separator.join(columns), *rows]) + "\n", encoding="utf-8")
    return path
