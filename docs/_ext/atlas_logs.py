"""What the atlas works out: standard records, what each effect does to them, and what looks alike.

Every record of a model has the same time stamps, so that one compiled program serves all of them:
an effect costs one compilation, and milliseconds for each further record.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

import diffthrust as dft

SAMPLES = 600


@dataclass(frozen=True)
class Bench:
    """A model with the records on which its effects are looked at.

    Args:
        title: what it is, for people.
        code: how it is made.
        model: the model without effects.
        records: named inputs, the standard one first.
        noise: standard deviation of each measured channel.
    """

    title: str
    code: str
    model: dft.Model
    records: dict[str, dft.Log]
    noise: dict[str, float]

    @property
    def standard(self) -> dft.Log:
        """The first record."""
        return next(iter(self.records.values()))


def _staircase(seed: int, low: float, high: float, dwell: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(low, high, SAMPLES // dwell + 1), dwell)[:SAMPLES]


def _thruster_records(full: float) -> dict[str, dft.Log]:
    time = 0.05 * np.arange(SAMPLES)
    surroundings = {
        "inflow": 0.6 * np.sin(0.5 * time + 0.4),
        "supply_voltage": 24.0 - 3.0 * (1 - np.cos(0.35 * time)),
    }
    chirp = np.sin(2 * np.pi * (0.1 + 0.03 * time) * time)
    triangle = 2 / np.pi * np.arcsin(np.sin(2 * np.pi * time / 20.0))
    commands = {
        "steps either way": _staircase(3, -1.0, 1.0, 30),
        "forward steps": _staircase(4, 0.1, 1.0, 30),
        "small steps about zero": 0.25 * _staircase(5, -1.0, 1.0, 30),
        "a slow ramp up and down": triangle,
        "a chirp": 0.6 * chirp,
        "fast chirp about a forward command": 0.5 + 0.3 * chirp,
        "full command held, then steps": np.where(time < 12.0, 1.0, _staircase(6, -1.0, 1.0, 60)),
    }
    return {
        name: dft.Log(time, {"command": full * u, **surroundings}, name=name)
        for name, u in commands.items()
    }


def _axis_records() -> dict[str, dft.Log]:
    time = 0.1 * np.arange(SAMPLES)
    thrusts = {
        "steps either way": _staircase(10, -1.0, 1.0, 60),
        "a slow sine": np.sin(0.3 * time),
        "ahead and stop": np.where(time % 30.0 < 15.0, 1.0, 0.0),
    }
    return {n: dft.Log(time, {"thrust": 30.0 * thrust}, name=n) for n, thrust in thrusts.items()}


def _vessel_records(drive: str) -> dict[str, dft.Log]:
    time = 0.1 * np.arange(SAMPLES)
    wind = {"wind_speed": 4 + np.sin(0.2 * time), "wind_direction": np.full(SAMPLES, 0.7)}
    zigzag = np.sign(np.sin(0.45 * time))
    turning = np.where(time < 30.0, 1.0, -1.0)
    first, second = ("propeller_speed", "rudder_angle")
    if drive == "twin":
        first, second = ("left_force", "right_force")
    pushes = {
        "pushes and rudder at random": (_staircase(7, -0.5, 1.2, 60), _staircase(8, -1, 1, 45)),
        "a zigzag": (np.full(SAMPLES, 1.0), zigzag),
        "circles to either side": (np.full(SAMPLES, 1.0), 0.7 * turning),
        "straight ahead and stop": (np.where(time % 30.0 < 18.0, 1.0, 0.0), 0.0 * time),
        "straight astern and ahead": (np.where(time % 30.0 < 15.0, -0.8, 0.8), 0.0 * time),
        "small rudder angles": (np.full(SAMPLES, 0.8), 0.15 * _staircase(9, -1, 1, 45)),
    }
    records = {}
    for name, (push, turn) in pushes.items():
        given = {first: 98.0 * push, second: 0.35 * turn}
        if drive == "twin":
            given = {first: 8.0 * push + 3.0 * turn, second: 8.0 * push - 3.0 * turn}
        records[name] = dft.Log(time, {**given, **wind}, name=name)
    return records


@cache
def benches() -> tuple[Bench, ...]:
    """In the order in which an effect is looked for in them."""
    thruster = dft.Thruster(alpha=0.037, beta=42.0, ct=0.02)
    vessel_noise = {"surge": 0.01, "sway": 0.01, "yaw_rate": 0.01}
    return (
        Bench(
            "thruster",
            "dft.Thruster()",
            thruster,
            _thruster_records(3.0),
            {"speed": 0.4, "thrust": 0.5},
        ),
        Bench(
            "thruster behind a speed controller",
            "dft.SpeedLoopThruster()",
            dft.SpeedLoopThruster(),
            _thruster_records(1.0),
            {"speed": 2.0, "thrust": 0.5},
        ),
        Bench("vessel", "dft.Vessel()", dft.Vessel(), _vessel_records("propeller"), vessel_noise),
        Bench(
            "vessel with two thrusters",
            'dft.Vessel(drive="twin")',
            dft.Vessel(
                "twin", m11=20.0, m22=30.0, i33=4.0, d11=8.0, d22=20.0, d33=5.0, lever_arm=0.3
            ),
            _vessel_records("twin"),
            vessel_noise,
        ),
        Bench(
            "axis of a vehicle",
            "dft.AxisVehicle()",
            dft.AxisVehicle(),
            _axis_records(),
            {"position": 0.02, "velocity": 0.01},
        ),
    )


class _Noted(dft.models.Ports):
    """Ports without effects that keep what passes them."""

    def __init__(self, signals: Any) -> None:
        super().__init__((), signals)
        self.passed: dict[str, Any] = {}

    def __call__(self, port: str, value: Any) -> Any:
        self.passed[port] = value
        return value


def signals_of(bench: Bench, record: dft.Log) -> dict[str, np.ndarray]:
    """All that a model knows along a record: inputs, states, outputs, and what passes its ports."""
    run = simulated(bench.model, record)
    known = {"time": record.time, **record.inputs, **run}
    noted = _Noted(dft.models.Signals({k: np.asarray(v) for k, v in known.items()}))
    bench.model.equations(dft.models.Signals(known), noted)
    passed = {k: np.broadcast_to(np.asarray(v), record.time.shape) for k, v in noted.passed.items()}
    return {**known, **passed}


def simulated(model: dft.Model, record: dft.Log) -> dict[str, np.ndarray]:
    """The model along a record, from rest."""
    return dft.simulate(model, record, initial=dict.fromkeys(model.states, 0.0), substeps=2)


def levels(bench: Bench) -> dict[str, float]:
    """The size of each signal: the 90th percentile of its absolute value."""
    known = signals_of(bench, bench.standard)
    sizes = {name: float(np.percentile(np.abs(v), 90)) for name, v in known.items()}
    return {**sizes, "duration": bench.standard.duration}


def typical(effect: dft.Effect, sizes: dict[str, float]) -> dft.Effect:
    """The effect at a value from which a diagnosis would begin: the middle one, or the stronger."""
    values = {}
    for name, p in effect.declared.items():
        tried = p.probes
        if not isinstance(tried, tuple):
            level = sizes.get(tried.signal, 1.0) ** tried.power
            tried = tuple(factor * level for factor in tried.factors)
        if not tried or p.fixed:
            continue
        weaker_when_large = p.null is not None and math.isinf(p.null)
        ranked = sorted(tried, key=lambda v: (abs(v), v), reverse=weaker_when_large)
        values[name] = ranked[len(ranked) // 2]
    return type(effect)(**values) if values else effect


@dataclass(frozen=True)
class Answer:
    """What an effect does on one record, in standard deviations of the sensors.

    Args:
        raw: the change of all outputs, one channel after the other.
        left: what of it the model's own parameters cannot take up.
        taken: by how much, in relative terms, each of these would move to take up the rest.
    """

    raw: np.ndarray
    left: np.ndarray
    taken: dict[str, float]

    @property
    def absorbed(self) -> bool:
        """Whether the model's parameters take it up as a whole."""
        return bool(np.linalg.norm(self.left) < 1e-2 * np.linalg.norm(self.raw))

    @property
    def size(self) -> float:
        """Root mean square of what is left, in standard deviations of the sensors."""
        return float(np.sqrt(np.mean(self.left**2)))


def _stacked(bench: Bench, model: dft.Model, record: dft.Log) -> np.ndarray:
    run = simulated(model, record)
    return np.concatenate([run[name] / size for name, size in bench.noise.items()])


@cache
def _own(index: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """For each record: the model's outputs, and what a relative change of its parameters does."""
    bench = benches()[index]
    found = {}
    for name, record in bench.records.items():
        middle = _stacked(bench, bench.model, record)
        columns = []
        for one in free(bench.model):
            moved = bench.model.replace({one: bench.model.parameters[one].value * 1.001})
            columns.append((_stacked(bench, moved, record) - middle) / 0.001)
        found[name] = middle, np.stack(columns, axis=1)
    return found


def free(model: dft.Model) -> list[str]:
    """The parameters that a fit would estimate."""
    return [name for name, p in model.parameters.items() if not p.fixed]


def answers(index: int, effect: dft.Effect) -> dict[str, Answer]:
    """What an effect does on every record of a bench."""
    bench = benches()[index]
    model = bench.model + effect
    found = {}
    for name, record in bench.records.items():
        middle, slopes = _own(index)[name]
        raw = np.nan_to_num(_stacked(bench, model, record) - middle)
        taken, *_ = np.linalg.lstsq(slopes, raw, rcond=1e-9)
        moves = dict(zip(free(bench.model), map(float, taken), strict=True))
        found[name] = Answer(raw, raw - slopes @ taken, moves)
    return found


def telling_record(found: dict[str, Answer]) -> str:
    """The standard record, or the one on which an effect shows where it hardly does on that."""
    best = max(found, key=lambda name: found[name].size)
    standard = next(iter(found))
    return standard if found[standard].size > 0.1 * found[best].size else best


def likeness(one: Answer, other: Answer) -> float:
    """How well one effect stands for another, 0 to 1: the cosine between what they leave."""
    size = np.linalg.norm(one.left) * np.linalg.norm(other.left)
    if one.absorbed or other.absorbed:
        return 0.0
    return float(abs(one.left @ other.left) / size) if size > 0 else 0.0


def distance(one: Answer, other: Answer) -> float:
    """What stays of an effect when another imitates it at its best size: rms over the noise."""
    return one.size * math.sqrt(max(0.0, 1.0 - likeness(one, other) ** 2))
