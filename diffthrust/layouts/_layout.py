"""Layouts: a body, the places of its actuators, and where each number is from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, NamedTuple

from diffthrust._support.errors import InputError
from diffthrust._support.names import nearby
from diffthrust._support.report import Report, Rows, Section
from diffthrust._support.results import Result
from diffthrust._support.words import number
from diffthrust.actuators import StaticThruster
from diffthrust.layouts._mixer import Mixer
from diffthrust.logs._written import PWM
from diffthrust.models._base.component import Vector
from diffthrust.models._base.model import Model
from diffthrust.models._craft.body import Body
from diffthrust.models._craft.craft import Craft

Mark = Literal["measured", "published", "rule of thumb", "unknown"]
MARKS: tuple[Mark, ...] = ("measured", "published", "rule of thumb", "unknown")
"""How far a number is to be trusted: measured on such a vehicle by the source; printed there
without how; an estimate from size or shape; nobody says, and the number only makes it run."""


@dataclass(frozen=True)
class Fact:
    """Numbers of a layout, and where they are from.

    Args:
        values: parameters of the craft by name; or what is said of the places, in one entry.
        mark: one of `MARKS`.
        source: who says so.

    Example:
        >>> dft.layouts.BLUEROV2_HEAVY.facts[0].mark
        'published'
    """

    values: Mapping[str, float | str]
    mark: Mark
    source: str

    def __post_init__(self) -> None:
        if self.mark not in MARKS or not self.source:
            raise InputError(
                f"{listing_of(self.values)}: expected a mark of {MARKS} and a source, found "
                f"{self.mark!r} and {self.source!r}.",
                "Say where the numbers are from.",
            )


def listing_of(values: Mapping[str, float | str]) -> str:
    """Names and values of a fact, as text."""
    return ", ".join(f"{n} {v if isinstance(v, str) else number(v)}" for n, v in values.items())


@dataclass(frozen=True, repr=False)
class Layout(Result):
    """A vehicle as its makers and others describe it, from which a `Craft` is made.

    Args:
        name: the word for spec files, ``frame = "bluerov2"``.
        title: what it is.
        body: its body, with all numbers of the facts.
        actuator: the model of its thrusters.
        places: of each thruster, where it acts [m] and where a positive thrust pushes.
        facts: the numbers by source; a parameter that none names is a default of the body's class.

    Example:
        >>> layout = dft.layouts.BLUEROV2_HEAVY
        >>> rov = layout.craft()
        >>> rov.share[0][:3], layout.values["d11"]
        (('t1', 't2', 't3'), 13.7)
        >>> print(layout.craft(dft.Thruster(command="effort")).actuators["t5"].pointing)
        (0.0, 0.0, 1.0)
    """

    _LAYOUTS: ClassVar[dict[str, Layout]] = {}

    name: str
    title: str
    body: type[Body]
    actuator: Model
    places: Mapping[str, tuple[Sequence[float], Sequence[float]]]
    facts: tuple[Fact, ...] = field(default=())

    def __post_init__(self) -> None:
        self._LAYOUTS[self.name] = self

    @property
    def values(self) -> dict[str, float]:
        """The numbers of the craft's parameters, by name."""
        pairs = (pair for fact in self.facts for pair in fact.values.items())
        return {name: value for name, value in pairs if not isinstance(value, str)}

    def craft(self, actuator: Model | None = None, names: Sequence[str] = ()) -> Craft:
        """The craft: all thrusters of one model with one set of numbers, and a strength each.

        Args:
            actuator: the model of the thrusters; that of the layout by default.
            names: other names of the thrusters, in the order of ``places``.

        Raises:
            InputError: another number of names than there are thrusters.
        """
        names = tuple(names) or tuple(self.places)
        if len(names) != len(self.places):
            raise InputError(
                f"{self.name}: expected names of {len(self.places)} thrusters, found {len(names)}.",
                f"Name them in the order of {', '.join(self.places)}.",
            )
        model = self.actuator if actuator is None else actuator
        mounts: dict[str, Any] = {
            name: model.at(place, pointing)
            for name, (place, pointing) in zip(names, self.places.values(), strict=True)
        }
        body = self.body()
        of_body = {n: v for n, v in self.values.items() if n in body._parameters}
        craft = Craft(body, share=[names], **mounts)
        law = {n: v for n, v in self.values.items() if n not in of_body and actuator is None}
        return craft.replace({**of_body, **{f"{names[0]}.{n}": v for n, v in law.items()}})

    def sources(self, actuator: Model | None = None) -> Report:
        """Where the numbers of its craft are from, with thrusters of this model.

        Args:
            actuator: as of `craft`; of another model than its own the layout has no numbers.

        Example:
            >>> type(dft.layouts.OTTER.sources(dft.Thruster())).__name__
            'Report'
        """
        body = self.body.declared
        facts = [
            fact
            for fact in self.facts
            if actuator is None
            or any(isinstance(v, str) or n in body for n, v in fact.values.items())
        ]
        rows = [(listing_of(fact.values), fact.mark, fact.source) for fact in facts]
        return Report(Section("", self.title, Rows.of(("Numbers", "Mark", "Source"), rows)))

    def _report(self) -> Report:
        return self.sources()


def layout_named(name: str) -> Layout:
    """The ready layout of a name.

    Raises:
        InputError: there is none of that name.

    Example:
        >>> dft.layouts.layout_named("otter").title
        'Maritime Robotics Otter, 2 m, two thrusters'
    """
    layouts = Layout._LAYOUTS
    if name not in layouts:
        raise InputError(
            f"the layout {name!r} is not known; {nearby(name, layouts)}.",
            "Correct the name, or place the thrusters: [thrusters.NAME] with at = [x, y, z].",
        )
    return layouts[name]


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
