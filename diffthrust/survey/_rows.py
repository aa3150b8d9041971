"""Rows of the survey, one for each column."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from diffthrust.logs._contents import Field
from diffthrust.survey._choice import Choice, Pick
from diffthrust.survey._guess import Meaning
from diffthrust.survey._values import numbers_of, sampling, varies

_WIDE = 5.0
"""A step between messages above this multiple of the median is remarked."""


@dataclass(frozen=True)
class ColumnRow:
    """A column, or a field of a message.

    Args:
        name: as for ``Column(...)`` and spec files.
        quantity: likely quantity, as the name of a channel; empty if unknown.
        unit: assumed unit of its numbers.
        sure: "sure", "likely" or "perhaps".
        why: the evidence.
        channel: the channel of the drafted spec; empty if not in the draft.
        role: "input", "measured", "time", or "spare" for a column in a comment of the draft.
        samples: number of cells or messages.
        missing: share of samples without a number.
        low: smallest number; NaN if there is none.
        high: largest number.
        rate: samples per second; NaN if unknown.
        gap: largest step between time stamps [s].
        remarks: oddities, in words.

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
        sampled = common if field.time is None else sampling(field.time)
        channel, role = places.get(field.name, ("", ""))
        rows.append(_row(field, pick.meaning if pick else meaning, pick, channel, role, sampled))
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
    remarks = []
    if not numbers.size:
        remarks.append(f"text such as {field.text!r}" if field.text else "empty")
    elif not varies(field.values) and numbers.size > 1:
        remarks.append("constant")
    elif field.text:
        remarks.append(f"some text such as {field.text!r}")
    if pick is not None and pick.unsigned:
        remarks.append("no sign")
    if pick is not None and pick.meaning.scale < 0:
        remarks.append("turned round")
    if field.time is not None and gap * rate > _WIDE:
        remarks.append(f"a gap of {gap:.3g} s")
    return tuple(remarks)
