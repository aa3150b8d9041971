"""The header of a table of text: in which line, and by which delimiter the cells are parted."""

from __future__ import annotations

import csv
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

from diffthrust._support.errors import InputError
from diffthrust.logs._tables.cells import is_number
from diffthrust.logs._tables.placement import SEARCHED, Placement, locate, said

_DELIMITERS = (",", ";", "\t", " ")

Splitter = Callable[[str], list[str]]


@dataclass(frozen=True)
class Head:
    """Where the table stands among lines.

    Args:
        placement: its columns.
        delimiter: between cells.
        line: index of the header's line.
        body: indices of the lines below it that are no comments.
        notes: sentences on what was skipped.
    """

    placement: Placement
    delimiter: str
    line: int
    body: Sequence[int]
    notes: list[str]


def head_of(file: str, lines: Sequence[str], wanted: Collection[str]) -> Head:
    """Find the header.

    Raises:
        InputError: there is none.
    """
    kept: Sequence[int] = range(len(lines))
    if any("#" in line for line in lines):
        kept = [i for i in kept if not lines[i].lstrip().startswith("#")]
    found = _find([lines[i] for i in kept], wanted)
    if found is None:
        raise InputError(
            f"{file}: expected a header and samples, found an empty file.",
            "check that the recording was saved.",
        )
    placement, delimiter, rows = found
    notes = said(placement, rows, [i + 1 for i in kept], "line")
    top, first = kept[placement.header], placement.first
    if all(map(is_number, placement.names)) and not set(wanted) & set(placement.names):
        above = lines[top - 1].lstrip() if top else ""
        named = _find([above.lstrip("# ")], wanted) if above.startswith("#") else None
        if named is None or len(named[0].names) != len(placement.names):
            names = ", ".join(map(repr, wanted))
            raise InputError(
                f"{file}, line {top + 1}: expected names of columns, found numbers.",
                "write a header line that names the columns"
                + (f", {names} among them." if names else "."),
            )
        # numpy.savetxt writes its header as a comment.
        placement = replace(placement, names=named[0].names, units=named[0].units)
        top, first = top - 1, placement.header
    return Head(placement, delimiter, top, kept[first:], notes)


def _find(
    lines: Sequence[str], wanted: Collection[str]
) -> tuple[Placement, str, list[list[str]]] | None:
    """Where the table is, by which delimiter, and the top of the text cut into cells by it."""
    found = []
    for delimiter in _DELIMITERS:
        split, rows = splitter(delimiter), []
        for line in lines[:SEARCHED]:
            try:
                rows.append([cell.strip() for cell in split(line)])
            except csv.Error:
                rows.append([line.strip()])
        if placement := locate(rows, wanted):
            found.append((placement, delimiter, rows))
    # Blanks stand inside names too, so they count only where nothing else parts cells as well.
    return max(found, key=lambda f: (*f[0].measure, f[1] != " ")) if found else None


def splitter(delimiter: str) -> Splitter:
    def split(line: str) -> list[str]:
        if delimiter == " ":
            line = " ".join(line.split())
        if '"' not in line:
            return line.split(delimiter)
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [""])

    return split
