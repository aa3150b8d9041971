"""The layout of a craft: as a table, and drawn from above and from the side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from diffthrust._support.figures import BLUE, GREY, VERMILLION, unboxed
from diffthrust._support.report import Report, Rows, Section
from diffthrust._support.words import number
from diffthrust.models._base.component import Vector
from diffthrust.models._craft.actuators import Actuators
from diffthrust.models._craft.placed import place_of
from diffthrust.models._craft.sensor import Sensors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ARROW = 0.28
"""Length of an arrow, as a share of the drawing."""
_SIDEWAYS = 0.15
"""An arrow whose part in the plane is shorter comes towards the reader, or goes from him."""


class LaidOut(NamedTuple):
    """A part: where it is [m], if that matters, and where it pushes; a sensor pushes nowhere.

    Of an actuator also the unit of its command and whose numbers it has; of a sensor its axes.
    """

    name: str
    model: str
    place: tuple[float, ...]
    pointing: Vector | None = None
    turns: bool = False
    command: str = ""
    numbers: str = ""
    axes: str = ""


def laid_out(actuators: Actuators, sensors: Sensors, values: Mapping[str, Any]) -> list[LaidOut]:
    """All parts, at their places by the values of the craft."""
    parts = []
    for name, mounted in actuators.items():
        place = place_of(name, values)
        turns = "side_thrust" in mounted.model.outputs
        owner = actuators.owner(name)
        command = ", ".join(unit or "-" for unit in mounted.model.inputs.values())
        numbers = "its own" if owner == name else f"like {owner}"
        fields = (name, str(mounted.model), place, mounted.pointing, turns, command, numbers)
        parts.append(LaidOut(*fields))
    for name, mounted in sensors.items():
        sensor = mounted.model
        place = place_of(name, values) if sensor.placed else ()
        parts.append(LaidOut(name, sensor.name, place, axes=sensor.frame))
    return parts


def layout_report(body: str, parts: Sequence[LaidOut]) -> Report:
    """The parts as a table."""
    rows = []
    for part in parts:
        place = [number(each, 3) for each in part.place] or ["", "", ""]
        pointing = ", ".join(f"{each:.3g}" for each in part.pointing or ())
        row = part.name, part.model, *place, pointing, part.command, part.numbers, part.axes
        rows.append(row)
    places = ("Ahead [m]", "Starboard [m]", "Down [m]")
    headings = ("Part", "Model", *places, "Pushes", "Command", "Numbers", "Axes")
    if all(part.pointing for part in parts):  # no sensor
        headings, rows = headings[:-1], [row[:-1] for row in rows]
    title = f"Craft of the body '{body}'"
    return Report(Section("", title, Rows.of(headings, rows, numbers=(2, 3, 4))))


def craft_figure(title: str, parts: Sequence[LaidOut], centre: tuple[float, ...]) -> Figure:
    """The craft from above, bow up, and from starboard, bow to the right.

    Arrows show where a positive thrust pushes the craft; a dot comes towards the reader, a cross
    goes away. Squares are sensors. ``centre`` is the centre of mass.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 4.4), layout="constrained")
    above, side = figure.subplots(1, 2)
    parts = [part for part in parts if part.place]
    # from above: starboard to the right, the bow up; the reader sees what goes down go away
    _view(above, parts, centre, axes=(1, 0), towards=(2, -1.0))
    above.set_xlabel("to starboard [m]", fontsize=9)
    above.set_ylabel("ahead [m]", fontsize=9)
    above.set_title("From above", loc="left", fontsize=9)
    # from starboard: the bow to the right, down is down; the reader sees starboard come
    _view(side, parts, centre, axes=(0, 2), towards=(1, 1.0))
    side.invert_yaxis()
    side.set_xlabel("ahead [m]", fontsize=9)
    side.set_ylabel("down [m]", fontsize=9)
    side.set_title("From starboard", loc="left", fontsize=9)
    figure.suptitle(title, x=0.02, ha="left", fontsize=10)
    return figure


def _view(
    panel: Axes,
    parts: Sequence[LaidOut],
    centre: tuple[float, ...],
    axes: tuple[int, int],
    towards: tuple[int, float],
) -> None:
    across, up = axes
    points = np.array([a.place for a in parts] + [centre])
    span = max(np.ptp(points[:, 0]), np.ptp(points[:, 1]), np.ptp(points[:, 2]), 0.2)
    length = _ARROW * span
    groups: dict[tuple[float, float], list[str]] = {}
    behind: dict[tuple[float, float], tuple[float, float]] = {}
    for a in parts:
        x, y = a.place[across], a.place[up]
        at, flipped = (round(x, 3), round(y, 3)), -1.0 if up == 2 else 1.0
        groups.setdefault(at, []).append(a.name)
        if a.pointing is None:
            panel.plot(x, y, "s", color=GREY, markersize=5)
            # from above most stand on one line, one behind the other
            behind.setdefault(at, (-1.0, 0.0) if across == 1 else (0.0, 1.0))
            continue
        dx, dy = a.pointing[across], a.pointing[up]
        if np.hypot(dx, dy) > _SIDEWAYS:
            style = {"arrowstyle": "-|>", "color": BLUE, "linewidth": 1.6, "mutation_scale": 12}
            end = (x + length * dx, y + length * dy)
            panel.annotate("", end, (x, y), arrowprops=style)
        else:
            comes = a.pointing[towards[0]] * towards[1] > 0
            panel.plot(x, y, "o", color="white", markeredgecolor=BLUE, markersize=10)
            panel.plot(x, y, "." if comes else "x", color=BLUE, markersize=5)
        if a.turns and across == 1:
            ring = np.linspace(0.0, 2.0 * np.pi, 60)
            panel.plot(x + 0.6 * length * np.cos(ring), y + 0.6 * length * np.sin(ring), ":",
                       color=BLUE, linewidth=0.9)  # fmt: skip
        panel.plot(x, y, "o", color=BLUE, markersize=3)
        # on the side from which the arrow leaves; above what comes or goes
        flat = np.hypot(dx, dy) > _SIDEWAYS
        behind.setdefault(at, (-dx, -dy * flipped) if flat else (0.0, 1.0))
    for (x, y), names in groups.items():
        words = ", ".join(names)
        if len(names) > 1:  # beside the point they would run over the numbers of the axis
            behind[x, y] = (0.0, 1.0)
        offset = ((8.0 + 3.0 * len(words)) * behind[x, y][0], 14.0 * behind[x, y][1])
        panel.annotate(words, (x, y), xytext=offset, textcoords="offset points",
                       fontsize=8, ha="center", va="center")  # fmt: skip
    panel.plot(centre[across], centre[up], "+", color=VERMILLION, markersize=11, mew=1.8)
    panel.annotate("CG", (centre[across], centre[up]), xytext=(6, -11),
                   textcoords="offset points", fontsize=8, color=VERMILLION)  # fmt: skip
    panel.axhline(0.0, color=GREY, linewidth=0.6, zorder=0)
    panel.axvline(0.0, color=GREY, linewidth=0.6, zorder=0)
    unboxed(panel)
    middle = 0.5 * (points.min(0) + points.max(0))
    half = 0.5 * span + 1.3 * length
    panel.set_xlim(middle[across] - half, middle[across] + half)
    panel.set_ylim(middle[up] - half, middle[up] + half)
    panel.set_box_aspect(1)
