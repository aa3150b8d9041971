"""Made logs with sensors that repeat their last reading, and without; how often each is said to.

Run as ``python -m soundness.held 400`` from ``tests``; prints the shares by kind.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator

import numpy as np
from reference import inputs, noise, thruster

import diffthrust as dft

from .railed import KINDS, command, made


def arriving(
    rng: np.random.Generator, time: np.ndarray, shortest: float, longest: float
) -> np.ndarray:
    """Places of the readings of a sensor whose readings come at random times."""
    waits = rng.uniform(shortest, longest, int(time[-1] / shortest) + 2)
    return np.unique(np.searchsorted(time, np.cumsum(waits) - rng.uniform(0, shortest))).astype(int)


def repeated(values: np.ndarray, read: np.ndarray) -> np.ndarray:
    """What a log has of a channel that keeps its last reading; the first sample is one."""
    read = np.append(0, read[(read > 0) & (read < values.size)])
    return values[read[np.searchsorted(read, np.arange(values.size), side="right") - 1]]


def sound(count: int, seed: int) -> Iterator[tuple[str, dft.Log]]:
    """Logs whose sensors are read at every sample, each with what might pass for a hold.

    Resolutions from fine to a few levels; no noise; a range that ends; sensors that read nothing
    below a least speed; thrusters that rest, settle, follow steps within a sample or are at their
    limit; channels that only repeat what is demanded.
    """
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        step = float(rng.choice([0.01, 0.02, 0.05, 0.1]))
        time = inputs.grid(rng.uniform(300, 900) * step, step)
        kind = str(rng.choice(KINDS))
        drive = command(rng, time, kind)
        drive = noise.quantise(drive, float(rng.choice([0.0, 0.01, 0.1])))
        truth = thruster.simulate(time, drive, method="rk4", substeps=2).truth
        speed, thrust = truth["speed"], truth["thrust"]
        trait = str(
            rng.choice(["quantized", "saturated", "rests", "limited", "fast", "demand", "noisy"])
        )
        quantum = float(rng.choice([0.0, 0.05, 0.5, 1.0, 5.0]))
        std = float(rng.choice([0.0, 0.0, 0.05, 0.5, 2.0]))
        if trait == "saturated":
            speed, thrust = (np.clip(v, *np.quantile(v, (0.3, 0.7))) for v in (speed, thrust))
        elif trait == "rests":
            least = np.quantile(np.abs(speed), 0.7)
            speed, thrust = (np.where(np.abs(speed) < least, 0.0, v) for v in (speed, thrust))
        elif trait == "limited":
            speed, thrust = (np.minimum(v, np.quantile(v, 0.4)) for v in (speed, thrust))
        elif trait == "fast":
            speed, thrust = 40 * drive, 5 * drive * np.abs(drive)
        elif trait == "demand":
            speed, std = inputs.staircase(time, rng.uniform(-60, 60, 30), time[-1] / 29), 0.0
            thrust = 0.01 * speed * np.abs(speed)
            drive = speed / 40
        read = [noise.Sensor(std=std, quantum=quantum).read(rng, v) for v in (speed, thrust)]
        if trait == "rests":
            read = [np.where(v == 0, 0.0, x) for v, x in zip((speed, thrust), read, strict=True)]
        yield f"{trait}, quantum {quantum:g}, noise {std:g}, {kind}", made(time, drive, *read)


def held(count: int, seed: int) -> Iterator[tuple[dft.Log, np.ndarray]]:
    """Logs whose speed comes at irregular times and repeats in between, and where it is read."""
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        time = inputs.grid(rng.uniform(30.0, 90.0), float(rng.choice([0.03, 0.05, 0.1])))
        drive = command(rng, time, str(rng.choice(["random", "multisine", "stairs"])))
        truth = thruster.simulate(time, drive, method="rk4", substeps=3).truth
        sensor = noise.Sensor(std=float(rng.choice([0.05, 0.5])), quantum=rng.choice([0.0, 0.1]))
        speed, thrust = sensor.read(rng, truth["speed"]), truth["thrust"]
        shortest = float(rng.uniform(0.3, 1.0))
        read = arriving(rng, time, shortest, shortest * rng.uniform(1.5, 4.0))
        noisy = thrust + noise.white(rng, time.size, 0.3)
        yield made(time, drive, repeated(speed, read), noisy), read


def false_alarms(count: int, seed: int) -> Counter[str]:
    """What sound logs that are said to be held have in common; two channels each."""
    return Counter(kind for kind, log in sound(count, seed) for _ in log.holds)


def detected(count: int, seed: int) -> tuple[int, int, int, int]:
    """How many held logs are found, with thrust left alone; readings right, missed, false."""
    found = right = missed = false = 0
    for log, read in held(count, seed):
        if set(log.holds) == {"speed"}:
            found += 1
            took = np.flatnonzero(log.holds["speed"].read)
            right += np.intersect1d(took, read).size
            missed += np.setdiff1d(read[read > 0], took).size
            false += np.setdiff1d(took, read).size
    return found, right, missed, false


if __name__ == "__main__":
    size = int(sys.argv[1]) if len(sys.argv) > 1 else 400
    alarms = false_alarms(size, 11)
    print(f"{2 * size} channels that are not held; said to be: {alarms.total()}")
    for kind, times in alarms.most_common():
        print(f"    {times} of: {kind}")
    found, right, missed, false = detected(size // 4, 11)
    print(f"held at irregular times: found in {found} of {size // 4}")
    print(f"    readings right {right}, missed {missed}, false {false}")
