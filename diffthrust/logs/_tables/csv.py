"""Read columns of text files, with the line of every cell."""

from __future__ import annotations

import csv
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from io import StringIO
from pathlib import Path

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.logs._largest import MemoryBudget
from diffthrust.logs._tables.cells import is_number, quoted
from diffthrust.logs._tables.large_csv import LARGE, parsed, scanned, top_of
from diffthrust.logs._tables.placement import SEARCHED, Placement, locate, skipped_notes
from diffthrust.logs._tables.source import Cells, OpenTable

# Below this many cells Python reads the numbers faster than pandas can be imported.
SMALL = 100_000

# Bytes that never occur in text: with one of them the file is a picture or an archive.
_CONTROL = bytes([*range(9), *range(14, 32)])

_UTF_16 = (b"\xff\xfe", b"\xfe\xff")

ReadCells = Callable[[Sequence[str], Collection[str]], Mapping[str, Cells]]


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
    whole_file = path.read_bytes()
    raw = whole_file if whole_file[:2] in _UTF_16 else whole_file.rstrip(b"\0")
    lines = _lines(raw, path.name)
    complete = not lines[-1]
    if complete:  # the newline after the last line, not a blank row
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
    if not complete and text.cut_short():
        notes.append(_cut_off(head.body[-1] + 1))
    return _table(path, head, partial(_read, text, strict=strict), text.numbers, notes)


def _read_large(path: Path, wanted: Collection[str]) -> OpenTable | None:
    """Open a large file by its first lines; None if other lines are irregular or quoted."""
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


def _zeros(count: int) -> list[str]:
    # A file system that loses power has extended the file but not written its data.
    return [f"{count} bytes of zeros at the end were skipped."] if count else []


def _cut_off(line: int) -> str:
    return f"line {line}, the last, was skipped: it is cut off."


def _lines(raw: bytes, file: str) -> list[str]:
    return _decode(raw, file).replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _decode(raw: bytes, file: str) -> str:
    if raw[:2] in _UTF_16:  # Excel's "Unicode text"
        try:
            raw = raw.decode("utf-16").encode()
        except UnicodeError:
            raise _binary(file) from None
    if len(raw.translate(None, _CONTROL)) != len(raw):
        raise _binary(file)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")  # old programs write a degree sign in Latin-1


def _binary(file: str) -> InputError:
    return InputError(
        f"{file}: expected a table of text, found binary data.", "export the log as CSV."
    )


@dataclass
class _Text:
    """The lines of a file that hold cells, and their line numbers."""

    file: str
    names: list[str]
    delimiter: str
    header_line: int
    lines: list[str]
    numbers: np.ndarray

    @property
    def split(self) -> Splitter:
        """A function that splits a line into cells; raises csv.Error if quotes do not match."""
        return splitter(self.delimiter)

    def cut_short(self) -> bool:
        """Drop a last line with too few cells; returns whether there was one."""
        if len(self.lines) < 2 or not self.lines[-1].strip() or '"' in self.lines[-1]:
            return False
        # Without a newline at its end the recording was cut off in this line, so that its last cell
        # may be cut as well ("12.3" of "12.345"). A complete number of cells cannot be told from
        # that, and counts.
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
    lines = _normalized_lines(text, strict)
    indices = {name: text.names.index(name) for name in wanted}
    order = sorted(set(indices.values()))
    if len(lines) * len(order) > SMALL:
        fast = _read_fast(lines, text.delimiter, len(text.names), order, missing)
        if fast is not None:
            return {name: fast[index] for name, index in indices.items()}
    split = text.split
    cells: dict[int, list[str]] = {index: [] for index in order}
    for line in lines:
        parts = split(line)
        for index in order:
            cells[index].append(parts[index] if index < len(parts) else "")
    return {name: cells[index] for name, index in indices.items()}


def _normalized_lines(text: _Text, strict: bool) -> list[str]:
    """Bring every line to as many cells as the header; blank lines get empty cells."""
    expected, delimiter, split = len(text.names), text.delimiter, text.split
    blank = delimiter * (expected - 1)
    nothing = delimiter + ' \t"\x0b\x0c'
    even = text.lines
    if delimiter == " ":
        # Columns aligned by several blanks.
        even = [" ".join(line.split()) for line in even]
    even = even.copy()
    for k, line in enumerate(even):
        if '"' not in line:
            count = line.count(delimiter) + 1
        else:
            try:
                count = len(split(line)) if line.count('"') % 2 == 0 else -1
            except csv.Error:
                count = -1
        if count == expected:
            continue
        if not line.strip(nothing):
            even[k] = blank
            continue
        # Many loggers write a delimiter after the last cell of every row.
        while count > expected and line.endswith(delimiter):
            line, count = line[: -len(delimiter)], count - 1
        even[k] = line
        if count == expected:
            continue
        place = f"{text.file}, line {text.numbers[k]}"
        if not strict:
            even[k] = line.replace('"', "")
        elif count < 0:
            raise InputError(
                f"{place}: expected quoted cells to end in their line, found {quoted(line)}.",
                "correct the quotes; a cell must not run over several lines.",
            )
        else:
            cells = f"{expected} cell{'s' if expected != 1 else ''}"
            commas = delimiter == "," and count > expected
            raise InputError(
                f"{place}: expected {cells} as in the header, found {count}.",
                "complete the line or remove it"
                + ("; with decimal commas, separate the cells by semicolons." if commas else "."),
            )
    return even


def _read_fast(
    lines: Sequence[str], delimiter: str, width: int, order: Sequence[int], missing: Collection[str]
) -> dict[int, np.ndarray] | None:
    """Read a large table of plain numbers with pandas; None if it holds anything else."""
    joined = "\n".join(lines)
    # pandas gives quotes and these control characters a meaning of their own: the slow pass, which
    # keeps track of lines, decides what they are.
    if '"' in joined or "\x0b" in joined or "\x0c" in joined:
        return None
    columns = parsed(StringIO(joined), delimiter, width, order, missing)
    if columns is None or any(values.size != len(lines) for values in columns.values()):
        return None
    return columns


_DELIMITERS = (",", ";", "\t", " ")

Splitter = Callable[[str], list[str]]


@dataclass(frozen=True)
class Head:
    """Where the table is: its columns, delimiter, header line, the lines below it, and notes."""

    placement: Placement
    delimiter: str
    line: int
    body: Sequence[int]
    notes: list[str]


def head_of(file: str, lines: Sequence[str], wanted: Collection[str]) -> Head:
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
    return Head(placement, delimiter, top, kept[first:], notes)


def _find_table(
    lines: Sequence[str], wanted: Collection[str]
) -> tuple[Placement, str, list[list[str]]] | None:
    """Position of the table, its delimiter, and the top of the text split by it."""
    candidates = []
    for delimiter in _DELIMITERS:
        split, rows = splitter(delimiter), []
        for line in lines[:SEARCHED]:
            try:
                rows.append([cell.strip() for cell in split(line)])
            except csv.Error:
                rows.append([line.strip()])
        if placement := locate(rows, wanted):
            candidates.append((placement, delimiter, rows))
    # Blanks also occur inside names: choose them only if no other delimiter fits as well.
    return max(candidates, key=lambda f: (*f[0].measure, f[1] != " ")) if candidates else None


def splitter(delimiter: str) -> Splitter:
    def split(line: str) -> list[str]:
        if delimiter == " ":
            line = " ".join(line.split())
        if '"' not in line:
            return line.split(delimiter)
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [""])

    return split
