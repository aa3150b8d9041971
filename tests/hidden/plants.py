"""The plants of the bench: random base parameters, experiments, sensors, hidden effects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from reference import noise, thruster, vessel
from reference.records import Record

from . import excitation
from .outside import THRUSTER_TABLE, VESSEL_TABLE

Array = np.ndarray
Hidden = Mapping[str, Mapping[str, float]]

LOGS = 3
TIME = {"thruster": 0.05 * np.arange(2000), "vessel": 0.1 * np.arange(1200)}
#: Channels beyond the necessary ones that an effect must have measured.
NEEDS = {
    "supply_voltage_sag": ("supply_voltage",),
    "inflow_load_relief": ("inflow",),
    "inflow_thrust_loss": ("inflow",),
    "wind": ("wind",),
}
TRACK = ("north", "east", "heading")


class Gust(NamedTuple):
    """Process noise: standard deviation at each place where it pushes, and its memory [s]."""

    std: tuple[float, ...]
    time_constant: float


@dataclass(frozen=True)
class Plant:
    """What made a set: everything that the diagnosis must not see.

    Attributes:
        system: "thruster", "propeller" (a vessel) or "twin" (a vessel).
        parameters: of the basic equations.
        experiments: inputs of each log, SI.
        scale: typical sizes of signals, in which effects are measured (see `sizes`).
        sensors: of each measured channel.
        gust: process noise, or ``None``.
        hidden: the hidden effects with their parameters.
        pushes: by experiment a known push where the process noise acts, ``(T,)`` or ``(T, 3)``;
            none where empty.
    """

    system: str
    parameters: Mapping[str, float]
    experiments: tuple[Mapping[str, Array], ...]
    scale: Mapping[str, float]
    sensors: Mapping[str, noise.Sensor]
    gust: Gust | None = None
    hidden: Hidden = field(default_factory=dict)
    pushes: tuple[Array, ...] = ()

    @property
    def time(self) -> Array:
        """Sample instants of every log [s]."""
        samples = len(next(iter(self.experiments[0].values())))
        return TIME["thruster" if self.system == "thruster" else "vessel"][:samples]

    def run(self, index: int, rng: np.random.Generator | None = None) -> Record:
        """One experiment: with the sensors' and the process noise of ``rng``, or without any."""
        inputs, options = dict(self.experiments[index]), self._options()
        if rng is not None and self.gust is not None:
            columns = [
                noise.ornstein_uhlenbeck(rng, self.time, std, self.gust.time_constant)
                for std in self.gust.std
            ]
            options["disturbance"] = columns[0] if len(columns) == 1 else np.array(columns).T
        if self.pushes:
            options["disturbance"] = options.get("disturbance", 0.0) + self.pushes[index]
        if self.system == "thruster":
            command = inputs.pop("command")
            record = thruster.simulate(
                self.time,
                command,
                catalogue=THRUSTER_TABLE,
                **self.parameters,
                **inputs,
                **options,
                **self.hidden,
            )
        else:
            record = vessel.simulate(
                self.time,
                inputs,
                parameters=self.parameters,
                catalogue=VESSEL_TABLE,
                **options,
                **self.hidden,
            )
        if rng is not None:
            return noise.measure(record, rng, **self.sensors)
        return record

    def _options(self) -> dict[str, Any]:
        """Steps short enough for the fastest hidden lag (the explicit method's limit)."""
        lags = [p["time_constant"] for p in self.hidden.values() if "time_constant" in p]
        step = float(self.time[1])
        return {"method": "rk4", "substeps": max([4] + [int(np.ceil(step / t)) for t in lags])}


def thruster_plant(
    rng: np.random.Generator, needs: tuple[str, ...], field: bool, poor: bool, correlation: float
) -> Plant:
    """A thruster within a factor of two of Jason's, driven to some 40 to 65 rad/s."""
    base = {name: value * _factor(rng, 1.8) for name, value in thruster.JASON.items()}
    speed = rng.uniform(40.0, 65.0)
    command = base["alpha"] / base["beta"] * speed**2
    scale = {
        "command": command,
        "speed": speed,
        "drive": base["beta"] * command,
        "thrust": base["ct"] * speed**2,
        **base,
    }
    time = TIME["thruster"]
    present = [rng.random() < 0.2 or name in needs for name in ("supply_voltage", "inflow")]
    experiments = []
    for _ in range(LOGS):
        drive = excitation.poor if poor else excitation.rich
        experiment = {"command": drive(rng, time, command)}
        supply = excitation.wander(rng, time, 24.0, 1.5, 4.0)
        inflow = excitation.wander(rng, time, 0.0, 0.5, 3.0)
        experiment |= {"supply_voltage": supply} if present[0] else {}
        experiment |= {"inflow": inflow} if present[1] else {}
        experiments.append(experiment)
    sensors = {name: _sensor(rng, scale[name], field, correlation) for name in ("speed", "thrust")}
    gust = Gust((rng.uniform(0.03, 0.05) * scale["drive"],), rng.uniform(0.3, 2.0))
    return Plant("thruster", base, tuple(experiments), scale, sensors, gust if field else None)


def vessel_plant(
    rng: np.random.Generator, drive: str, needs: tuple[str, ...], track: bool, field: bool
) -> Plant:
    """A small vessel like that of Siramdasu & Fahimi 2013, with a propeller or twin thrusters."""
    base = {name: value * _factor(rng, 1.3) for name, value in vessel.SIRAMDASU.items()}
    force = 98.0 ** base["exponent"] if drive == "propeller" else 2.5
    surge = force / base["d11"]
    turning = base["lever_arm"] * force * (0.4 if drive == "propeller" else 0.6)
    scale = {"force": force, "surge": surge, "yaw_rate": turning / base["d33"], "moment": turning}
    make = excitation.propeller if drive == "propeller" else excitation.twin
    experiments = []
    for _ in range(LOGS):
        experiment = make(rng, TIME["vessel"])
        weather = excitation.weather(rng, TIME["vessel"])
        experiments.append(experiment | (weather if "wind" in needs else {}))
    ranges = {"surge": surge, "sway": 0.4 * surge, "yaw_rate": scale["yaw_rate"]}
    ranges |= {"north": 10.0, "east": 10.0, "heading": 2.0} if track or needs else {}
    sensors = {name: _sensor(rng, most, field, 0.0) for name, most in ranges.items()}
    part = rng.uniform(0.03, 0.05)
    gust = Gust((part * force, part * force, part * scale["moment"]), rng.uniform(0.5, 2.0))
    return Plant(drive, base, tuple(experiments), scale, sensors, gust if field else None)


def _sensor(rng: np.random.Generator, most: float, field: bool, correlation: float) -> noise.Sensor:
    """Noise of 0.5 to 1 % of the range; in the field coloured, with spikes and coarse steps."""
    std = rng.uniform(0.005, 0.01) * most
    drawn = rng.uniform(0.4, 0.9), rng.uniform(0.3, 1.0) * std
    if not field:
        return noise.Sensor(std, correlation)
    return noise.Sensor(std, drawn[0], spike_share=0.01, spike_size=0.3 * most, quantum=drawn[1])


def _factor(rng: np.random.Generator, most: float) -> float:
    """Log-uniform between 1 / ``most`` and ``most``."""
    return float(most ** rng.uniform(-1.0, 1.0))
