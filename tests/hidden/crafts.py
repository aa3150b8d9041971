"""Crafts with something wrong: one of eight thrusters, two columns, an azimuth, the sea, the trim.

    weak, late, deadband     one of the eight thrusters of an underwater vehicle
    exchanged, reversed      two of its columns, or the sign of one
    azimuth                  one of a ferry's two azimuths turns far slower than its model holds
    current                  a boat of two thrusters in a current, another one in each log
    centre                   that boat with its centre of mass ahead of where its model holds it
    nothing                  either of the first two as its model has it

The plants are those of `reference.craft`, by matrices and DOP853.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from reference import craft, noise

import diffthrust as dft

Array = np.ndarray

WRONG = ("weak", "late", "deadband", "exchanged", "reversed", "azimuth", "current", "centre")
STEP, SAMPLES = 0.1, 300
SENSORS = ("surge", "sway", "heave", "yaw_rate", "north", "east", "depth", "heading")
SIGMA = 0.01
"""Of the readings [m/s, rad/s, m, rad]: of a DVL, a rate gyro, a gauge and a compass, in round
numbers."""
CURVE = {"gain": 30.0, "exponent": 1.5}
_C = float(np.sqrt(0.5))
EIGHT = {
    "t1": ((0.156, 0.111, 0.0), (_C, -_C, 0.0)),
    "t2": ((0.156, -0.111, 0.0), (_C, _C, 0.0)),
    "t3": ((-0.156, 0.111, 0.0), (_C, _C, 0.0)),
    "t4": ((-0.156, -0.111, 0.0), (_C, -_C, 0.0)),
    "t5": ((0.12, 0.218, 0.0), (0.0, 0.0, 1.0)),
    "t6": ((0.12, -0.218, 0.0), (0.0, 0.0, 1.0)),
    "t7": ((-0.12, 0.218, 0.0), (0.0, 0.0, 1.0)),
    "t8": ((-0.12, -0.218, 0.0), (0.0, 0.0, 1.0)),
}
TWIN = {
    "port": ((-0.4, -0.285, 0.0), (1.0, 0.0, 0.0)),
    "starboard": ((-0.4, 0.285, 0.0), (1.0, 0.0, 0.0)),
}
FERRY = {"bow": ((0.9, 0.0, 0.0), (1.0, 0.0, 0.0)), "aft": ((-0.9, 0.0, 0.0), (1.0, 0.0, 0.0))}
SLEW = 0.3
"""What the model of the ferry holds: the time in which both azimuths turn [s]."""


UNITS = {"command": "effort", "angle": "rad"}


class Drawn(NamedTuple):
    """Logs to train on and an unseen one, the model, and what must be said."""

    train: tuple[dft.Log, ...]
    unseen: dft.Log
    model: dft.Model
    truth: tuple[str, ...]
    asks: str
    about: tuple[str, ...]


def drawn(rng: np.random.Generator, name: str) -> Drawn:
    """Logs of a craft with the thing of that name wrong with it."""
    if name == "azimuth":
        return _ferry(rng)
    if name in ("current", "centre") or (name == "nothing" and rng.random() < 0.5):
        return _boat(rng, name)
    return _vehicle(rng, name)


def _vehicle(rng: np.random.Generator, wrong: str) -> Drawn:
    """Eight thrusters in four degrees of freedom; linear damping and the curve's gain are known."""
    known = {"d11": 4.0, "d22": 6.0, "d33": 5.0, "d66": 0.07, "weight": 112.8}
    plain = {"m11": 17.0, "m22": 24.0, "m33": 26.0, "i66": 0.28}
    drags = {"q11": 18.0, "q22": 22.0, "q33": 37.0, "q66": 1.5}
    p = {**_spread(rng, {**plain, **drags}, 0.2), **known, "buoyancy": 114.8}
    body = craft.Body(
        [p["m11"], p["m22"], p["m33"], 1.0, 1.0, p["i66"]],
        [p["d11"], p["d22"], p["d33"], 0.0, 0.0, p["d66"]],
        [p["q11"], p["q22"], p["q33"], 0.0, 0.0, p["q66"]],
        weight=p["weight"],
        buoyancy=p["buoyancy"],
        free=(0, 1, 2, 5),
    )
    one, other = (f"t{k + 1}" for k in rng.permutation(8)[:2])
    if wrong == "exchanged":  # the four that lift do the same here, and no log tells two apart
        one = f"t{rng.choice([k for k in range(1, 5) if f't{k}' != other])}"
    strength = {one: rng.uniform(0.6, 0.85)} if wrong == "weak" else {}
    late = int(rng.integers(2, 6))
    band = rng.uniform(0.12, 0.25)
    actuators = [_static(place, strength.get(n, 1.0)) for n, place in EIGHT.items()]

    def run(name: str) -> dft.Log:
        commands = {n: _stairs(rng) for n in EIGHT}
        given = dict(commands)
        if wrong == "late":
            given[one] = np.concatenate([np.zeros(late), commands[one][:-late]])
        if wrong == "deadband":
            given[one] = np.sign(commands[one]) * np.maximum(np.abs(commands[one]) - band, 0.0)
        if wrong == "exchanged":
            given[one], given[other] = commands[other], commands[one]
        if wrong == "reversed":
            given[one] = -commands[one]
        return _recorded(rng, body, actuators, given, commands, name)

    law = dft.actuators.StaticThruster(**CURVE)
    mounts = {n: law.at(*place) for n, place in EIGHT.items()}
    model = dft.Craft(dft.bodies.FourDegrees(), **mounts, share=[tuple(EIGHT)])
    guess = _spread(rng, {n: p[n] for n in (*plain, *drags)}, 0.2)
    model = model.replace({**known, **guess}).fix("t1.gain", *known)
    asked = {
        "weak": ((), "held", (f"{one}.strength",)),
        "late": ((f"{one}.command_delay",), "effect", ()),
        "deadband": ((f"{one}.command_deadband",), "effect", ()),
        "exchanged": ((), "doubt", ("exchanged", one, other)),
        "reversed": ((), "doubt", ("sign", one)),
        "nothing": ((), "sound", ()),
    }[wrong]
    return Drawn((run("run 1"), run("run 2")), run("run 3"), model, *asked)


def _boat(rng: np.random.Generator, wrong: str) -> Drawn:
    """Two thrusters in the plane; the mass in surge was weighed."""
    p = _spread(rng, {"m11": 36.0, "m22": 58.0, "i33": 5.0, "d11": 18.0, "d22": 70.0, "d33": 10.0})
    ahead = rng.choice([-1.0, 1.0]) * rng.uniform(0.12, 0.25) if wrong == "centre" else 0.0
    body = _planar(p, ahead)
    actuators = [_static(place, 1.0) for place in TWIN.values()]

    def run(name: str) -> dft.Log:
        commands = {n: 0.35 + 0.65 * _stairs(rng) for n in TWIN}
        towards, speed = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.2, 0.5)
        current = (speed * np.cos(towards), speed * np.sin(towards)) if wrong == "current" else None
        return _recorded(rng, body, actuators, commands, commands, name, current)

    law = dft.actuators.StaticThruster(**CURVE)
    mounts = {n: law.at(*place) for n, place in TWIN.items()}
    model = dft.Craft(dft.bodies.Planar(), **mounts, share=[tuple(TWIN)])
    model = model.replace({**_spread(rng, p), "m11": p["m11"]}).fix("m11")
    asked = {
        "current": (("water_current",), "effect", ()),
        "centre": ((), "held", ("x_g",)),
        "nothing": ((), "sound", ()),
    }[wrong]
    return Drawn((run("run 1"), run("run 2")), run("run 3"), model, *asked)


def _ferry(rng: np.random.Generator) -> Drawn:
    """Two azimuths, of which one turns slowly; the mass in surge was weighed."""
    p = _spread(rng, {"m11": 36.0, "m22": 58.0, "i33": 20.0, "d11": 18.0, "d22": 70.0, "d33": 30.0})
    slow = str(rng.choice([*FERRY]))
    times = {n: rng.uniform(1.0, 2.0) if n == slow else SLEW for n in FERRY}

    def run(name: str) -> dft.Log:
        commands, actuators = {}, []
        for n, (place, pointing) in FERRY.items():
            angle = np.repeat(rng.uniform(-1.5, 1.5, SAMPLES // 30 + 1), 30)[:SAMPLES]
            commands[n] = np.stack([np.abs(_stairs(rng)), angle])
            numbers = {**CURVE, "slew_time": times[n]}
            actuators.append(craft.azimuth(numbers, place, float(angle[0]), pointing=pointing))
        return _recorded(rng, _planar(p, 0.0), actuators, commands, commands, name)

    law = dft.actuators.StaticThruster(**CURVE)
    mounts = {n: dft.actuators.Azimuth(law, slew_time=SLEW).at(*x) for n, x in FERRY.items()}
    model = dft.Craft(dft.bodies.Planar(), **mounts).replace({**_spread(rng, p), "m11": p["m11"]})
    model = model.fix("m11", *(f"{n}.slew_time" for n in FERRY))
    runs = (run("run 1"), run("run 2"))
    return Drawn(runs, run("run 3"), model, (), "held", (f"{slow}.slew_time",))


def _recorded(
    rng: np.random.Generator,
    body: craft.Body,
    actuators: Sequence[craft.Actuator],
    given: Mapping[str, Array],
    commands: Mapping[str, Array],
    name: str,
    current: tuple[float, float] | None = None,
) -> dft.Log:
    """A run as its sensors read it: ``given`` reaches the actuators, ``commands`` is logged."""
    time = STEP * np.arange(SAMPLES)
    inputs = [np.atleast_2d(u) for u in given.values()]
    out = craft.simulate(time, body, actuators, inputs)
    if current is not None:
        out = _carried(out, time, *current)
    moving = [n for n in SENSORS if np.any(out[n])]
    measured = {n: out[n] + noise.white(rng, SAMPLES, SIGMA) for n in moving}
    logged = {
        f"{n}.{channel}": values
        for n, series in commands.items()
        for channel, values in zip(UNITS, np.atleast_2d(series), strict=False)
    }
    units = {n: UNITS[n.partition(".")[2]] for n in logged}
    return dft.Log(time, logged, measured, units=units, name=name)


def _carried(out: Mapping[str, Array], time: Array, north: float, east: float) -> dict[str, Array]:
    """The same run in a constant current: through the water it is that in still water."""
    cos, sin = np.cos(out["heading"]), np.sin(out["heading"])
    return {
        **out,
        "surge": out["surge"] + north * cos + east * sin,
        "sway": out["sway"] - north * sin + east * cos,
        "north": out["north"] + north * time,
        "east": out["east"] + east * time,
    }


def _planar(p: Mapping[str, float], ahead: float) -> craft.Body:
    return craft.Body(
        [p["m11"], p["m22"], 1.0, 1.0, 1.0, p["i33"]],
        [p["d11"], p["d22"], 0.0, 0.0, 0.0, p["d33"]],
        centre=(ahead, 0.0, 0.0),
        free=(0, 1, 5),
    )


def _static(place: tuple[Sequence[float], Sequence[float]], strength: float) -> craft.Actuator:
    numbers = {**CURVE, "gain": CURVE["gain"] * strength, "reverse": 1.0}
    return craft.static(numbers, place[0], pointing=tuple(place[1]))


def _stairs(rng: np.random.Generator) -> Array:
    """Steps of 1.5 s, small ones among them."""
    levels = rng.uniform(-1.0, 1.0, SAMPLES // 15 + 1)
    return np.repeat(levels, 15)[:SAMPLES]


def _spread(rng: np.random.Generator, values: Mapping[str, float], by: float = 0.2) -> dict:
    """Numbers some ``by`` off."""
    return {n: v * float(np.exp(by * rng.standard_normal())) for n, v in values.items()}
