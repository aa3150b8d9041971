"""Read columns of text files, with the line of every cell."""

from __future__ import annotations

import csv
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.logs._kinds import CONTROL, UTF_16
from diffthrust.logs._tables.large_csv import LARGE, scanned, top_of
from diffthrust.logs._tables.placement import SEARCHED, Placement, locate, skipped_notes
from diffthrust.logs._tables.table import Cells, OpenTable
from diffthrust.logs._tables.text import is_number, quoted
from diffthrust.logs._untrusted import MemoryBudget

_DELIMITERS = (",", ";", "\t", " ")

Splitter = Callable[[str], list[str]]


def read_csv(path: Path, wanted: Collection[str], strict: bool = True) -> OpenTable:
    """Open a text file with a table in it, whose header has the wanted names.

    Delimiters are comma, semicolon, tab or blanks. Lines that begin with ``#`` are comments; lines
    above the header and a row of units below it are skipped and noted; a blank line gives a row of
    empty cells. Decimal commas are read if the delimiter is not a comma. If not ``strict``, rows of
    another length than the header are cut or padded instead of refused.
    """
    large = path.stat().st_size >= LARGE
    table = _read_large(path, wanted) if large else None
    return table or _read_all_lines(path, wanted, strict)


def _read_all_lines(path: Path, wanted: Collection[str], strict: bool) -> OpenTable:
    """Open a file by reading all of its lines at once."""
    MemoryBudget(path).take(path.stat().st_size)
    content = path.read_bytes()
    raw = content if content[:2] in UTF_16 else content.rstrip(b"\0")
    lines = _lines(raw, path.name)
    complete = not lines[-1]
    if complete:  # the newline after the last line, not a blank row
        lines.pop()
    head = _head_of(path.name, lines, wanted)
    body = {i + 1: lines[i] for i in head.body}
    cut = body.popitem()[0] if not complete and _is_cut_off(head, body) else None

    def read(wanted: Sequence[str], missing: Collection[str]) -> Mapping[str, Cells]:
        if not body and strict:
            raise InputError(
                f"{path.name}: expected samples below the header in line {head.line + 1}, found "
                "none.",
                "check that the recording was saved.",
            )
        columns: dict[str, list[str]] = {name: [] for name in wanted}
        by_index = {head.placement.names.index(name): column for name, column in columns.items()}
        for number, line in body.items():
            row = _row(path.name, head, number, line, strict)
            for index, column in by_index.items():
                column.append(row[index])
        return columns

    return _table(path, head, read, np.array([*body], np.int64), len(content) - len(raw), cut)


def _read_large(path: Path, wanted: Collection[str]) -> OpenTable | None:
    """Open a large file by its first lines; None if other lines are irregular or quoted."""
    top = top_of(path)
    if top is None:
        return None
    head = _head_of(path.name, _lines(top, path.name)[:-1], wanted)
    if len(head.body) < SEARCHED:
        return None
    begin = sum(map(len, top.splitlines(keepends=True)[: head.body[0]]))
    names = head.placement.names
    body = scanned(path, begin, head.delimiter, len(names))
    if body is None:
        return None

    def read(wanted: Sequence[str], missing: Collection[str]) -> dict[str, Cells]:
        indices = {name: names.index(name) for name in wanted}
        cells = body.cells(sorted(set(indices.values())), missing)
        return {name: cells[index] for name, index in indices.items()}

    numbers = np.arange(head.body[0], head.body[0] + body.rows) + 1
    return _table(path, head, read, numbers, body.zeros, numbers[-1] + 1 if body.cut else None)


def _table(
    path: Path,
    head: _Head,
    read: Callable[[Sequence[str], Collection[str]], Mapping[str, Cells]],
    rows: np.ndarray,
    zeros: int,
    cut: int | None,
) -> OpenTable:
    """The open table, with notes on zeros at the end and on the number of a line cut off."""
    notes = [*head.notes]
    if zeros:  # a file system that loses power has extended the file but not written its data
        notes.append(f"{zeros} bytes of zeros at the end were skipped.")
    if cut is not None:
        notes.append(f"line {cut}, the last, was skipped: it is cut off.")
    return OpenTable(
        path.name,
        "CSV table",
        head.placement.names,
        read,
        rows,
        row_word="line",
        comma=head.delimiter != ",",
        units=head.placement.units,
        notes=notes,
    )


def _lines(raw: bytes, file: str) -> list[str]:
    """The lines of a text; InputError for binary data."""
    try:
        if raw[:2] in UTF_16:  # Excel's "Unicode text"
            raw = raw.decode("utf-16").encode()
        binary = len(raw.translate(None, CONTROL)) != len(raw)
    except UnicodeError:
        binary = True
    if binary:
        raise InputError(
            f"{file}: expected a table of text, found binary data.", "export the log as CSV."
        )
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")  # old programs write a degree sign in Latin-1
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _is_cut_off(head: _Head, body: Mapping[int, str]) -> bool:
    """Whether the last line has too few cells.

    Without a newline at its end the recording was cut off in this line, so that its last cell may
    be cut as well ("12.3" of "12.345"). A complete number of cells cannot be told from that, and
    counts.
    """
    last = body[max(body)] if len(body) > 1 else ""
    if not last.strip() or '"' in last:
        return False
    return len(head.split(last)) < len(head.placement.names)


def _row(file: str, head: _Head, number: int, line: str, strict: bool) -> list[str]:
    """As many cells as in the header; those of a blank line are empty."""
    expected, delimiter, split = len(head.placement.names), head.delimiter, head.split
    try:
        cells = split(line) if line.count('"') % 2 == 0 else None
    except csv.Error:
        cells = None
    if cells is not None and len(cells) == expected:
        return cells
    if not line.strip(delimiter + ' \t"\x0b\x0c'):
        return [""] * expected
    # Many loggers write a delimiter after the last cell of every row.
    while cells and len(cells) > expected and not cells[-1]:
        cells.pop()
    if cells is not None and len(cells) == expected:
        return cells
    if not strict:
        cells = split(line.replace('"', ""))
        return [*cells, *[""] * (expected - len(cells))]
    if cells is None:
        raise InputError(
            f"{file}, line {number}: expected quoted cells to end in their line, found "
            f"{quoted(line)}.",
            "correct the quotes; a cell must not run over several lines.",
        )
    commas = delimiter == "," and len(cells) > expected
    raise InputError(
        f"{file}, line {number}: expected {expected} cell{'s' if expected != 1 else ''} as in the "
        f"header, found {len(cells)}.",
        "complete the line or remove it"
        + ("; with decimal commas, separate the cells by semicolons." if commas else "."),
    )


@dataclass(frozen=True)
class _Head:
    """Where the table is: its columns, delimiter, header line, the lines below it, and notes."""

    placement: Placement
    delimiter: str
    split: Splitter
    line: int
    body: Sequence[int]
    notes: list[str]


def _head_of(file: str, lines: Sequence[str], wanted: Collection[str]) -> _Head:
    """Find the header."""
    kept: Sequence[int] = range(len(lines))
    if any("#" in line for line in lines):
        kept = [i for i in kept if not lines[i].lstrip().startswith("#")]
    located = _find_table([lines[i] for i in kept], wanted)
    if located is None:
        raise InputError(
            f"{file}: expected a header and samples, found an empty file.",
            "check that the recording was saved.",
        )
    placement, delimiter, rows = located
    notes = skipped_notes(placement, rows, [i + 1 for i in kept], "line")
    top, first = kept[placement.header], placement.first
    if all(map(is_number, placement.names)) and not set(wanted) & set(placement.names):
        above = lines[top - 1].lstrip() if top else ""
        named = _find_table([above.lstrip("# ")], wanted) if above.startswith("#") else None
        if named is None or len(named[0].names) != len(placement.names):
            names = ", ".join(map(repr, wanted))
            raise InputError(
                f"{file}, line {top + 1}: expected names of columns, found numbers.",
                "write a header line that names the columns"
                + (f", {names} among them." if names else "."),
            )
        # numpy.savetxt writes its header as a comment ("# t u"): the line above the numbers.
        placement = replace(placement, names=named[0].names, units=named[0].units)
        top, first = top - 1, placement.header
    return _Head(placement, delimiter, _splitter(delimiter), top, kept[first:], notes)


def _find_table(
    lines: Sequence[str], wanted: Collection[str]
) -> tuple[Placement, str, list[list[str]]] | None:
    """Position of the table, its delimiter, and the top of the text split by it."""
    candidates = []
    for delimiter in _DELIMITERS:
        split, rows = _splitter(delimiter), []
        for line in lines[:SEARCHED]:
            try:
                rows.append([cell.strip() for cell in split(line)])
            except csv.Error:
                rows.append([line.strip()])
        if placement := locate(rows, wanted):
            candidates.append((placement, delimiter, rows))
    # Blanks also occur inside names: choose them only if no other delimiter fits as well.
    return max(candidates, key=lambda f: (*f[0].measure, f[1] != " ")) if candidates else None


def _splitter(delimiter: str) -> Splitter:
    def split(line: str) -> list[str]:
        if delimiter == " ":
            line = " ".join(line.split())
        if '"' not in line:
            return line.split(delimiter)
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [""])

    return split
