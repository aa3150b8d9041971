"""Columns of a file as candidates for channels, and those chosen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from diffthrust.layouts._recorded import RecordedLayout
from diffthrust.logs._contents import Contents, Field
from diffthrust.logs._units import convert
from diffthrust.survey._guess import LIKELY, PERHAPS, SURE, Meaning
from diffthrust.survey._values import numbers_of, varies

_RANK = {SURE: 0, LIKELY: 1, PERHAPS: 2}
FIRMLY = 0.5
"""Two columns with at least this correlation move together."""


@dataclass(frozen=True)
class Pick:
    """A column chosen for a channel.

    Args:
        field: the column.
        meaning: its assumed meaning.
        role: "input" or "measured".
        unsigned: it holds the absolute value of a signed quantity.
        doubts: other possible readings, one sentence each.
        alternatives: columns that may be the channel as well.
    """

    field: Field
    meaning: Meaning
    role: str
    unsigned: bool = False
    doubts: tuple[str, ...] = ()
    alternatives: tuple[str, ...] = ()

    def doubted(self, *words: str) -> Pick:
        """The same pick with further doubts."""
        return replace(self, doubts=(*self.doubts, *words))


@dataclass(frozen=True)
class Choice:
    """The model that suits a file, and its channels.

    Args:
        contents: the file.
        meanings: the assumed meaning of each field.
        model: name of the model; None if none is suited.
        channels: the column of each channel.
        spare: further columns that the model or its effects may use.
        time: the time column; None in a static table, and if messages have time stamps.
        step: step of the rows [s] if their time stamps are too coarse.
        doubts: open questions for the user, one sentence each.
        held: parameters that this log cannot determine; the draft fixes them.
        craft: the thrusters by the settings of an autopilot, where the model is a craft of them.
    """

    contents: Contents
    meanings: tuple[Meaning, ...]
    model: str | None = None
    channels: Mapping[str, Pick] = field(default_factory=dict)
    spare: Mapping[str, Pick] = field(default_factory=dict)
    time: Pick | None = None
    step: float | None = None
    doubts: tuple[str, ...] = ()
    held: tuple[str, ...] = ()
    craft: RecordedLayout | None = None

    @property
    def static(self) -> bool:
        """Whether it is a table without time."""
        return self.time is None and not self.contents.messages

    @property
    def seconds(self) -> np.ndarray | None:
        """The time stamps of a table [s]; None for a static table, and if messages have stamps."""
        if self.time is None:
            return None
        clock = self.time
        if self.step is not None:
            return self.step * np.arange(clock.field.values.size)
        return convert(clock.field.values, clock.meaning.unit or "s", "s", where=clock.field.name)


class Pool:
    """The columns by quantity: moving columns first, then by certainty."""

    def __init__(self, fields: Sequence[Field], meanings: Sequence[Meaning]) -> None:
        self.by: dict[str, list[tuple[Field, Meaning]]] = {}
        for column, meaning in zip(fields, meanings, strict=True):
            if meaning.quantity and numbers_of(column.values).size:
                self.by.setdefault(meaning.quantity, []).append((column, meaning))
        for pairs in self.by.values():
            pairs.sort(
                # A constant column is a setting or a dead sensor, and "relative" a copy of a time
                # stamp or a position counted from its first value.
                key=lambda p: (not varies(p[0].values), "relative" in p[0].name, _RANK[p[1].sure])
            )

    def all(self, quantity: str, *, moving: bool = False) -> list[tuple[Field, Meaning]]:
        pairs = self.by.get(quantity, [])
        return [p for p in pairs if not moving or varies(p[0].values)]

    def pick(self, quantity: str, role: str) -> Pick | None:
        """The most likely column of a quantity; a measured one must vary."""
        pairs = self.all(quantity, moving=role == "measured")
        if not pairs:
            return None
        column, meaning = pairs[0]
        alternatives = [rival.name for rival, _ in pairs[1:]]
        return Pick(column, meaning, role, doubts=meaning.doubts, alternatives=tuple(alternatives))

    def picks(self, quantities: Sequence[str], role: str) -> dict[str, Pick]:
        picks = {name: self.pick(name, role) for name in quantities}
        return {name: pick for name, pick in picks.items() if pick is not None}

    def sides(self, quantity: str) -> tuple[Pick, Pick] | None:
        """The left and the right column of a quantity."""
        picks = []
        for side in ("left", "right"):
            pairs = [p for p in self.all(quantity) if p[1].side == side]
            if not pairs:
                return None
            column, meaning = pairs[0]
            picks.append(Pick(column, meaning, "input", doubts=meaning.doubts))
        return picks[0], picks[1]
