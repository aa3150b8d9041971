"""Sets of the bench: a kind and a seed make two training logs, one unseen, and the truth.

A kind is ``class/effect``, ``class/effect+effect`` or ``class``; with ``field-`` in front the
plant is shaken by process noise and read by coloured, spiky, coarse sensors.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

import diffthrust as dft

from . import outside, sizes
from .plants import NEEDS, Plant, thruster_plant, vessel_plant
from .visibility import visibility

FAINT = (30.0, 60.0)
FAINTLY = ("faint", "limit", "vessel_faint")
LIMIT = 0.1

SPEED_EFFECTS = (
    "command_deadband",
    "command_saturation",
    "command_delay",
    "command_offset",
    "actuator_lag",
    "reverse_drive_asymmetry",
    "supply_voltage_sag",
    "linear_damping",
    "coulomb_friction",
    "reverse_load_asymmetry",
    "inflow_load_relief",
    "speed_sensor_offset",
)
PAIRS = (
    "command_deadband+reverse_thrust_asymmetry",
    "actuator_lag+cavitation",
    "coulomb_friction+thrust_sensor_offset",
    "reverse_drive_asymmetry+axial_flow",
    "linear_damping+thrust_sensor_lag",
    "command_offset+thrust_degradation",
    "inflow_load_relief+speed_sensor_offset",
    "command_delay+inflow_thrust_loss",
    "supply_voltage_sag+coulomb_friction",
    "command_saturation+linear_damping",
    "reverse_load_asymmetry+command_delay",
    "command_rate_limit+reverse_thrust_asymmetry",
)
POOR = (
    "command_deadband",
    "linear_damping",
    "coulomb_friction",
    "reverse_thrust_asymmetry",
    "cavitation",
    "thrust_sensor_offset",
    "actuator_lag",
    "reverse_drive_asymmetry",
)
LIMITS = (
    "command_deadband",
    "command_saturation",
    "command_delay",
    "reverse_drive_asymmetry",
    "linear_damping",
    "coulomb_friction",
    "reverse_load_asymmetry",
    "inflow_load_relief",
    "reverse_thrust_asymmetry",
    "axial_flow",
    "cavitation",
    "thrust_sensor_offset",
)
TWIN_ONLY = ("differential_gain", "swapped_thrusters", "force_exponent")
EITHER = (
    "quadratic_surge_drag",
    "quadratic_sway_drag",
    "quadratic_yaw_drag",
    "sway_yaw_coupling",
    "water_current",
    "wind",
)
#: Effects whose sign or form only shows with the track or the heading measured.
TRACKED = ("water_current", "wind", "heading_ripple")

Classes = Mapping[str, tuple[tuple[str, ...], int]]
#: Kinds of each class, with how many sets of each make one round of the bench.
CLASSES: Classes = {
    "clear": (tuple(sizes.THRUSTER), 2),
    "faint": (tuple(sizes.THRUSTER), 2),
    "limit": (LIMITS, 1),
    "none": ((), 10),
    "none_ar": ((), 8),
    "redundant": (tuple(sizes.REDUNDANT), 2),
    "pairs": (PAIRS, 1),
    "outside": (tuple(sizes.OUTSIDE), 2),
    "speed_only": (SPEED_EFFECTS, 1),
    "poor": (POOR, 1),
    "vessel": (tuple(sizes.VESSEL), 1),
    "vessel_faint": (tuple(name for name, row in sizes.VESSEL.items() if row.faint), 1),
    "vessel_none": ((), 4),
    "vessel_outside": (tuple(sizes.VESSEL_OUTSIDE), 1),
    "field-clear": (tuple(sizes.THRUSTER), 1),
    "field-none": ((), 16),
    "field-pairs": (PAIRS[::2], 1),
    "field-outside": (tuple(sizes.OUTSIDE), 1),
    "field-speed_only": (SPEED_EFFECTS[::2], 1),
    "field-poor": (POOR[::2], 1),
    "field-vessel": (tuple(sizes.VESSEL)[::2], 1),
    "field-vessel_none": ((), 4),
    "field-vessel_outside": (tuple(sizes.VESSEL_OUTSIDE), 1),
}


@dataclass(frozen=True)
class HiddenSet:
    """Logs, the model to start from, and what is right.

    Attributes:
        name: kind and seed.
        group: class of the kind, with ``field-`` where it applies.
        model: basic model with wrong guesses of its parameters.
        train, unseen: two logs and one.
        truth: names of the hidden effects that the catalogue has.
        ports: where the signal of an effect outside the catalogue may rightly be placed.
        depends_on: signals on which that effect depends.
        field: whether the conditions are those of the field.
        plant: what made the logs; ``None`` where it is not one of `plants`.
    """

    name: str
    group: str
    model: dft.Model
    train: tuple[dft.Log, ...]
    unseen: dft.Log
    truth: tuple[str, ...]
    ports: frozenset[str]
    depends_on: frozenset[str]
    field: bool
    plant: Plant | None


def draw(kind: str, seed: int) -> HiddenSet:
    """The set of a kind and a seed; the same two always give the same set."""
    group, _, listed = kind.partition("/")
    if group not in CLASSES:
        raise ValueError(f"kind: expected one of {', '.join(CLASSES)} in front, found {kind!r}")
    names = tuple(listed.split("+")) if listed else ()
    field, base = group.startswith("field-"), group.removeprefix("field-")
    rng = np.random.default_rng([zlib.crc32(kind.encode()), seed])
    plant = _plant(rng, base, names, field)
    row = "field" if field else "faint" if base in FAINTLY else "clear"
    chosen = {name: sizes.drawn(name, getattr(sizes.ALL[name], row), rng) for name in names}
    if row == "faint":
        chosen = _faint(plant, chosen)
    if base == "limit":
        chosen = _scaled(chosen, LIMIT)
    plant = replace(plant, hidden=sizes.hidden(chosen, plant.scale))
    if base == "speed_only":
        plant = replace(plant, sensors={"speed": plant.sensors["speed"]})
    logs = tuple(recorded(plant, k, rng, f"{kind} {seed} {'ABC'[k]}") for k in range(3))
    beyond = {**outside.OUTSIDE, **outside.VESSEL_OUTSIDE}
    rows = [beyond[name] for name in names if name in beyond]
    return HiddenSet(
        name=f"{kind} {seed}",
        group=group,
        model=guess(plant, rng),
        train=logs[:2],
        unseen=logs[2],
        truth=() if rows or base == "redundant" else names,
        ports=frozenset().union(*(row.ports for row in rows)),
        depends_on=frozenset().union(*(row.depends_on for row in rows)),
        field=field,
        plant=plant,
    )


def plan(
    count: int | None = None,
    seed: int = 0,
    wanted: tuple[str, ...] = (),
    only_field: bool = False,
    classes: Classes = CLASSES,
) -> list[tuple[str, int]]:
    """Kinds and seeds of a bench, sets of one class together.

    One round holds what `CLASSES` says. Fewer sets are drawn from a round at random, more go on
    with further seeds.

    Args:
        count: number of sets; one round where ``None``.
        seed: of the choice of sets and of the sets themselves.
        wanted: classes or kinds; all where empty.
        only_field: leave out what is not under field conditions.
        classes: those of which a round consists.
    """
    known = kinds(classes)
    tasks = [
        (kind, repeat)
        for kind, repeats in known.items()
        for repeat in range(repeats)
        if (not wanted or kind in wanted or kind.partition("/")[0] in wanted)
        and (kind.startswith("field-") or not only_field)
    ]
    if unknown := set(wanted) - {*classes, *known}:
        raise ValueError(f"no such class or kind: {', '.join(sorted(unknown))}")
    count = len(tasks) if count is None else count
    if count < len(tasks):
        picked = np.random.default_rng(seed).permutation(len(tasks))[:count]
        tasks = [tasks[k] for k in sorted(picked)]
    drawn = []
    for n in range(count):
        kind, repeat = tasks[n % len(tasks)]
        drawn.append((kind, 1000 * seed + repeat + n // len(tasks) * known[kind]))
    order = {kind: k for k, kind in enumerate(known)}
    return sorted(drawn, key=lambda task: (order[task[0]], task[1]))


def kinds(classes: Classes = CLASSES) -> dict[str, int]:
    """Every kind, with how many sets of it make one round."""
    return {
        f"{group}/{name}" if name else group: repeats
        for group, (names, repeats) in classes.items()
        for name in names or ("",)
    }


def _plant(rng: np.random.Generator, base: str, names: tuple[str, ...], field: bool) -> Plant:
    needs = tuple(channel for name in names for channel in NEEDS.get(name, ()))
    if not base.startswith("vessel"):
        correlation = 0.9 if base == "none_ar" else 0.0
        return thruster_plant(rng, needs, field, base == "poor", correlation)
    choices = ["twin"] if set(names) & set(TWIN_ONLY) else ["propeller"]
    if not names or set(names) <= {*EITHER, *sizes.VESSEL_OUTSIDE}:
        choices = ["propeller", "twin"]
    drive = str(rng.choice(choices))
    return vessel_plant(rng, drive, needs, bool(set(names) & set(TRACKED)), field)


def _faint(plant: Plant, chosen: dict[str, float]) -> dict[str, float]:
    """Sizes at which these effects show with a likelihood ratio within `FAINT`.

    Where a threshold makes the ratio jump past that range (a shaft sticks or it does not), the
    smallest size found above it.
    """
    factor, low, high = 1.0, 0.0, np.inf
    for _ in range(10):
        trial = replace(plant, hidden=sizes.hidden(_scaled(chosen, factor), plant.scale))
        ratio = visibility(trial, rounds=1).ratio
        if FAINT[0] <= ratio <= FAINT[1]:
            return _scaled(chosen, factor)
        low, high = (factor, high) if ratio < FAINT[0] else (low, factor)
        # The ratio grows with the square of the size, but for effects that have a threshold.
        step = np.sqrt(np.sqrt(FAINT[0] * FAINT[1]) / max(ratio, 1e-9))
        factor *= float(np.clip(step, 0.3, 3.0))
        if not low < factor < high:
            factor = float(np.sqrt(max(low, 0.1 * high) * high))
    if high == np.inf:
        raise RuntimeError(f"{', '.join(chosen)}: no size that was tried shows in these logs")
    return _scaled(chosen, high)


def _scaled(chosen: dict[str, float], factor: float) -> dict[str, float]:
    return {name: factor * size for name, size in chosen.items()}


def recorded(plant: Plant, index: int, rng: np.random.Generator, name: str) -> dft.Log:
    """One of a plant's experiments as its sensors read it."""
    record = plant.run(index, rng)
    return dft.Log(record.time, record.inputs, record.measured, name=name)


def guess(plant: Plant, rng: np.random.Generator) -> dft.Model:
    """The basic model, its parameters off by some 20 %; a vessel's lever arm is measured."""
    off = {name: value * np.exp(0.2 * rng.standard_normal()) for name, value in _free(plant)}
    if plant.system == "thruster":
        return dft.Thruster(**off)
    model = dft.Vessel(plant.system, **off)
    return model.replace(lever_arm=plant.parameters["lever_arm"])


def _free(plant: Plant) -> list[tuple[str, float]]:
    held = {"lever_arm", *(("exponent",) if plant.system == "twin" else ())}
    return [(name, value) for name, value in plant.parameters.items() if name not in held]
