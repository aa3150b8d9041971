"""Sets with a force that is periodic in time, and sets that only look like it.

    periodic_force     one frequency, of another size and phase in each log: alone, under random
                       forces, beside a dead band, on a hull
    periodic_none      no such force: random forces, a ripple by turns of the shaft, a dead band
                       under a command that is itself periodic

The plants are those of the bench, pushed by a force that is given as a series.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from . import plants, sets, sizes
from .plants import Gust, Plant
from .sets import HiddenSet

SPANS = {"thruster": 800, "vessel": 800}
"""Samples of each log: 40 s of a thruster, 80 s of a vessel."""


def forced(rng: np.random.Generator, name: str) -> tuple[HiddenSet, float]:
    """A set with a periodic force, and its frequency [Hz]."""
    if name == "vessel":
        plant, frequency = plants.vessel_plant(rng, "twin", (), False, False), rng.uniform(0.1, 0.8)
        size = 0.25 * plant.scale["force"]
        along = np.eye(3)[rng.integers(2)] * np.array([1.0, 1.0, 0.0])
    else:
        hidden = (name,) if name in sizes.THRUSTER else ()
        plant, frequency = (
            plants.thruster_plant(rng, hidden, False, False, 0.0),
            rng.uniform(0.3, 3.0),
        )
        chosen = {n: sizes.drawn(n, sizes.ALL[n].clear, rng) for n in hidden}
        plant = replace(plant, hidden=sizes.hidden(chosen, plant.scale))
        size, along = rng.uniform(0.1, 0.3) * plant.scale["drive"], None
    if name == "gusty":
        plant = replace(plant, gust=Gust((0.04 * plant.scale["drive"],), rng.uniform(0.3, 2.0)))
    plant = _cut(plant)
    pushes = []
    for _ in range(plants.LOGS):
        phase = rng.uniform(0.0, 2.0 * np.pi)
        wave = rng.uniform(0.7, 1.3) * size * np.sin(2 * np.pi * frequency * plant.time + phase)
        pushes.append(wave if along is None else wave[:, None] * along)
    return _made(replace(plant, pushes=tuple(pushes)), rng, tuple(plant.hidden)), frequency


def unforced(rng: np.random.Generator, name: str) -> HiddenSet:
    """A set without a periodic force."""
    plant = _cut(plants.thruster_plant(rng, (), False, False, 0.0))
    if name == "gusty":
        plant = replace(plant, gust=Gust((0.05 * plant.scale["drive"],), rng.uniform(0.3, 2.0)))
    elif name == "sines":
        chosen = {
            "command_deadband": sizes.drawn(
                "command_deadband", sizes.ALL["command_deadband"].clear, rng
            )
        }
        swings = [
            {"command": plant.scale["command"] * _sines(rng, plant.time)}
            for _ in range(plants.LOGS)
        ]
        plant = replace(plant, hidden=sizes.hidden(chosen, plant.scale), experiments=tuple(swings))
    elif name == "turns":
        order, size = rng.uniform(0.05, 0.4), rng.uniform(0.1, 0.3) * plant.scale["drive"]
        pushes = [_by_turns(plant, k, order, size) for k in range(plants.LOGS)]
        plant = replace(plant, pushes=tuple(pushes))
    return _made(plant, rng, tuple(plant.hidden))


def _cut(plant: Plant) -> Plant:
    samples = SPANS["thruster" if plant.system == "thruster" else "vessel"]
    experiments = tuple(
        {name: series[:samples] for name, series in each.items()} for each in plant.experiments
    )
    return replace(plant, experiments=experiments)


def _sines(rng: np.random.Generator, time: np.ndarray) -> np.ndarray:
    """Two sines of the command, the same in every log but for their phases."""
    return sum(
        share * np.sin(2 * np.pi * f * time + rng.uniform(0, 6.28))
        for share, f in ((0.6, 0.35), (0.4, 0.83))
    )


def _by_turns(plant: Plant, index: int, order: float, size: float) -> np.ndarray:
    """The push of a ripple of so many waves a radian of the shaft's angle, in turns consistent."""
    command = plant.experiments[index]["command"]
    p, time, speed, angle = plant.parameters, plant.time, 0.0, 0.0
    steps, push = 8, np.zeros(plant.time.size)
    dt = (time[1] - time[0]) / steps
    for k, u in enumerate(command):
        push[k] = size * np.sin(order * angle)
        for _ in range(steps):
            speed += dt * (p["beta"] * u - p["alpha"] * speed * abs(speed) + push[k])
            angle += dt * speed
    return push


def _made(plant: Plant, rng: np.random.Generator, truth: tuple[str, ...]) -> HiddenSet:
    logs = tuple(sets.recorded(plant, k, rng, f"run {'ABC'[k]}") for k in range(plants.LOGS))
    nothing = frozenset[str]()
    return HiddenSet("", "", sets.guess(plant, rng), logs[:2], logs[2], truth, nothing, nothing,
                     plant.gust is not None, plant)  # fmt: skip
