"""What is told of each column."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from diffthrust.logs._contents import Field
from diffthrust.survey._choice import Choice, Pick
from diffthrust.survey._guess import Meaning
from diffthrust.survey._values import numbers_of, sampling, varies

_WIDE = 5.0
"""A step between two messages of so many median ones is told."""


@dataclass(frozen=True)
class ColumnRow:
    """A column, or a field of a message.

    Args:
        name: as ``Column(...)`` and spec files take it.
        quantity: what it may be, by the name of a channel; empty where nothing tells.
        unit: in which its numbers are taken to be.
        sure: "sure", "likely" or "perhaps".
        why: what tells.
        channel: the channel of the drafted spec; empty where it is not in the draft.
        role: "input", "measured", "time", or "spare" of one that is in the draft as a comment.
        samples: number of cells or messages.
        missing: share of them that hold no number.
        low: smallest number; NaN where there is none.
        high: largest number.
        rate: samples a second, by its own stamps or those of the table; NaN where not known.
        gap: largest step between two stamps [s].
        remarks: what is odd about it, in words.

    Example:
        >>> row = dft.look("run1.csv").columns[1]
        >>> row.name, row.role, row.samples, "unit" in row.to_json()
        ('command', 'input', 240, True)
    """

    name: str
    quantity: str
    unit: str
    sure: str
    why: str
    channel: str
    role: str
    samples: int
    missing: float
    low: float
    high: float
    rate: float
    gap: float
    remarks: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)


def rows_of(choice: Choice) -> tuple[ColumnRow, ...]:
    """A row for each field, in the order of the file."""
    clock = choice.seconds
    common = sampling(clock) if clock is not None else (math.nan, math.nan)
    places: dict[str, tuple[str, str]] = {}
    for name, pick in choice.spare.items():
        places[pick.field.name] = (name, "spare")
    for name, pick in choice.channels.items():
        places[pick.field.name] = (name, pick.role)
    if choice.time is not None:
        places[choice.time.field.name] = ("time", "time")
    picks = {pick.field.name: pick for pick in choice.channels.values()}
    rows = []
    for field, meaning in zip(choice.contents.fields, choice.meanings, strict=True):
        pick = picks.get(field.name)
        own = common if field.time is None else sampling(field.time)
        channel, role = places.get(field.name, ("", ""))
        rows.append(_row(field, pick.meaning if pick else meaning, pick, channel, role, own))
    return tuple(rows)


def _row(
    field: Field,
    meaning: Meaning,
    pick: Pick | None,
    channel: str,
    role: str,
    sampled: tuple[float, float],
) -> ColumnRow:
    numbers = numbers_of(field.values)
    return ColumnRow(
        name=field.name,
        quantity=meaning.quantity,
        unit=meaning.unit,
        sure=meaning.sure if meaning.quantity else "",
        why=meaning.why,
        channel=channel,
        role=role,
        samples=field.values.size,
        missing=1 - numbers.size / max(field.values.size, 1),
        low=float(numbers.min()) if numbers.size else math.nan,
        high=float(numbers.max()) if numbers.size else math.nan,
        rate=sampled[0],
        gap=sampled[1],
        remarks=_remarks(field, pick, *sampled),
    )


def _remarks(field: Field, pick: Pick | None, rate: float, gap: float) -> tuple[str, ...]:
    numbers = numbers_of(field.values)
    told = []
    if not numbers.size:
        told.append(f"text such as {field.text!r}" if field.text else "empty")
    elif not varies(field.values) and numbers.size > 1:
        told.append("constant")
    elif field.text:
        told.append(f"some text such as {field.text!r}")
    if pick is not None and pick.unsigned:
        told.append("no sign")
    if pick is not None and pick.meaning.scale < 0:
        told.append("turned round")
    if field.time is not None and gap * rate > _WIDE:
        told.append(f"a gap of {gap:.3g} s")
    return tuple(told)
