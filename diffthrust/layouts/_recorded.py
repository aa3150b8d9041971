"""Where the thrusters of a vehicle are, as the settings of its autopilot have it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from diffthrust._support.report import Report, Rows, Section
from diffthrust._support.results import Result
from diffthrust._support.words import number
from diffthrust.actuators import StaticThruster
from diffthrust.layouts._layout import Fact, listing_of
from diffthrust.layouts._mixer import Mixer
from diffthrust.logs._written import PWM
from diffthrust.models._base.mounted import Vector
from diffthrust.models._craft.body import Body
from diffthrust.models._craft.craft import Craft


class CommandColumn(NamedTuple):
    """A field of a log that holds the command of a thruster.

    Args:
        name: message and field.
        pwm: its pulse widths; ``None`` for a share of the full command.

    Example:
        >>> dft.layouts.CommandColumn("actuator_motors.control[0]", None).name
        'actuator_motors.control[0]'
    """

    name: str
    pwm: PWM | None


@dataclass(frozen=True)
class RecordedThruster:
    """One thruster by an autopilot's settings.

    Args:
        place: where it acts [m].
        pointing: where a positive command pushes the craft.
        columns: fields that may hold its command, the best first.
        strength: its force beside the first thruster's.
        reaction: torque per thrust [m], where the settings have one.

    Example:
        >>> from diffthrust.layouts import RecordedThruster
        >>> RecordedThruster((0.0, 0.3, 0.0), (1.0, 0.0, 0.0), ()).strength
        1.0
    """

    place: Vector
    pointing: Vector
    columns: tuple[CommandColumn, ...]
    strength: float = 1.0
    reaction: float | None = None


@dataclass(frozen=True, repr=False, eq=False)
class RecordedLayout(Result):
    r"""A craft by the settings of its autopilot; made by `layout_in`.

    Axes are those of the craft: x forward, y to starboard, z down (FRD), as both ArduPilot and PX4
    have them.

    Args:
        title: the autopilot and its frame.
        body: the class of its body.
        thrusters: by name.
        mixer: what the autopilot sends to each thruster for its commands.
        facts: where each thing is from.

    Example:
        >>> with open("rov.param", "w") as file:
        ...     _ = file.write("FRAME_CONFIG,1\nMOT_3_DIRECTION,-1\n")
        >>> layout = dft.layouts.layout_in("rov.param")
        >>> layout.title, layout.thrusters["m3"].columns[0].name
        ('ArduSub, FRAME_CONFIG 1 (vectored), six thrusters', 'RCOU.C3')
        >>> layout.craft().actuators["m3"].pointing
        (-0.707106781187, -0.707106781187, 0.0)
    """

    title: str
    body: type[Body]
    thrusters: Mapping[str, RecordedThruster]
    mixer: Mixer
    facts: tuple[Fact, ...] = ()

    def craft(self) -> Craft:
        """The craft: thrusters of one model with one set of numbers, and a strength each."""
        names = tuple(self.thrusters)
        mounts: dict[str, Any] = {
            name: StaticThruster().at(t.place, t.pointing, reaction=t.reaction)
            for name, t in self.thrusters.items()
        }
        craft = Craft(self.body(), share=[names], **mounts)
        strengths = {f"{n}.strength": t.strength for n, t in self.thrusters.items()}
        return craft.replace({n: v for n, v in strengths.items() if n in craft.parameters})

    def _line(self) -> str:
        return self.title

    def _report(self) -> Report:
        rows = []
        for name, t in self.thrusters.items():
            place = (number(each, 3) for each in t.place)
            pointing = ", ".join(f"{each:.3g}" for each in t.pointing)
            rows.append((name, *place, pointing, t.columns[0].name if t.columns else "-"))
        headings = ("Thruster", "Ahead [m]", "Starboard [m]", "Down [m]", "Pushes", "Command")
        facts = [(listing_of(fact.values), fact.mark, fact.source) for fact in self.facts]
        return Report(
            Section("", self.title, Rows.of(headings, rows, numbers=(1, 2, 3))),
            Section("", Rows.of(("What", "Mark", "Source"), facts)),
        )


def vector(values: Iterable[float]) -> Vector:
    """Three numbers of single precision, as parameters have them, without their last digits."""
    x, y, z = (round(float(v), 6) + 0.0 for v in values)
    return x, y, z
