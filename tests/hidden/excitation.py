"""Input series of the bench's experiments, all drawn from a given generator."""

from __future__ import annotations

import numpy as np
from reference import inputs, noise

Array = np.ndarray


def rich(rng: np.random.Generator, time: Array, most: float) -> Array:
    """A command that shows everything: both directions, large and small, fast and slow, rests.

    Six parts in random order: large staircase, small staircase between rests, slow ramps through
    zero, low-passed random, full steps forward and back, rest. At most ``most`` either way.
    """
    shares = {_stairs: 0.28, _small: 0.16, _ramps: 0.16, _random: 0.24, _full: 0.10, _rest: 0.06}
    parts = [list(shares)[k] for k in rng.permutation(len(shares))]
    ends = np.round(np.cumsum([shares[part] for part in parts]) * len(time)).astype(int)
    cuts = np.split(time, ends[:-1])
    return most * np.concatenate([p(rng, t - t[0]) for p, t in zip(parts, cuts, strict=True)])


def poor(rng: np.random.Generator, time: Array, most: float) -> Array:
    """One slow ramp, or three steps, in the forward direction alone."""
    if rng.random() < 0.5:
        return most * np.linspace(0.0, rng.uniform(0.6, 1.0), len(time))
    levels = np.sort(rng.uniform(0.3, 1.0, 3))
    return most * inputs.staircase(time, levels, (time[-1] - time[0]) / 3.0)


def _levels(rng: np.random.Generator, time: Array, low: float, high: float, dwell: float) -> Array:
    """A staircase of random levels of either sign, between ``low`` and ``high``."""
    count = int(np.ceil((time[-1] - time[0]) / dwell)) + 1
    size = rng.uniform(low, high, count)
    return inputs.staircase(time, size * rng.choice([-1.0, 1.0], count), dwell)


def _stairs(rng: np.random.Generator, time: Array) -> Array:
    return _levels(rng, time, 0.15, 1.0, rng.uniform(1.5, 3.0))


def _small(rng: np.random.Generator, time: Array) -> Array:
    dwell = 1.6
    resting = np.floor((time - time[0]) / dwell).astype(int) % 3 == 2
    return np.where(resting, 0.0, _levels(rng, time, 0.02, 0.15, dwell))


def _ramps(rng: np.random.Generator, time: Array) -> Array:
    phase = (time - time[0]) / (time[-1] - time[0])
    top, side = rng.uniform(0.3, 0.8), rng.choice([-1.0, 1.0])
    return side * top * (1.0 - 4.0 * np.abs((1.5 * phase + 0.25) % 1.0 - 0.5))


def _random(rng: np.random.Generator, time: Array) -> Array:
    series = inputs.low_passed_random(time, 0.5, rng, rng.uniform(0.15, 0.6))
    return np.clip(series, -1.0, 1.0)


def _full(rng: np.random.Generator, time: Array) -> Array:
    side = rng.choice([-1.0, 1.0])
    return inputs.staircase(time, [side, -side], (time[-1] - time[0]) / 2.0)


def _rest(rng: np.random.Generator, time: Array) -> Array:
    return np.zeros(len(time))


def wander(rng: np.random.Generator, time: Array, mean: float, std: float, slow: float) -> Array:
    """A measured surrounding that drifts about its mean with the time constant ``slow`` [s]."""
    return mean + noise.ornstein_uhlenbeck(rng, time, std, slow)


def propeller(rng: np.random.Generator, time: Array) -> dict[str, Array]:
    """Speed steps [rev/s], some in reverse, and a rudder [rad] that swings, steps and wanders."""
    count, dwell = 40, rng.uniform(6.0, 10.0)
    speed = rng.uniform(40.0, 130.0, count)
    speed[rng.permutation(int(time[-1] / dwell))[:2]] *= -0.7
    third = np.array_split(time, 3)
    rudder = [
        inputs.zigzag(third[0], np.radians(rng.uniform(12, 24)), rng.uniform(3, 6)),
        np.radians(24.0) * _levels(rng, third[1], 0.1, 1.0, rng.uniform(3, 6)),
        np.radians(24.0) * _random(rng, third[2]),
    ]
    order = rng.permutation(3)
    return {
        "propeller_speed": inputs.staircase(time, speed, dwell),
        "rudder_angle": np.concatenate([rudder[k] for k in order])[: len(time)],
    }


def twin(rng: np.random.Generator, time: Array) -> dict[str, Array]:
    """Two forces [N]: steps of either sign, then low-passed random."""
    half = np.array_split(time, 2)
    return {
        name: np.concatenate(
            [
                2.0 * _levels(rng, half[0], 0.1, 1.0, rng.uniform(4.0, 7.0)) + 0.5,
                2.0 * np.clip(_random(rng, half[1]) + 0.25, -1.0, 1.0),
            ]
        )
        for name in ("left_force", "right_force")
    }


def weather(rng: np.random.Generator, time: Array) -> dict[str, Array]:
    """Measured wind: speed [m/s] and the direction [rad] from which it blows."""
    speed = np.abs(wander(rng, time, 4.0, 1.0, 5.0))
    return {
        "wind_speed": speed,
        "wind_direction": wander(rng, time, rng.uniform(-np.pi, np.pi), 0.3, 10.0),
    }
