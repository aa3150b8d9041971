"""How the parts of a craft are laid out: their places and directions, for a table and a figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from diffthrust._support.report import Report, Rows, Section
from diffthrust._support.words import number
from diffthrust.models._base.mounted import Vector
from diffthrust.models._craft.actuators import Actuators
from diffthrust.models._craft.scope import place_of
from diffthrust.models._craft.sensor import Sensors


class LaidOut(NamedTuple):
    """A part of a craft.

    Args:
        name: its name.
        model: that of its model.
        place: where it is [m]; empty where that does not matter.
        pointing: where it pushes; ``None`` of a sensor.
        turns: whether it pushes across as well.
        note: whose numbers it has, or the axes of its readings.
    """

    name: str
    model: str
    place: tuple[float, ...]
    pointing: Vector | None = None
    turns: bool = False
    note: str = ""


def laid_out(actuators: Actuators, sensors: Sensors, values: Mapping[str, Any]) -> list[LaidOut]:
    """All parts, at their places by the values of the craft."""
    parts = []
    for name, mounted in actuators.items():
        model, place, owner = mounted.model, place_of(name, values), actuators.owner(name)
        like = "" if owner == name else f"like {owner}"
        turns = "side_thrust" in model.outputs
        parts.append(LaidOut(name, str(model), place, mounted.pointing, turns, like))
    for name, mounted in sensors.items():
        sensor = mounted.model
        place = place_of(name, values) if sensor.placed else ()
        parts.append(LaidOut(name, sensor.name, place, note=sensor.frame))
    return parts


def layout_report(body: str, parts: Sequence[LaidOut]) -> Report:
    """The parts as a table."""
    rows = []
    for part in parts:
        place = [number(each, 3) for each in part.place] or ["", "", ""]
        pointing = ", ".join(f"{each:.3g}" for each in part.pointing or ())
        rows.append((part.name, part.model, *place, pointing, part.note))
    headings = ("Part", "Model", "Ahead [m]", "Starboard [m]", "Down [m]", "Pushes", "")
    title = f"Craft of the body '{body}'"
    return Report(Section("", title, Rows.of(headings, rows, numbers=(2, 3, 4))))
