"""Further classes of the bench: what is unmeasured, held wrongly, odd, alike, small, or lost.

    unmeasured     a state that nobody measures: two tanks, a hull behind a thruster; the effect is
                   a user's own, and a set without it among the candidates must not be "adequate"
    constants      a fixed parameter is held at a wrong value: it must be named
    odd_log        one training log of six comes from a plant with another parameter
    rivals         logs of poor excitation under which two effects do the same: both in one group
    too_small      an effect that is certain and takes next to nothing off the whole-run error
    held, gaps     sensors read at every 2nd to 20th sample; up to a tenth of a log lost
    dominated      a channel is moved by what no model explains, by more than by the plant: an
                   effect on the others must be added all the same, and nothing without one
    periodic_force, periodic_none   a force that is periodic in time, and what looks like it
    craft, craft_none   what is wrong with one thruster of many, wiring, trim or sea (`crafts`)

The plants are those of the bench, or simulated in NumPy (`tanks`, `hull`).
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from reference import inputs as shapes
from reference import thruster
from scipy.signal import lfilter

import diffthrust as dft

from . import crafts, excitation, hull, periodic, plants, sets, tanks
from .plants import Plant
from .sets import HiddenSet

SHAKEN = ("command_deadband", "coulomb_friction", "linear_damping", "thrust_sensor_offset")
ALIKE = {
    "command_deadband+coulomb_friction": ("command_deadband", "coulomb_friction"),
    "command_delay+actuator_lag": ("command_delay", "actuator_lag"),
}
DOMINATED = (*SHAKEN[:3], "quadratic_surge_drag")
#: Effects that are the held constant in other words.
SAME = {"ct": ("thrust_sensor_scale",)}

#: Kinds of each class, with how many sets of each make one round.
FURTHER: sets.Classes = {
    "unmeasured": (("tanks", "tanks_unnamed", "hull", "hull_unnamed"), 5),
    "constants": (("lever_arm", "exponent", "ct"), 6),
    "odd_log": (("beta", "ct", "alpha"), 6),
    "rivals": (tuple(ALIKE), 8),
    "too_small": (("coulomb_friction", "command_deadband", "linear_damping", "cavitation"), 5),
    "held": (SHAKEN, 3),
    "held_none": ((), 8),
    "gaps": (SHAKEN, 3),
    "gaps_none": ((), 8),
    "dominated": (DOMINATED, 4),
    "dominated_none": ((), 4),
    "periodic_force": (("alone", "gusty", "command_deadband", "vessel"), 5),
    "periodic_none": (("gusty", "turns", "sines"), 4),
    "craft": (crafts.WRONG, 6),
    "craft_none": ((), 12),
}


@dataclass(frozen=True)
class FurtherSet(HiddenSet):
    """A set whose answer is not only an effect.

    Attributes:
        candidates: what the diagnosis is to try; the catalogue where ``None``.
        asks: what must be said: "effect", "added", "not adequate", "held", "odd", "group",
            "nothing", "periodic", "not periodic", "doubt", "sound".
        about: the names that it must be said of.
    """

    candidates: tuple[object, ...] | None = None
    asks: str = "effect"
    about: tuple[str, ...] = ()


def draw(kind: str, seed: int) -> FurtherSet:
    """The set of a kind and a seed; the same two always give the same set."""
    group, _, name = kind.partition("/")
    rng = np.random.default_rng([zlib.crc32(kind.encode()), seed])
    made = _MAKERS[group](rng, name, seed)
    return replace(made, name=f"{kind} {seed}", group=group)


def _unmeasured(rng: np.random.Generator, name: str, seed: int) -> FurtherSet:
    base = name.removesuffix("_unnamed")
    if base == "tanks":
        train, unseen, model = tanks.drawn(1000 + seed)
        own: dft.Effect = tanks.UpperOverflow()
    else:
        train, unseen, model = hull.drawn(seed)
        own = hull.WayRelief()
    named = base == name
    told = _made(model, train, unseen, truth=(own.name,) if named else ())
    if named:
        return replace(told, candidates=("all", own))
    return replace(told, asks="not adequate")


def _constants(rng: np.random.Generator, name: str, seed: int) -> FurtherSet:
    """A constant is held at some four fifths or five fourths of what it is."""
    if name == "ct":
        plant = plants.thruster_plant(rng, (), False, False, 0.0)
    else:
        plant = plants.vessel_plant(rng, "propeller", (), False, False)
    wrong = plant.parameters[name] * 1.25 ** rng.choice([-1.0, 1.0])
    made = _of_plant(plant, rng)
    model = made.model.replace({name: {"value": wrong, "fixed": True}})
    return replace(made, model=model, asks="held", about=(name,))


def _odd_log(rng: np.random.Generator, name: str, seed: int) -> FurtherSet:
    """Six short logs of one thruster, one of them with another parameter, and an unseen one."""
    plant = plants.thruster_plant(rng, (), False, False, 0.0)
    odd = int(rng.integers(6))
    changed = {name: plant.parameters[name] * 1.3 ** rng.choice([-1.0, 1.0])}
    time, most = 0.05 * np.arange(800), plant.scale["command"]
    logs = []
    for k in range(7):
        command = excitation.rich(rng, time, most)
        own = {**plant.parameters, **(changed if k == odd else {})}
        record = thruster.simulate(time, command, **own, method="rk4", substeps=4)
        read = {n: s.read(rng, record.measured[n]) for n, s in plant.sensors.items()}
        logs.append(dft.Log(time, {"command": command}, read, name=f"run {k + 1}"))
    made = _made(sets.guess(plant, rng), tuple(logs[:6]), logs[6], plant)
    return replace(made, asks="odd", about=(f"run {odd + 1}",))


def _rivals(rng: np.random.Generator, name: str, seed: int) -> FurtherSet:
    """One of two effects, under commands that show no difference between them."""
    pair = ALIKE[name]
    truth = str(rng.choice(pair))
    plant = plants.thruster_plant(rng, (), False, False, 0.0)
    forward = "command_deadband" in pair
    experiments = tuple({"command": _poor(rng, plant, forward)} for _ in range(plants.LOGS))
    most = plant.scale["command"]
    size = {
        "command_deadband": {"band": 0.06 * most},
        "coulomb_friction": {"friction": 0.06 * plant.scale["drive"]},
        "command_delay": {"delay": 0.1},
        "actuator_lag": {"time_constant": 0.1},
    }[truth]
    made = _of_plant(replace(plant, experiments=experiments, hidden={truth: size}), rng)
    return replace(made, truth=(truth,), asks="group", about=pair)


def _poor(rng: np.random.Generator, plant: Plant, forward: bool) -> np.ndarray:
    """Steps in one direction, far from rest; or slow waves, under which a lag is a delay."""
    time, most = plant.time, plant.scale["command"]
    if forward:
        count = int(time[-1] / 5.0) + 1
        steps = shapes.staircase(time, rng.uniform(0.4, 1.0, count), 5.0)
        steps[0] = 0.0
        return most * steps
    waves = [
        rng.uniform(0.2, 0.4) * np.sin(rng.uniform(0.2, 0.6) * time + rng.uniform(0, 6))
        for _ in range(2)
    ]
    return most * sum(waves)


def _too_small(rng: np.random.Generator, name: str, seed: int) -> FurtherSet:
    """A faint effect: 2 logs of 2000 samples show it, by less than 1 % of the squared error."""
    made = sets.draw(f"faint/{name}", int(rng.integers(1 << 30)))
    return replace(_as_further(made), asks="nothing")


def _held(rng: np.random.Generator, name: str, seed: int) -> FurtherSet:
    every = {channel: int(rng.integers(2, 21)) for channel in ("speed", "thrust")}
    return _spoilt(rng, name, lambda channel, series: _kept(series, every[channel]))


def _gaps(rng: np.random.Generator, name: str, seed: int) -> FurtherSet:
    def lost(channel: str, series: np.ndarray) -> np.ndarray:
        out, left = series.copy(), int(rng.uniform(0.02, 0.1) * series.size)
        while left > 0:
            length = min(left, int(rng.integers(1, 60)))
            begin = int(rng.integers(1, series.size - length))
            out[begin : begin + length] = np.nan
            left -= length
        return out

    return _spoilt(rng, name, lost)


def _kept(series: np.ndarray, every: int) -> np.ndarray:
    """A sensor read at every so many samples, its last reading held."""
    return series[np.arange(series.size) // every * every]


def _spoilt(
    rng: np.random.Generator, name: str, sensor: Callable[[str, np.ndarray], np.ndarray]
) -> FurtherSet:
    kind = f"clear/{name}" if name else "none"
    made = _as_further(sets.draw(kind, int(rng.integers(1 << 30))))

    def read(log: dft.Log) -> dft.Log:
        measured = {channel: sensor(channel, series) for channel, series in log.measured.items()}
        return dft.Log(log.time, dict(log.inputs), measured, name=log.name)

    return replace(made, train=tuple(map(read, made.train)), unseen=read(made.unseen))


def _dominated(rng: np.random.Generator, name: str, seed: int) -> FurtherSet:
    """The thrust, or the sway, wanders by one and a half times what the plant does to it."""
    vessel = name == "quadratic_surge_drag"
    group = "vessel/" if vessel else "clear/"
    made = _as_further(sets.draw(group + name if name else "none", int(rng.integers(1 << 30))))
    moved = "sway" if vessel else "thrust"

    def read(log: dft.Log) -> dft.Log:
        series = log.measured[moved]
        wander = lfilter([1.0], [1.0, -0.99], rng.standard_normal(series.size))
        wander *= 1.5 * np.nanstd(series) / np.std(wander)
        measured = {**log.measured, moved: series + wander}
        return dft.Log(log.time, dict(log.inputs), measured, name=log.name)

    made = replace(made, train=tuple(map(read, made.train)), unseen=read(made.unseen))
    return replace(made, asks="added" if name else "nothing", about=made.truth)


def _of_plant(plant: Plant, rng: np.random.Generator) -> FurtherSet:
    logs = tuple(sets.recorded(plant, k, rng, f"run {'ABC'[k]}") for k in range(plants.LOGS))
    return _made(sets.guess(plant, rng), logs[:2], logs[2], plant)


def _made(
    model: dft.Model,
    train: tuple[dft.Log, ...],
    unseen: dft.Log,
    plant: Plant | None = None,
    truth: tuple[str, ...] = (),
) -> FurtherSet:
    nothing = frozenset[str]()
    return FurtherSet("", "", model, train, unseen, truth, nothing, nothing, False, plant)


def _as_further(made: HiddenSet) -> FurtherSet:
    return _made(made.model, made.train, made.unseen, made.plant, made.truth)


def _periodic_force(rng: np.random.Generator, name: str, seed: int) -> FurtherSet:
    made, frequency = periodic.forced(rng, name)
    return replace(_as_further(made), asks="periodic", about=(f"{frequency:.6f}",))


def _periodic_none(rng: np.random.Generator, name: str, seed: int) -> FurtherSet:
    return replace(_as_further(periodic.unforced(rng, name)), asks="not periodic")


def _craft(rng: np.random.Generator, name: str, seed: int) -> FurtherSet:
    drawn = crafts.drawn(rng, name or "nothing")
    made = _made(drawn.model, drawn.train, drawn.unseen, truth=drawn.truth)
    return replace(made, asks=drawn.asks, about=drawn.about)


_MAKERS: dict[str, Callable[[np.random.Generator, str, int], FurtherSet]] = {
    "unmeasured": _unmeasured,
    "constants": _constants,
    "odd_log": _odd_log,
    "rivals": _rivals,
    "too_small": _too_small,
    "held": _held,
    "held_none": _held,
    "gaps": _gaps,
    "gaps_none": _gaps,
    "dominated": _dominated,
    "dominated_none": _dominated,
    "periodic_force": _periodic_force,
    "periodic_none": _periodic_none,
    "craft": _craft,
    "craft_none": _craft,
}
