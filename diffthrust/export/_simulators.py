"""A thruster as simulators of vehicles describe it: gz-sim, uuv_simulator, Stonefish.

What each of them works out, with the source that was read for it:

- gz-sim, ``src/systems/thruster/Thruster.cc`` (commit 6a9a7cb): the force is
  thrust_coefficient fluid_density propeller_diameter^4 w |w| of the commanded speed w [rad/s].
- uuv_simulator, ``Dynamics.cc``, ``ThrusterConversionFcn.cc`` and ``ThrusterPlugin.cc`` (commits
  b2f9e58, 668e4ff, 1fab55a): the command, held within clampMin and clampMax and times gain, drives
  a first-order state, which a conversion turns into the force.
- Stonefish, ``ActuatorDynamics.h`` and ``Thruster.cpp`` (of 2024 and later): the same, and the
  speed is held within twice ``max_setpoint``, whatever its unit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from textwrap import wrap
from typing import TypeVar

from diffthrust._support.errors import InputError
from diffthrust._support.words import humanize, number
from diffthrust.export._rotor import Rotor, rotor_of
from diffthrust.export._source import ExportSource, filled_in
from diffthrust.logs._written import ShownUnits
from diffthrust.models._craft.craft import Craft
from diffthrust.models._craft.placed import Placed

_V = TypeVar("_V")
Limits = tuple[float, float] | None
"""Lowest and highest command, in the unit of the logs; those of the logs where not given."""
DENSITY, DIAMETER = 1000.0, 0.1
"""[kg/m^3] and [m] by which gz-sim's coefficient is made; only their product with it counts."""
_STUCK_CLOCK = (
    "uuv_simulator as published never moves on the clock of its Yoerger and Bessa dynamics, so "
    "that their steps grow with the time: add 'prevTime = _t;' before 'return state;' to both "
    "update() in Dynamics.cc."
)


def to_simulator(to: str, source: ExportSource, name: str, limits: Limits) -> tuple[str, list[str]]:
    """The thruster, or those of a craft, as a simulator describes it, and notes on what it cannot.

    Raises:
        InputError: a thruster that the simulator has no place for; of a craft, by its name.
    """
    if isinstance(source.model, Craft):
        return _of_craft(to, source, name, limits)
    rotor = rotor_of(source, limits)
    template, notes_of = _SIMULATORS[to]
    notes = notes_of(rotor)
    text = filled_in(
        template,
        name=name,
        model=source.model,
        rotor=rotor,
        head_lines=[line for text in source.head for line in wrap(text, 90)],
        notes=[wrap(note, 90) for note in notes],
        version=source.version,
        up=_pose(source, upwards=True),
        down=_pose(source, upwards=False),
        ct=rotor.coefficients[0],
        density=DENSITY,
        diameter=DIAMETER,
    )
    return text, notes


def _gz_notes(rotor: Rotor) -> list[str]:
    if rotor.dynamics == "zero_order":
        notes = ["Send it the force of each command [N], on .../cmd_thrust; 'lut' has the table."]
        return [*notes, *_left_out(rotor, "gz-sim")]
    ahead, astern = rotor.coefficients
    notes = [
        "gz-sim has no rotor dynamics: the speed follows at once. Send it the speed that this "
        "model, exported to c or python, gives, on .../cmd_vel.",
    ]
    if ahead != astern:
        notes.append(
            f"gz-sim has one coefficient for both directions: astern the force is "
            f"{number(astern / ahead, 3)} times that of the plugin."
        )
    if not rotor.quadratic:
        notes.append("The force is not proportional to speed |speed|, as gz-sim takes it to be.")
    return [*notes, *_left_out(rotor, "gz-sim")]


def _uuv_notes(rotor: Rotor) -> list[str]:
    stuck = [_STUCK_CLOCK] if rotor.dynamics in ("yoerger", "bessa") else []
    return [*rotor.notes, *_left_out(rotor, "uuv_simulator"), *stuck]


def _stonefish_notes(rotor: Rotor) -> list[str]:
    full = f"A set point of 1 stands for {number(rotor.largest, 4)} {rotor.unit}"
    if rotor.dynamics != "zero_order":
        full += (
            ": Stonefish holds the speed within twice max_setpoint, whatever its unit, so that "
            "this is the speed at full command"
        )
    notes = [*rotor.notes, f"{full}.", *_left_out(rotor, "Stonefish")]
    if abs(rotor.low + rotor.high) > 1e-9 * rotor.largest:
        notes.append(
            f"Stonefish takes set points as far astern as ahead: keep the command from "
            f"{number(rotor.low, 4)} to {number(rotor.high, 4)} {rotor.unit} yourself."
        )
    return notes


_SIMULATORS: Mapping[str, tuple[str, Callable[[Rotor], list[str]]]] = {
    "gz": ("gz.sdf", _gz_notes),
    "uuv": ("uuv.xacro", _uuv_notes),
    "stonefish": ("stonefish.scn", _stonefish_notes),
}
"""The template of each, and what it cannot express."""


def _pose(source: ExportSource, *, upwards: bool) -> tuple[str, str] | None:
    """Place [m] and roll, pitch, yaw [rad] of a thruster of a craft, if any: it pushes along its x.

    In axes forward, to port, up, as gz-sim and uuv_simulator have them; otherwise forward, to
    starboard, down, as Stonefish.
    """
    if source.mounted is None:
        return None
    turn = -1.0 if upwards else 1.0
    (x, y, z), (a, b, c) = source.mounted.place, source.mounted.pointing
    b, c = turn * b, turn * c
    angles = (0.0, math.asin(max(-1.0, min(1.0, -c))), math.atan2(b, a))
    place = (x, turn * y, turn * z)
    first, second = (" ".join(f"{v + 0.0:.6g}" for v in row) for row in (place, angles))
    return first, second


def _left_out(rotor: Rotor, target: str) -> list[str]:
    """A sentence on each effect that has no place."""
    mends = {False: "it is left out.", True: "do it to the command before you send it."}
    return [
        f"{target} has no place for the effect '{effect.name}' ({humanize(effect.name)}): "
        + mends["command" in effect.ports]
        for effect in rotor.left_out
    ]


def _of_craft(to: str, source: ExportSource, name: str, limits: Limits) -> tuple[str, list[str]]:
    """The thrusters of a craft one after the other, and the notes on all of them."""
    texts, notes = [], ["The hull is left out: simulators describe its mass and drag elsewhere."]
    for part, thruster in thrusters_of(source):
        try:
            text, remarks = to_simulator(to, thruster, f"{name}_{part}", limits)
        except InputError as error:
            raise InputError(f"{part}: {error.problem}", error.mend) from None
        texts.append(text.strip("\n"))
        notes += remarks
    return "\n\n".join(texts) + "\n", [*dict.fromkeys(notes)]


def thrusters_of(source: ExportSource) -> Iterator[tuple[str, ExportSource]]:
    """Each thruster of a craft by itself: with the effects on it, its place and its strength."""
    craft = source.model
    assert isinstance(craft, Craft)
    errors, owners = source.errors, {n: group[0] for group in craft.groups() for n in group}
    for name, mounted in craft.actuators.items():
        model = craft.actuator(name)
        named = {n: f"{owners[name]}.{n}" for n in model.parameters}
        for effect in craft.effects:
            if isinstance(effect, Placed) and name in effect.members:
                inner = effect.inner
                model = model + inner
                named |= {f"{inner.name}.{k}": f"{effect.name}.{k}" for k in inner._parameters}
        own = {n: f"{name}.{n}" for n in ("strength", "x", "y", "z")}
        present = {n: full for n, full in {**named, **own}.items() if full in craft.parameters}
        x, y, z = (craft.parameters[f"{name}.{axis}"].value for axis in "xyz")
        strength = craft.parameters.get(f"{name}.strength")
        units = ShownUnits((_short(source.units.written, name),))
        yield (
            name,
            replace(
                source,
                model=model,
                inputs=_short(source.inputs, name),
                ranges=_short(source.ranges, name),
                linear=tuple(_short(dict.fromkeys(source.linear), name)),
                errors={n: errors[full] for n, full in present.items() if full in errors},
                provenance=(*source.provenance, *_marks(craft, name, present, errors)),
                units=units,
                mounted=replace(mounted, place=(x, y, z)),
                strength=1.0 if strength is None else float(strength.value),
            ),
        )


def _short(named: Mapping[str, _V], name: str) -> dict[str, _V]:
    """What belongs to a thruster, by its short names."""
    prefix = f"{name}."
    return {n.removeprefix(prefix): v for n, v in named.items() if n.startswith(prefix)}


def _marks(
    craft: Craft, name: str, present: Mapping[str, str], errors: Mapping[str, float]
) -> Iterator[str]:
    """Where each number is from: estimated, with its error, or held."""
    yield f"Thruster {name}:"
    for short, full in present.items():
        p = craft.parameters[full]
        unit = f" {p.unit}" if p.unit else ""
        if full in errors:
            mark = f"estimated, standard error {errors[full]:.2g}"
        else:
            mark = "held" if p.fixed else "not fitted"
        yield f"{short} = {p.value:.6g}{unit}: {mark}."
