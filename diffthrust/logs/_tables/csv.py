"""Columns of numbers out of text files, with the line of every number."""

import csv
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.logs._tables.table import (
    BadCell,
    Table,
    absent_column,
    cells_to_column,
    not_a_number,
    shown,
    twice,
)

# Below this many cells Python reads the numbers sooner than pandas is imported.
SMALL = 100_000

# Bytes that no text has: their presence tells a picture or an archive from a table.
_CONTROL = bytes([*range(9), *range(14, 32)])

Splitter = Callable[[str], list[str]]


@dataclass
class _Text:
    """The lines of a file that hold cells, and where they stand."""

    file: str
    header: list[str]
    header_line: int
    lines: list[str]
    numbers: np.ndarray
    delimiter: str
    split: Splitter


def read_csv(
    path: Path, wanted: Sequence[str], time: str | None, missing: Collection[str]
) -> Table:
    """Read the wanted columns of a text file with a header.

    Comma, semicolon, tab and blanks are known as delimiters, lines that begin with ``#`` are
    comments, and a decimal comma is read where the delimiter is not a comma.

    Args:
        path: the file.
        wanted: names of the columns, exactly as in the header.
        time: name of the time column, which may hold ISO dates.
        missing: texts that mean missing.

    Returns:
        The table; a blank line gives a row of NaN.

    Raises:
        InputError: the file is not a table of text, a column is absent or double, a row has too
            few or too many cells, or a cell is not a number.
    """
    text = split_text(path, wanted)
    indices = {}
    for name in wanted:
        if name not in text.header:
            error = absent_column(text.file, name, text.header, "column")
            if all(_is_number(cell) for cell in text.header):
                error = InputError(
                    f"{text.file}, line {text.header_line}: expected names of columns, "
                    f"found numbers.",
                    f"write a header line that names the columns, {name!r} among them.",
                )
            raise error
        if text.header.count(name) > 1:
            raise twice(text.file, name, "column")
        indices[name] = text.header.index(name)
    _check_cells(text)
    if not text.lines:
        raise InputError(
            f"{text.file}: expected samples below the header in line {text.header_line}, "
            "found none.",
            "check that the recording was saved.",
        )
    table = Table(text.file, {}, text.numbers)
    order = sorted(set(indices.values()))
    fast = None
    if len(text.lines) * len(order) > SMALL:
        fast = _fast(text, order, missing)
    if fast is not None:
        table.columns = {name: fast[index] for name, index in indices.items()}
        return table
    cells = _cells(text, order)
    for name, index in indices.items():
        try:
            table.columns[name], how = cells_to_column(
                cells[index], missing, comma=text.delimiter != ",", is_time=name == time
            )
        except BadCell as bad:
            raise not_a_number(table.place(name, bad.index), bad) from None
        if how == "comma":
            table.notes.append(f"column {name!r}: decimal commas were read as decimal points.")
        elif how == "date":
            table.say_dates()
    return table


def split_text(path: Path, wanted: Sequence[str]) -> _Text:
    """Tell the header of a text file from its rows.

    Raises:
        InputError: the file is empty, or no text.
    """
    raw = path.read_bytes()
    everything = _decode(raw, path.name).replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if not everything[-1]:  # the end of the last line, not a blank row
        everything.pop()
    if "#" in raw[:1].decode("latin-1") or b"\n#" in raw or b"\r#" in raw or b" #" in raw:
        kept = [i for i, line in enumerate(everything) if not line.lstrip().startswith("#")]
    else:
        kept = list(range(len(everything)))
    top = next((k for k, i in enumerate(kept) if everything[i].strip()), None)
    if top is None:
        raise InputError(
            f"{path.name}: expected a header and samples, found an empty file.",
            "check that the recording was saved.",
        )
    line_number = kept[top]
    header_text, body = everything[line_number], kept[top + 1 :]
    header, delimiter, split = _sniff(header_text, wanted)
    above = everything[line_number - 1].lstrip() if line_number else ""
    if above.startswith("#") and all(_is_number(cell) for cell in header):
        # numpy.savetxt writes its header as a comment.
        commented, delimiter_, split_ = _sniff(above.lstrip("#").strip(), wanted)
        if len(commented) == len(split_(header_text)):
            header, delimiter, split = commented, delimiter_, split_
            body = kept[top:]
            line_number -= 1
    lines = [everything[i] for i in body] if len(body) != len(everything) else everything
    if delimiter == " ":
        lines = [" ".join(line.split()) for line in lines]
    numbers = np.asarray(body, dtype=np.int64) + 1
    return _Text(path.name, header, line_number + 1, lines, numbers, delimiter, split)


def _decode(raw: bytes, file: str) -> str:
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):  # what Excel calls Unicode text
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
        f"{file}: expected a table of text, found binary data.",
        "export the log as CSV, or name a Parquet file .parquet and a MATLAB file .mat.",
    )


def _split_by(delimiter: str) -> Splitter:
    def split(line: str) -> list[str]:
        if '"' not in line:
            return line.split(delimiter)
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [""])

    return split


def _sniff(header: str, wanted: Sequence[str]) -> tuple[list[str], str, Splitter]:
    """Take the delimiter by which most of the wanted columns are found in the header."""
    best: tuple[tuple[int, int], list[str], str, Splitter] | None = None
    for delimiter in (",", ";", "\t", " "):
        split = _split_by(delimiter)
        try:
            cells = [cell.strip() for cell in split(header.strip() if delimiter == " " else header)]
        except csv.Error:
            cells = [header]
        if delimiter == " " and '"' not in header:
            cells = header.split()
        # Blanks stand inside names too, so they count only where the names then match.
        score = (len(set(cells) & set(wanted)), 0 if delimiter == " " else len(cells))
        if best is None or score > best[0]:
            best = (score, cells, delimiter, split)
    assert best is not None
    return best[1:]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _check_cells(text: _Text) -> None:
    """Give blank lines their empty cells, and raise InputError where a row is ragged."""
    expected, delimiter = len(text.header), text.delimiter
    blank = delimiter * (expected - 1)
    nothing = delimiter + ' \t"\x0b\x0c'
    for k, line in enumerate(text.lines):
        if '"' not in line:
            found = line.count(delimiter) + 1
        else:
            try:
                found = len(text.split(line)) if line.count('"') % 2 == 0 else -1
            except csv.Error:
                found = -1
        if found == expected:
            continue
        if not line.strip(nothing):
            text.lines[k] = blank
            continue
        place = f"{text.file}, line {text.numbers[k]}"
        if found < 0:
            raise InputError(
                f"{place}: expected quoted cells to end in their line, found {shown(line)}.",
                "correct the quotes; a cell must not run over several lines.",
            )
        cells = f"{expected} cell{'s' if expected != 1 else ''}"
        raise InputError(
            f"{place}: expected {cells} as in the header, found {found}.",
            "complete the line or remove it"
            + (
                "; with decimal commas, separate the cells by semicolons."
                if delimiter == "," and found > expected
                else "."
            ),
        )


def _cells(text: _Text, order: Sequence[int]) -> dict[int, list[str]]:
    cells: dict[int, list[str]] = {index: [] for index in order}
    for line in text.lines:
        parts = text.split(line)
        for index in order:
            cells[index].append(parts[index])
    return cells


def _fast(
    text: _Text, order: Sequence[int], missing: Collection[str]
) -> dict[int, np.ndarray] | None:
    """Read a large table of plain numbers; None where it holds anything else."""
    joined = "\n".join(text.lines)
    if '"' in joined or "\x0b" in joined or "\x0c" in joined:
        return None
    import pandas as pd

    try:
        frame = pd.read_csv(
            StringIO(joined),
            sep=text.delimiter,
            header=None,
            usecols=list(order),
            dtype="float64",
            na_values=sorted({"", "nan", "NaN", "NAN", *missing}),
            keep_default_na=False,
            skip_blank_lines=False,
            skipinitialspace=True,
            quoting=csv.QUOTE_NONE,
            float_precision="round_trip",  # the same number as the cell-by-cell path gives
        )
    except Exception:  # some cell is not a number; the slow path finds and names it
        return None
    if len(frame) != len(text.lines):
        return None
    return {index: frame[index].to_numpy(dtype=np.float64) for index in order}
