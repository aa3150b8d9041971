"""The columns of a file as candidates for channels, and what is chosen of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from diffthrust.logs._contents import Contents, Field
from diffthrust.logs._units import convert
from diffthrust.survey._guess import LIKELY, PERHAPS, SURE, Meaning
from diffthrust.survey._values import numbers_of, varies

_RANK = {SURE: 0, LIKELY: 1, PERHAPS: 2}
FIRMLY = 0.5
"""Correlation from which on two columns are said to move together."""


@dataclass(frozen=True)
class Pick:
    """A column chosen for a channel.

    Args:
        field: the column.
        meaning: what it is taken for.
        role: "input" or "measured".
        unsigned: it holds the size of what goes both ways.
        doubts: what else may be, one sentence each.
        others: columns that may be the channel just as well.
    """

    field: Field
    meaning: Meaning
    role: str
    unsigned: bool = False
    doubts: tuple[str, ...] = ()
    others: tuple[str, ...] = ()

    def doubted(self, *words: str) -> Pick:
        """The same with more doubts."""
        return replace(self, doubts=(*self.doubts, *words))


@dataclass(frozen=True)
class Choice:
    """The model that suits a file, and its channels.

    Args:
        contents: the file.
        meanings: what each of its fields is taken for.
        model: name of the model; None where none is suited.
        channels: the column of each channel.
        spare: columns that the model or its effects may use besides.
        time: the column of the time stamps; None in a static table, and where messages have stamps.
        step: of rows whose stamps are too coarse to tell them apart [s].
        doubts: what is to be settled by who knows, one sentence each.
        held: parameters that such a log tells nothing of.
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

    @property
    def static(self) -> bool:
        """Whether it is a table without time."""
        return self.time is None and not self.contents.messages

    @property
    def seconds(self) -> np.ndarray | None:
        """The time stamps of a table [s]; None of one without, and where messages have stamps."""
        if self.time is None:
            return None
        clock = self.time
        if self.step is not None:
            return self.step * np.arange(clock.field.values.size)
        return convert(clock.field.values, clock.meaning.unit or "s", "s", where=clock.field.name)


class Pool:
    """The columns by quantity: those that move first, then those that are surer."""

    def __init__(self, fields: Sequence[Field], found: Sequence[Meaning]) -> None:
        self.by: dict[str, list[tuple[Field, Meaning]]] = {}
        for one, meaning in zip(fields, found, strict=True):
            if meaning.quantity and numbers_of(one.values).size:
                self.by.setdefault(meaning.quantity, []).append((one, meaning))
        for pairs in self.by.values():
            pairs.sort(
                key=lambda p: (not varies(p[0].values), "relative" in p[0].name, _RANK[p[1].sure])
            )

    def all(self, quantity: str, *, moving: bool = False) -> list[tuple[Field, Meaning]]:
        pairs = self.by.get(quantity, [])
        return [p for p in pairs if not moving or varies(p[0].values)]

    def pick(self, quantity: str, role: str) -> Pick | None:
        """The most likely column of a quantity; one that is measured must move."""
        pairs = self.all(quantity, moving=role == "measured")
        if not pairs:
            return None
        one, meaning = pairs[0]
        others = [other.name for other, _ in pairs[1:]]
        return Pick(one, meaning, role, doubts=meaning.doubts, others=tuple(others))

    def picks(self, quantities: Sequence[str], role: str) -> dict[str, Pick]:
        found = {name: self.pick(name, role) for name in quantities}
        return {name: pick for name, pick in found.items() if pick is not None}

    def sides(self, quantity: str) -> tuple[Pick, Pick] | None:
        """The left and the right one of a quantity."""
        found = []
        for side in ("left", "right"):
            pairs = [p for p in self.all(quantity) if p[1].side == side]
            if not pairs:
                return None
            one, meaning = pairs[0]
            found.append(Pick(one, meaning, "input", doubts=meaning.doubts))
        return found[0], found[1]
