"""A layout: a body, the places of its actuators, and where each number is from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

from diffthrust._support.errors import InputError
from diffthrust._support.names import nearby
from diffthrust._support.report import Report, Rows, Section
from diffthrust._support.results import Result
from diffthrust._support.words import number
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
