"""Read large text files: one pass in blocks checks all lines, then only wanted cells are kept."""

from __future__ import annotations

import csv
import warnings
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust.logs._kinds import CONTROL, UTF_16
from diffthrust.logs._tables.table import Cells
from diffthrust.logs._untrusted import MemoryBudget

LARGE = 2**21
"""Files of at least this many bytes are read so, and never held whole."""
_TOP = 2**20
"""Bytes at the top that hold the header, and the lines by which it is found."""
_BLOCK = 2**23
_NEWLINE, _RETURN = 10, 13
# Quotes, comments and anything that is not plain text: left to the line-by-line reader.
_SPECIAL = CONTROL + bytes([11, 12, *b'"#', *range(128, 256)])


def top_of(path: Path) -> bytes | None:
    """The first lines of a large file, with line ends; None if it must be read line by line."""
    with path.open("rb") as stream:
        top = stream.read(_TOP)
    # No complete line within a megabyte, Mac line ends, UTF-16: all for the reader of whole files.
    complete = len(top) < _TOP
    top = top[: top.rfind(b"\n") + 1]
    lone = top.count(b"\r") != top.count(b"\r\n")
    return None if complete or lone or top[:2] in UTF_16 else top or None


@dataclass(frozen=True)
class LargeBody:
    """The lines with samples of a file, all of one width or blank, from an offset on.

    A blank as delimiter stands for any number of blanks; the width counts an empty cell where lines
    end in a delimiter. ``zeros`` are bytes after the lines, ``cut`` a last line that was left out.
    """

    path: Path
    begin: int
    rows: int
    delimiter: str
    width: int
    zeros: int
    cut: bool

    def cells(self, columns: Sequence[int], missing: Collection[str]) -> dict[int, Cells]:
        """The cells of some columns, from 0: numbers, or text if one holds anything else."""
        MemoryBudget(self.path).take(8 * self.rows * len(columns))
        frame = self._frame(
            columns,
            na_values=sorted({"", "nan", "NaN", "NAN", *missing}),
            keep_default_na=False,
        )
        numeric: dict[int, Any] = {
            c: frame[c].to_numpy(np.float64) for c in columns if frame[c].dtype.kind in "iuf"
        }
        del frame  # before the texts in it are read once more, as they are in the file
        texts = self._texts([c for c in columns if c not in numeric])
        if any("," in cell for text in texts.values() for cell in text):
            # Decimal commas in one column make decimal points in another doubtful: 1.000 may mean
            # a thousand there. As text, `text_numbers` judges them.
            texts |= self._texts(list(numeric))
        return {**numeric, **texts}

    def _texts(self, columns: Sequence[int]) -> dict[int, list[str]]:
        if not columns:
            return {}
        frame = self._frame(columns, dtype=object, na_filter=False)
        return {column: frame[column].fillna("").tolist() for column in columns}

    def _frame(self, columns: Sequence[int], **options: Any) -> Any:
        import pandas as pd

        read: Any = pd.read_csv
        if tuple(map(int, pd.__version__.split(".")[:2])) < (3, 1):  # later ones are always exact
            options["float_precision"] = "round_trip"
        with self.path.open("rb") as stream, warnings.catch_warnings():
            # of a column with numbers in one part of the file and text in another
            warnings.simplefilter("ignore", pd.errors.DtypeWarning)
            stream.seek(self.begin)
            frame = read(
                stream,
                sep=r"\s+" if self.delimiter == " " else self.delimiter,
                header=None,
                names=range(self.width),
                index_col=False,
                usecols=list(columns),
                nrows=self.rows,
                skip_blank_lines=False,
                skipinitialspace=True,
                quoting=csv.QUOTE_NONE,
                **options,
            )
        if len(frame) != self.rows:
            raise InputError(
                f"{self.path.name}: expected {self.rows} lines of samples, found {len(frame)}: the "
                "file was changed while it was read.",
                "read it once it is complete.",
            )
        return frame


def scanned(path: Path, begin: int, delimiter: str, width: int) -> LargeBody | None:
    """Check every line from a first byte on; None if one is quoted, irregular or incomplete."""
    size = path.stat().st_size
    end, rows, cut = _end(path, begin, size), 0, False
    zeros = size - end
    widths: set[int] = set()
    for block in _blocks(path, begin, end):
        # Bytes, not lines: translate and count scan the block without an object for each line.
        special = len(block.translate(None, _SPECIAL)) < len(block)
        if special or block.count(b"\r") != block.count(b"\r\n"):
            return None
        counts = _counts(np.frombuffer(block, np.uint8), delimiter, width)
        last = block[block.rfind(b"\n") + 1 :]
        cells = last.split(None if delimiter == " " else delimiter.encode())
        if last.strip() and len(cells) < width:
            cut, counts, end = True, counts[:-1], end - len(last)
        rows += counts.size
        distinct = set(np.unique(counts).tolist())
        widths |= distinct
        # Every line has one width, or one more because of a delimiter at its end; a block of blank
        # lines only is left to the other reader, which notes them.
        if distinct == {0} or not (widths <= {0, width} or widths <= {0, width + 1}):
            return None
    return LargeBody(path, begin, rows, delimiter, max(widths), zeros, cut) if rows else None


def _counts(block: np.ndarray, delimiter: str, width: int) -> np.ndarray:
    """Cells in each line of a block, ``(n,)``: 0 in an empty line, -1 in an irregular one."""
    ends = np.flatnonzero(block == _NEWLINE)
    if not ends.size or ends[-1] < block.size - 1:
        ends = np.append(ends, block.size)
    starts = np.append(0, ends[:-1] + 1)
    if delimiter == " ":
        blank = (block == 32) | ((block >= 9) & (block <= 13))
        begins = ~blank
        begins[1:] &= blank[:-1]
        counts = np.add.reduceat(begins.view(np.uint8), starts, dtype=np.int32)
        return np.where(counts == width, counts, -1)
    marks = block == ord(delimiter)
    counts = np.add.reduceat(marks.view(np.uint8), starts, dtype=np.int32) + 1
    stops = ends - (block[np.maximum(ends - 1, starts)] == _RETURN)
    # One cell too many is right only if the delimiter is the last character of the line.
    closed = marks[np.maximum(stops - 1, 0)] & (counts == width + 1)
    counts[(counts != width) & ~closed] = -1
    counts[stops <= starts] = 0
    return counts


def _end(path: Path, begin: int, end: int) -> int:
    """Offset at which trailing zeros begin, which a logger reserved but never wrote."""
    with path.open("rb") as stream:
        while end > begin:
            start = max(begin, end - _BLOCK)
            stream.seek(start)
            text = stream.read(end - start).rstrip(b"\0")
            if text:
                return start + len(text)
            end = start
    return end


def _blocks(path: Path, begin: int, end: int) -> Iterator[bytes]:
    """The bytes of a file in blocks of complete lines."""
    with path.open("rb") as stream:
        stream.seek(begin)
        while (remaining := end - stream.tell()) > 0:
            block = stream.read(min(_BLOCK, remaining))
            # No line of a table is longer than eight blocks: a file without line ends is none.
            block += stream.readline(min(8 * _BLOCK, remaining - len(block)))
            if not block:  # the file was truncated meanwhile
                return
            yield block
