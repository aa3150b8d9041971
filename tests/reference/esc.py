"""A bench log as a stranger has it, simulated without the package: PWM, rpm and kgf in a CSV.

A motor controller holds the speed of a propeller: it ignores 25 us about the stop, and the speed
follows a straight line in what is left of the pulse as a first-order lag, exactly between samples.
The propeller pulls 0.8 times as hard astern. Run as ``python -m reference.esc FOLDER`` it writes
the logs of ``examples/bench``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

STOP, FULL, BAND = 1500.0, 1900.0, 25.0
TOP, LAG, THRUST, ASTERN = 330.0, 0.15, 4.5e-4, 0.8
"""Speed at full effort [rad/s], time constant [s], thrust per speed squared, its share astern."""


def run(seed: int, samples: int = 1500, step: float = 0.05, jumps: bool = False) -> np.ndarray:
    """Time [ms], pulses [us], speed [rpm] and thrust [kgf], ``(samples, 4)``, with sensor noise.

    Args:
        seed: of levels and noise.
        samples: how many.
        step: between them [s].
        jumps: beyond the dead band the full pulse counts, not what is left of it.
    """
    rng = np.random.default_rng(seed)
    time = step * np.arange(samples)
    levels = np.repeat(rng.uniform(-1, 1, samples // 30 + 1), 30)[:samples]
    swing = 0.65 * levels + 0.25 * np.sin(2 * np.pi * 0.13 * time)
    pulses = np.clip(np.round(STOP + (FULL - STOP) * swing), 1100, 1900)
    beyond = pulses - STOP
    left = beyond if jumps else beyond - BAND * np.sign(beyond)
    target = TOP * np.where(np.abs(beyond) < BAND, 0.0, left) / (FULL - STOP)
    speed, keep = np.zeros(samples), np.exp(-step / LAG)
    for i in range(samples - 1):
        speed[i + 1] = target[i] + keep * (speed[i] - target[i])
    thrust = THRUST * speed * np.abs(speed) * np.where(speed < 0, ASTERN, 1.0)
    noise = rng.standard_normal((2, samples))
    rpm = 60 / (2 * np.pi) * speed + 20 * noise[0]
    kgf = thrust / 9.80665 + 0.05 * noise[1]
    return np.column_stack([1000 * time, pulses, rpm, kgf])


def write(path: Path, rows: np.ndarray) -> Path:
    """One run as a CSV file."""
    head = {"delimiter": ",", "header": "t_ms,pwm,rpm,thrust_kgf", "comments": ""}
    np.savetxt(path, rows, fmt=["%.0f", "%.0f", "%.0f", "%.3f"], **head)
    return path


if __name__ == "__main__":
    for number in (1, 2, 3):
        write(Path(sys.argv[1]) / f"run{number}.csv", run(seed=number))
