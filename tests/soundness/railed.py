"""Made logs with sensors whose range ends, and without; how often each is said to.

Run as ``python -m soundness.railed`` from ``tests``; prints the shares.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np
from reference import inputs, noise, thruster

import diffthrust as dft

KINDS = ("random", "multisine", "stairs", "full", "step", "ramp")


def command(rng: np.random.Generator, time: np.ndarray, kind: str) -> np.ndarray:
    size, end = rng.uniform(0.5, 2.5), time[-1]
    match kind:
        case "random":
            return inputs.low_passed_random(time, 0.7 * size, rng, rng.uniform(0.1, 2.0))
        case "multisine":
            return inputs.multisine(time, size, rng.uniform(0.05, 1.0, 3), rng)
        case "stairs":
            levels = rng.uniform(-size, size, 16) * (rng.random(16) < 0.7)
            return inputs.staircase(time, levels, end / 15)
        case "full":
            return inputs.staircase(time, rng.choice([0.0, size], 16), end / 15)
        case "step":
            return inputs.step(time, size, end * rng.uniform(0.1, 0.5))
    swept = np.abs((time / end * rng.integers(1, 5)) % 2 - 1)
    return size * np.clip(1.6 * swept - 0.3, 0, 1) * rng.choice([1.0, -1.0])


def made(time: np.ndarray, drive: np.ndarray, speed: np.ndarray, thrust: np.ndarray) -> dft.Log:
    return dft.Log(time, {"command": drive}, {"speed": speed, "thrust": thrust})


def sound(count: int, seed: int) -> Iterator[dft.Log]:
    """Logs without rails.

    With noise of all sizes or none, white or coloured, of all resolutions; sensors that are held or
    have no sign; thrusters that rest, settle, or are at their limit while the command goes on.
    """
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        time = inputs.grid(rng.uniform(10.0, 60.0), float(rng.choice([0.01, 0.02, 0.05])))
        drive = command(rng, time, str(rng.choice(KINDS)))
        most = 0.6 * np.abs(drive).max() if rng.random() < 0.25 else np.inf
        truth = thruster.simulate(time, np.clip(drive, -most, most), method="rk4", substeps=3).truth
        speed = noise.Sensor(
            std=rng.choice([0.0, 0.05, 0.5, 2.0]),
            quantum=rng.choice([0.0, 0.1, 0.5, 1.0]),
            correlation=rng.choice([0.0, 0.8]),
            unsigned=bool(rng.random() < 0.3),
        ).read(rng, truth["speed"])
        thrust = noise.Sensor(
            std=rng.choice([0.0, 0.05, 0.5, 2.0]),
            quantum=rng.choice([0.0, 0.05, 0.5, 1.0, 2.0]),
            correlation=rng.choice([0.0, 0.8]),
        ).read(rng, truth["thrust"])
        hold = int(rng.choice([1, 1, 1, 4, 10]))
        yield made(time, drive, speed, thrust[np.arange(time.size) // hold * hold])


def cut(count: int, seed: int) -> Iterator[tuple[dft.Log, float, bool]]:
    """Logs whose load cell ends below a tenth of the thrust; where, and whether its noise tells."""
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        time = inputs.grid(rng.uniform(15.0, 60.0), 0.02)
        drive = command(rng, time, str(rng.choice(["random", "multisine", "stairs"])))
        truth = thruster.simulate(time, drive, method="rk4", substeps=3).truth
        std, quantum = float(rng.choice([0.1, 0.5, 1.5])), float(rng.choice([0.0, 0.05, 0.5]))
        rail = float(noise.quantise(np.quantile(truth["thrust"], 0.9), quantum))
        if rail < 0.1 * truth["thrust"].max():
            continue
        seen = noise.Sensor(std=std, quantum=quantum).read(rng, truth["thrust"])
        speed = truth["speed"] + noise.white(rng, time.size, 0.5)
        yield made(time, drive, speed, np.minimum(seen, rail)), rail, std > 1.5 * quantum


def false_alarms(count: int, seed: int = 0) -> int:
    """How many of so many sound logs are said to have a rail."""
    return sum(bool(log.railed) for log in sound(count, seed))


def detected(count: int, seed: int = 0) -> dict[bool, tuple[int, int]]:
    """Of how many logs with a rail it is found at its place, by whether the noise tells it."""
    tally = {True: [0, 0], False: [0, 0]}
    for log, rail, told in cut(count, seed):
        found = log.railed
        right = set(found) == {"thrust"} and abs(found["thrust"].high - rail) < 1e-6
        tally[told][0] += right
        tally[told][1] += 1
    return {told: (found, of) for told, (found, of) in tally.items()}


if __name__ == "__main__":
    size = int(sys.argv[1]) if len(sys.argv) > 1 else 400
    print(f"sound logs: {size}, said to have a rail: {false_alarms(size, 7)}")
    for told, (found, of) in detected(size // 2, 7).items():
        what = "noise wider than the resolution" if told else "coarse, or next to no noise"
        print(f"a tenth at a rail, {what}: found in {found} of {of}")
