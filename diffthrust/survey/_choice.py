"""Columns of a file as candidates for channels, and those chosen."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from diffthrust.layouts._layout import RecordedLayout
from diffthrust.logs._columns import Column
from diffthrust.logs._contents import Contents
from diffthrust.logs._tables.table import Field
from diffthrust.logs._tables.text import times_of_day
from diffthrust.logs._units import convert
from diffthrust.survey._guess import LIKELY, PERHAPS, SURE, Meaning
from diffthrust.survey._values import numbers_of, varies

_CERTAINTY = (SURE, LIKELY, PERHAPS)
FIRMLY = 0.5
"""Two columns with at least this correlation move together."""


@dataclass(frozen=True)
class Pick:
    """A column with its assumed meaning; once chosen, its role: "input", "measured" or "time".

    ``alternatives`` are columns that may be the channel as well.
    """

    field: Field
    meaning: Meaning
    role: str = ""
    unsigned: bool = False
    alternatives: tuple[str, ...] = ()

    def chosen(self, role: str, rivals: Sequence[Pick] = ()) -> Pick:
        """The same in a role, for which the rivals were candidates, too."""
        names = tuple(r.field.name for r in rivals if r.field is not self.field)
        return replace(self, role=role, alternatives=names)

    def meant(self, **changes: Any) -> Pick:
        """The same with another meaning."""
        return replace(self, meaning=replace(self.meaning, **changes))

    def doubted(self, word: str) -> Pick:
        """The same with a further doubt."""
        return self.meant(doubts=(*self.meaning.doubts, word))

    def turned(self, word: str) -> Pick:
        """The same with the other sign, and the doubt on it."""
        return self.meant(scale=-self.meaning.scale).doubted(word)

    @property
    def stop(self) -> float:
        """The number at which a drive stands still."""
        return self.meaning.pwm.stop if self.meaning.pwm else 0.0

    @property
    def column(self) -> Column:
        """The column as a spec file describes it."""
        meaning = self.meaning
        return Column(
            self.field.name,
            unit=meaning.spec_unit,
            unsigned=self.unsigned,
            scale=meaning.scale,
            offset=meaning.offset,
            pwm=meaning.pwm,
            effort=meaning.unit == "percent",
        )


@dataclass(frozen=True)
class Choice:
    """The model that suits a file, and the column of each of its channels.

    ``spare`` are columns that the model or its effects may use, ``held`` parameters that this
    log cannot determine. ``time`` is None in a static table, and if messages have time stamps;
    ``step`` [s] is that of rows whose stamps are too coarse.
    """

    contents: Contents
    columns: tuple[Pick, ...]
    model: str | None = None
    channels: Mapping[str, Pick] = field(default_factory=dict)
    spare: Mapping[str, Pick] = field(default_factory=dict)
    time: Pick | None = None
    step: float | None = None
    doubts: tuple[str, ...] = ()
    held: tuple[str, ...] = ()
    craft: RecordedLayout | None = None

    def doubted(self, *words: str) -> Choice:
        """The same with further doubts."""
        return replace(self, doubts=(*self.doubts, *words))

    @property
    def timed(self) -> dict[str, Pick]:
        """The time, where a column has it, and the channels."""
        return {**({"time": self.time} if self.time else {}), **self.channels}

    @property
    def static(self) -> bool:
        """Whether it is a table without time."""
        return self.time is None and not self.contents.messages

    @property
    def seconds(self) -> np.ndarray | None:
        """The time stamps of a table [s]; None for a static table, and if messages have stamps."""
        if self.time is None:
            return None
        clock = self.time.field
        if self.step is not None:
            return self.step * np.arange(clock.values.size)
        unit = self.time.meaning.unit or "s"
        of_day = times_of_day(clock.values) if unit == "s" else None
        return convert(clock.values, unit, "s", where=clock.name) if of_day is None else of_day


class Pool:
    """The columns by quantity: moving columns first, then by certainty."""

    def __init__(self, columns: Sequence[Pick]) -> None:
        self.by: dict[str, list[Pick]] = {}
        for pick in columns:
            if pick.meaning.quantity and numbers_of(pick.field.values).size:
                self.by.setdefault(pick.meaning.quantity, []).append(pick)
        for picks in self.by.values():
            picks.sort(key=_unlikely)

    def all(self, quantity: str, *, moving: bool = False) -> list[Pick]:
        """The columns of a quantity, the most likely first."""
        picks = self.by.get(quantity, [])
        return [p for p in picks if not moving or varies(p.field.values)]

    def pick(self, quantity: str, role: str) -> Pick | None:
        """The most likely column of a quantity; a measured one must vary."""
        picks = self.all(quantity, moving=role == "measured")
        return picks[0].chosen(role, picks) if picks else None

    def picks(self, quantities: Iterable[str], role: str) -> dict[str, Pick]:
        """The most likely column of each quantity that has one."""
        picks = {name: self.pick(name, role) for name in quantities}
        return {name: pick for name, pick in picks.items() if pick is not None}

    def sides(self, quantity: str) -> tuple[Pick, Pick] | None:
        """The left and the right column of a quantity."""
        sides = {p.meaning.side: p.chosen("input") for p in reversed(self.all(quantity))}
        return (sides["left"], sides["right"]) if {"left", "right"} <= sides.keys() else None


def _unlikely(pick: Pick) -> tuple[bool, bool, int]:
    # A constant column is a setting or a dead sensor, and "relative" a copy of a time stamp or a
    # position counted from its first value.
    name, values = pick.field.name, pick.field.values
    return not varies(values), "relative" in name, _CERTAINTY.index(pick.meaning.sure)
