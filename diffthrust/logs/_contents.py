"""Everything readable in the file of a log, for `look`, and the settings of an autopilot."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, short_repr
from diffthrust.logs._kinds import kind_of
from diffthrust.logs._read import open_table
from diffthrust.logs._robots.fields import all_fields
from diffthrust.logs._tables.table import Cells, Dates, Field, OpenTable, Other
from diffthrust.logs._tables.text import BadCell, seconds_of, text_numbers

_WORDS = 50
"""A column with more distinct words than this holds names or remarks, not numbers."""


@dataclass(frozen=True)
class Contents:
    """The contents of a file, and its kind in words: ``"CSV table"``, ``"ROS 2 bag"``.

    Where ``messages`` have separate clocks it is read by `read_robot_log`; fields of a table
    have one length. ``sheet`` is that of an Excel file with several, ``parameters`` are an
    autopilot's settings.
    """

    path: Path
    kind: str
    messages: bool
    fields: tuple[Field, ...]
    notes: tuple[str, ...] = ()
    sheet: str = ""
    parameters: Mapping[str, float] = field(default_factory=dict)


def contents(path: str | PathLike[str]) -> Contents:
    """List everything in the file of a log; whatever cannot be read is skipped and noted.

    Of an Excel file, the sheet with the largest table.
    """
    file = Path(path)
    kind = kind_of(file)
    if kind.messages:
        fields, notes, parameters = all_fields(file, kind)
        word = kind.article.split(" ", 1)[1]
        return Contents(file, word, True, tuple(fields), tuple(notes), parameters=parameters)
    source = open_table(file, kind, (), strict=False)
    remarks = list(source.notes)
    columns = _columns(source, remarks)
    if not any(np.isfinite(field.values).any() for field in columns):
        problem = next((note for note in remarks if note.startswith("left out")), "found none.")
        raise InputError(
            f"{source.file}: expected a table with numbers; {problem}",
            "check that it is a log, and that the recording was saved.",
        )
    return Contents(file, source.kind, False, columns, tuple(remarks), source.sheet)


def _columns(source: OpenTable, notes: list[str]) -> tuple[Field, ...]:
    """The columns of a table with numbers, dates or text; others are noted."""
    word = source.column_word
    counts = Counter(source.names)
    double = [name for name, count in counts.items() if count > 1]
    if double:
        notes.append(f"several {word}s are named {listing(double, 5)}: only the first is listed.")
    cells = source.read(list(counts), ())
    skipped = {name: c.description for name, c in cells.items() if isinstance(c, Other)}
    fields = [_field(source, name, c) for name, c in cells.items() if not isinstance(c, Other)]
    sizes = Counter(field.values.size for field in fields)
    # A .mat file mixes series with constants and settings: the table is made of the length that
    # most columns share, and a single number is a column only in a file of single numbers.
    size = max(sizes, key=lambda n: (n > 1, sizes[n], n), default=0)
    skipped |= {f.name: f"{f.values.size} values" for f in fields if f.values.size != size}
    matrices = {name.split("(")[0] for name in cells if name.endswith(")")}  # listed by columns
    skipped_texts = [
        f"{name!r} ({content})" for name, content in skipped.items() if name not in matrices
    ]
    if skipped_texts:
        more = f" and {len(skipped_texts) - 8} more" if len(skipped_texts) > 8 else ""
        notes.append(f"left out: {', '.join(skipped_texts[:8])}{more}.")
    return tuple(field for field in fields if field.values.size == size)


def _field(source: OpenTable, name: str, cells: Cells) -> Field:
    """A column of numbers or dates, or of text: numbers mixed with words, dates, or words only.

    Each word that is no number is taken as a mark for missing samples, and the column is read
    again, until it parses.
    """
    unit = source.units.get(name, "")
    if isinstance(cells, Dates):
        return Field(name, cells.seconds, unit="s", dates=True)
    if isinstance(cells, np.ndarray):
        return Field(name, cells, unit=unit)
    assert not isinstance(cells, Other)  # those are left out
    missing: set[str] = set()
    text = ""
    while True:
        try:
            values, dates, _ = text_numbers(cells, missing, source.comma, is_time=not missing)
        except BadCell as bad:
            # Dates that do not begin with the year: read in the first format that fits all cells,
            # with the alternatives (03.04. may be March or April).
            if formats := tuple(bad.formats):
                seconds = seconds_of(cells, (), formats[0])
                return Field(name, seconds, unit="s", dates=True, date_formats=formats)
            word = (cells[bad.index] or "").strip()
            text = text or word
            missing.add(word)
            if len(missing) > _WORDS:  # names, remarks, or numbers in an unknown notation
                return Field(name, np.full(len(cells), np.nan), unit=unit, text=text)
            continue
        return Field(name, values, unit="s" if dates else unit, text=text, dates=dates)


_PARAMETER_FILES = (".param", ".params", ".parm")
"""Endings of files in which ground stations save parameters."""

# "NAME,VALUE" (Mission Planner), "NAME VALUE" (MAVProxy), or vehicle, component, name, value and
# type in columns (QGroundControl)
_LINE = re.compile(r"(?:\d+\s+\d+\s+)?([A-Za-z]\w*)[\s,=]+(\S+?)(?:[\s,].*)?")


def parameters_in(path: str | PathLike[str]) -> dict[str, float]:
    r"""Read the settings of an autopilot.

    Args:
        path: a log of ArduPilot (.bin, .tlog) or PX4 (.ulg), whose last value of a parameter
            counts; or a file of parameters as ground stations save it (.param, .params, .parm).

    Returns:
        Values by name, such as ``FRAME_CONFIG``; empty for a log that holds none.

    Raises:
        InputError: there is no such file, it is neither, it has no parameters, or a line of it has
            no value.

    Example:
        >>> with open("rov.param", "w") as file:
        ...     _ = file.write("FRAME_CONFIG,2\nSERVO1_FUNCTION,33\n")
        >>> dft.logs.parameters_in("rov.param")
        {'FRAME_CONFIG': 2.0, 'SERVO1_FUNCTION': 33.0}
    """
    if not isinstance(path, str | PathLike):
        raise InputError(
            f"expected the path of a log or of a file of parameters, found {short_repr(path)}.",
            'Name the file: "dive.bin".',
        )
    file = Path(path)
    kind = kind_of(file)
    if kind.messages:
        return dict(contents(file).parameters)
    if file.suffix.lower() not in _PARAMETER_FILES:
        raise InputError(
            f"{file}: expected a log of an autopilot or a file of its parameters, found "
            f"{kind.article}.",
            f"Name a .bin, .tlog or .ulg, or a file ending in {', '.join(_PARAMETER_FILES)}.",
        )
    return _listed(file)


def _listed(file: Path) -> dict[str, float]:
    values = {}
    for number, line in enumerate(file.read_text("utf-8-sig", "replace").splitlines(), 1):
        text = line.split("#")[0].strip()
        if not text:
            continue
        match = _LINE.fullmatch(text)
        try:
            value = float(match[2]) if match else math.nan
        except ValueError:
            value = math.nan
        if match is None or not math.isfinite(value):
            raise InputError(
                f"{file}, line {number}: expected a parameter and its value, found {text[:60]!r}.",
                "Write it as in FRAME_CONFIG,2, or remove the line.",
            )
        values[match[1]] = value
    if not values:
        raise InputError(
            f"{file}: expected parameters, found none.",
            "Save the parameters of the vehicle anew from its ground station.",
        )
    return values
