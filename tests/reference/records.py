"""What an experiment leaves behind, and its CSV form."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Record:
    """One simulated experiment, in SI units.

    Attributes:
        time: sample instants [s].
        inputs: what was commanded, by channel.
        measured: what the sensors say, by channel; NaN where a sample was lost.
        truth: what the plant did, by channel.
        parameters: everything that made the plant, hidden effects included.
    """

    time: Array
    inputs: dict[str, Array]
    measured: dict[str, Array]
    truth: dict[str, Array]
    parameters: dict[str, Any] = field(default_factory=dict)

    def channel(self, name: str) -> Array:
        """A series by its name: time, an input, or what was measured."""
        return {"time": self.time, **self.inputs, **self.measured}[name]


class Column(NamedTuple):
    """A column of a CSV file: channel, factor from SI to the column's unit, decimals."""

    channel: str
    factor: float = 1.0
    decimals: int = 4


def write_csv(record: Record, path: Path, columns: Mapping[str, Column]) -> None:
    """Write a record with one header line and fixed formatting; lost samples are left empty."""
    series = [
        [_text(v, column.decimals) for v in record.channel(column.channel) * column.factor]
        for column in columns.values()
    ]
    write_rows(path, list(columns), list(zip(*series, strict=True)))


def write_rows(path: Path, header: list[str], rows: list[tuple[str, ...]]) -> None:
    """Write text cells to ``path``: first to a file beside it, then renamed, so none is torn."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(path.name + ".part")
    lines = [",".join(header), *(",".join(row) for row in rows)]
    beside.write_bytes(("\n".join(lines) + "\n").encode("ascii"))
    os.replace(beside, path)


def _text(value: float, decimals: int) -> str:
    """Fixed decimals, no negative zero, empty for NaN."""
    if np.isnan(value):
        return ""
    text = f"{value:.{decimals}f}"
    return text[1:] if text.startswith("-") and not text.strip("-0.") else text
