"""A thruster that drives a hull whose speed nobody measures: a plant, and a user's own model.

The hull's way brings water to the propeller and relieves its load. The model (`ThrusterOnHull`)
knows the hull, but not that its way matters; `WayRelief` does. The plant is simulated here in
NumPy, and shares nothing with the effect under test.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from reference import noise

import diffthrust as dft

from . import excitation

Array = np.ndarray
STEP, SAMPLES, SUBSTEPS = 0.1, 800, 4
TRUE = {"alpha": 0.037, "beta": 42.0, "ct": 0.02, "mass": 60.0, "drag": 25.0}
TOP = 50.0
"""Speed at full command [rad/s]."""


class ThrusterOnHull(dft.Model):
    """A shaft and the hull that it drives; speed and thrust are measured, the way is not.

    speed' = beta c - alpha speed |speed|,  thrust = ct speed |speed|
    mass way' = thrust - drag way |way|
    """

    name = "thruster_on_hull"
    inputs: ClassVar[Mapping[str, str]] = {"command": "V"}
    states: ClassVar[Mapping[str, str]] = {"speed": "rad/s", "way": "m/s"}
    outputs: ClassVar[Mapping[str, str]] = {"speed": "rad/s", "thrust": "N"}
    ports: ClassVar[Mapping[str, str]] = {
        "load": "torque of the water, as a deceleration of the shaft [rad/s^2]",
        "shaft": "net acceleration of the shaft [rad/s^2]",
    }
    alpha: float = dft.parameter(0.04, "1/rad", bounds=(0, None))
    beta: float = dft.parameter(40.0, "rad/(V s^2)", bounds=(0, None))
    ct: float = dft.parameter(0.02, "N s^2/rad^2", bounds=(0, None))
    mass: float = dft.parameter(60.0, "kg", fixed=True)
    drag: float = dft.parameter(25.0, "N s^2/m^2", fixed=True)

    def equations(self, s: Any, port: Any) -> Any:
        """Rates of shaft and hull, and what is measured."""
        load = port("load", self.alpha * s.speed * jnp.abs(s.speed))
        thrust = self.ct * s.speed * jnp.abs(s.speed)
        rates = {
            "speed": port("shaft", self.beta * s.command - load),
            "way": (thrust - self.drag * s.way * jnp.abs(s.way)) / self.mass,
        }
        return rates, {"speed": s.speed, "thrust": thrust}


class WayRelief(dft.Effect):
    """The water that the hull's way brings relieves the propeller's load.

    Acts on the load [rad/s^2]: less relief * |speed| * way. Null: relief = 0.
    """

    name = "way_relief"
    port = "load"
    relief: float = dft.parameter(0.2, "1/m", null=0.0, size=0.2, probes=(-0.1, 0.1, 0.4))

    def __call__(self, value: Any, s: Any) -> Any:
        """The load with the way."""
        return value - self.relief * jnp.abs(s.speed) * s.way


def drawn(seed: int) -> tuple[tuple[dft.Log, ...], dft.Log, dft.Model]:
    """Two training logs, an unseen one, and the model without the relief, some 20 % off."""
    rng = np.random.default_rng([771, seed])
    plant = {name: value * 1.3 ** rng.uniform(-1, 1) for name, value in TRUE.items()}
    relief = rng.uniform(0.15, 0.35)
    logs = [_log(rng, plant, relief, f"hull {k}") for k in "ABC"]
    off = {name: plant[name] * np.exp(0.2 * rng.standard_normal()) for name in ("alpha", "ct")}
    known = {name: plant[name] for name in ("mass", "drag")}
    return tuple(logs[:2]), logs[2], ThrusterOnHull(**off, **known)


def _log(rng: np.random.Generator, plant: dict[str, float], relief: float, name: str) -> dft.Log:
    time = STEP * np.arange(SAMPLES)
    most = plant["alpha"] / plant["beta"] * TOP**2
    command = excitation.rich(rng, time, most)
    speed = simulated(plant, relief, command)[:, 0]
    thrust = plant["ct"] * speed * np.abs(speed)
    levels = {"speed": (speed, 0.007 * TOP), "thrust": (thrust, 0.007 * plant["ct"] * TOP**2)}
    read = {n: value + noise.white(rng, SAMPLES, std) for n, (value, std) in levels.items()}
    return dft.Log(time, {"command": command}, read, name=name)


def simulated(plant: dict[str, float], relief: float, command: Array) -> Array:
    """Speed and way at the samples, by the method of Runge and Kutta."""
    p, h = plant, STEP / SUBSTEPS
    x, out = np.zeros(2), []

    def slope(x: Array, c: float) -> Array:
        w, u = x
        load = p["alpha"] * w * abs(w) - relief * abs(w) * u
        push = p["ct"] * w * abs(w) - p["drag"] * u * abs(u)
        return np.array([p["beta"] * c - load, push / p["mass"]])

    for c in command:
        out.append(x)
        for _ in range(SUBSTEPS):
            a = slope(x, c)
            b = slope(x + 0.5 * h * a, c)
            d = slope(x + 0.5 * h * b, c)
            x = x + h / 6.0 * (a + 2.0 * b + 2.0 * d + slope(x + h * d, c))
    return np.array(out)
