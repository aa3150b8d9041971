"""Columns out of text files, with the line of every cell."""

from __future__ import annotations

import csv
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from io import StringIO
from pathlib import Path

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.logs._largest import Room
from diffthrust.logs._tables.cells import quoted
from diffthrust.logs._tables.csv_head import Head, Splitter, head_of, splitter
from diffthrust.logs._tables.large_csv import LARGE, parsed, scanned, top_of
from diffthrust.logs._tables.placement import SEARCHED
from diffthrust.logs._tables.source import Cells, OpenTable

# Below this many cells Python reads the numbers sooner than pandas is imported.
SMALL = 100_000

# Bytes that no text has: their presence tells a picture or an archive from a table.
_CONTROL = bytes([*range(9), *range(14, 32)])

_UTF_16 = (b"\xff\xfe", b"\xfe\xff")

ReadCells = Callable[[Sequence[str], Collection[str]], Mapping[str, Cells]]


def read_csv(path: Path, wanted: Collection[str], strict: bool = True) -> OpenTable:
    """Open a text file with a table in it.

    Comma, semicolon, tab and blanks are known as delimiters, lines that begin with ``#`` are
    comments, lines above the header and a row of units below it are skipped and told, and a decimal
    comma is read where the delimiter is not a comma.

    Args:
        path: the file.
        wanted: names of the columns, exactly as in the header, by which it is found.
        strict: refuse rows of another length than the header; they are else cut or filled up.

    Returns:
        The table; a blank line gives a row of empty cells.

    Raises:
        InputError: the file is not a table of text. Reading it, that a row has too few or too many
            cells.
    """
    large = path.stat().st_size >= LARGE
    table = _read_large(path, wanted) if large else None
    return table or _read_whole(path, wanted, strict)


def _read_whole(path: Path, wanted: Collection[str], strict: bool) -> OpenTable:
    """Open a file by all of its lines."""
    Room(path).take(path.stat().st_size)
    whole_file = path.read_bytes()
    raw = whole_file if whole_file[:2] in _UTF_16 else whole_file.rstrip(b"\0")
    lines = _lines(raw, path.name)
    whole = not lines[-1]
    if whole:  # the end of the last line, not a blank row
        lines.pop()
    head = head_of(path.name, lines, wanted)
    notes = [*head.notes, *_zeros(len(whole_file) - len(raw))]
    text = _Text(
        path.name,
        head.placement.names,
        head.delimiter,
        head.line + 1,
        [lines[i] for i in head.body],
        np.asarray(head.body, dtype=np.int64) + 1,
    )
    if not whole and text.cut_short():
        notes.append(_cut_off(head.body[-1] + 1))
    return _table(path, head, partial(_read, text, strict=strict), text.numbers, notes)


def _read_large(path: Path, wanted: Collection[str]) -> OpenTable | None:
    """Open a large file by its first lines; None where the others are not plain and even."""
    top = top_of(path)
    if top is None:
        return None
    lines = _lines(top, path.name)[:-1]
    head = head_of(path.name, lines, wanted)
    if len(head.body) < SEARCHED:
        return None
    begin = sum(map(len, top.splitlines(keepends=True)[: head.body[0]]))
    names = head.placement.names
    body = scanned(path, begin, head.delimiter, len(names))
    if body is None:
        return None
    numbers = np.arange(head.body[0], head.body[0] + body.rows) + 1
    notes = [*head.notes, *_zeros(body.zeros)]
    if body.cut:
        notes.append(_cut_off(int(numbers[-1]) + 1))

    def read(wanted: Sequence[str], missing: Collection[str]) -> dict[str, Cells]:
        indices = {name: names.index(name) for name in wanted}
        cells = body.cells(sorted(set(indices.values())), missing)
        return {name: cells[index] for name, index in indices.items()}

    return _table(path, head, read, numbers, notes)


def _table(
    path: Path, head: Head, read: ReadCells, numbers: np.ndarray, notes: list[str]
) -> OpenTable:
    return OpenTable(
        path.name,
        "CSV table",
        head.placement.names,
        read,
        numbers,
        row_word="line",
        comma=head.delimiter != ",",
        units=head.placement.units,
        notes=notes,
    )


def _zeros(count: int) -> list[str]:  # a card in a boat whose power went
    return [f"{count} bytes of zeros at the end were skipped."] if count else []


def _cut_off(line: int) -> str:
    return f"line {line}, the last, was skipped: it is cut off."


def _lines(raw: bytes, file: str) -> list[str]:
    return _decode(raw, file).replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _decode(raw: bytes, file: str) -> str:
    if raw[:2] in _UTF_16:  # what Excel calls Unicode text
        try:
            raw = raw.decode("utf-16").encode()
        except UnicodeError:
            raise _binary(file) from None
    if len(raw.translate(None, _CONTROL)) != len(raw):
        raise _binary(file)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")  # a degree sign in a header, written by an old program


def _binary(file: str) -> InputError:
    return InputError(
        f"{file}: expected a table of text, found binary data.", "export the log as CSV."
    )


@dataclass
class _Text:
    """The lines of a file that hold cells, and where they stand."""

    file: str
    names: list[str]
    delimiter: str
    header_line: int
    lines: list[str]
    numbers: np.ndarray

    @property
    def split(self) -> Splitter:
        """Gives the cells of a line; raises csv.Error where its quotes do not match."""
        return splitter(self.delimiter)

    def cut_short(self) -> bool:
        """Drop a last line that has too few cells; whether there was one."""
        if len(self.lines) < 2 or not self.lines[-1].strip() or '"' in self.lines[-1]:
            return False
        short = len(self.split(self.lines[-1])) < len(self.names)
        if short:
            self.lines.pop()
            self.numbers = self.numbers[:-1]
        return short


def _read(
    text: _Text, wanted: Sequence[str], missing: Collection[str], *, strict: bool
) -> dict[str, Cells]:
    if not text.lines and strict:
        raise InputError(
            f"{text.file}: expected samples below the header in line {text.header_line}, "
            "found none.",
            "check that the recording was saved.",
        )
    lines = _even(text, strict)
    indices = {name: text.names.index(name) for name in wanted}
    order = sorted(set(indices.values()))
    if len(lines) * len(order) > SMALL:
        fast = _fast(lines, text.delimiter, len(text.names), order, missing)
        if fast is not None:
            return {name: fast[index] for name, index in indices.items()}
    split = text.split
    cells: dict[int, list[str]] = {index: [] for index in order}
    for line in lines:
        parts = split(line)
        for index in order:
            cells[index].append(parts[index] if index < len(parts) else "")
    return {name: cells[index] for name, index in indices.items()}


def _even(text: _Text, strict: bool) -> list[str]:
    """The lines with as many cells as the header each; blank ones get their empty cells."""
    expected, delimiter, split = len(text.names), text.delimiter, text.split
    blank = delimiter * (expected - 1)
    nothing = delimiter + ' \t"\x0b\x0c'
    even = text.lines
    if delimiter == " ":
        even = [" ".join(line.split()) for line in even]
    even = even.copy()
    for k, line in enumerate(even):
        if '"' not in line:
            found = line.count(delimiter) + 1
        else:
            try:
                found = len(split(line)) if line.count('"') % 2 == 0 else -1
            except csv.Error:
                found = -1
        if found == expected:
            continue
        if not line.strip(nothing):
            even[k] = blank
            continue
        while found > expected and line.endswith(delimiter):  # a delimiter behind the last cell
            line, found = line[: -len(delimiter)], found - 1
        even[k] = line
        if found == expected:
            continue
        place = f"{text.file}, line {text.numbers[k]}"
        if not strict:
            even[k] = line.replace('"', "")
        elif found < 0:
            raise InputError(
                f"{place}: expected quoted cells to end in their line, found {quoted(line)}.",
                "correct the quotes; a cell must not run over several lines.",
            )
        else:
            cells = f"{expected} cell{'s' if expected != 1 else ''}"
            commas = delimiter == "," and found > expected
            raise InputError(
                f"{place}: expected {cells} as in the header, found {found}.",
                "complete the line or remove it"
                + ("; with decimal commas, separate the cells by semicolons." if commas else "."),
            )
    return even


def _fast(
    lines: Sequence[str], delimiter: str, width: int, order: Sequence[int], missing: Collection[str]
) -> dict[int, np.ndarray] | None:
    """Read a large table of plain numbers; None where it holds anything else."""
    joined = "\n".join(lines)
    if '"' in joined or "\x0b" in joined or "\x0c" in joined:
        return None
    found = parsed(StringIO(joined), delimiter, width, order, missing)
    if found is None or any(values.size != len(lines) for values in found.values()):
        return None
    return found
