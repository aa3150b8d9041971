"""Numbers out of cells of text."""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

_DECIMAL_COMMA = re.compile(r"\s*[+-]?(\d+,\d*|,\d+)([eE][+-]?\d+)?\s*")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?")


@dataclass
class BadCell(Exception):
    """A cell that is not a number, by its row in the column at hand."""

    index: int
    found: str
    expected: str = "a number"


def quoted(cell: str) -> str:
    """Quote a cell for a message, cut where it is long."""
    return repr(cell if len(cell) <= 40 else cell[:37] + "...")


def is_number(cell: str) -> bool:
    """Whether a cell holds a number, with a point or a comma."""
    try:
        float(cell.replace(",", ".", 1))
    except ValueError:
        return False
    return True


def cells_to_numbers(
    cells: Sequence[str | None], missing: Collection[str], decimal_comma: bool = False
) -> np.ndarray:
    """Read numbers cell by cell, to find the one that is not a number.

    Args:
        cells: text of the cells; empty text, ``nan`` and None are missing.
        missing: further texts that mean missing.
        decimal_comma: numbers are written as ``1,5``.

    Returns:
        Numbers with NaN where missing, shape (n,).

    Raises:
        BadCell: a cell is not a number.
    """
    out = np.full(len(cells), np.nan)
    for index, cell in enumerate(cells):
        text = cell.strip() if cell else ""
        if not text or text in missing:
            continue
        number = text
        if decimal_comma:
            if "." in number:
                raise BadCell(index, quoted(text), "a number with a decimal comma, as before it")
            number = number.replace(",", ".", 1)
        try:
            out[index] = float(number)
        except ValueError:
            raise BadCell(index, quoted(text)) from None
        if "_" in number or not number.isascii():  # Python reads 1_000, no other program does
            raise BadCell(index, quoted(text))
    return out


def number_cells(
    cells: Sequence[str | None], missing: Collection[str], comma: bool
) -> tuple[np.ndarray, bool]:
    """Read a column of numbers with decimal points, or with decimal commas where those may be.

    Args:
        cells: text of the cells.
        missing: texts that mean missing.
        comma: commas are decimal ones, as semicolons between cells tell. They are read so, too,
            where they can be no marks between thousands.

    Returns:
        Numbers, shape (n,), and whether they had decimal commas.

    Raises:
        BadCell: a cell can be read in neither way.
    """
    try:
        return cells_to_numbers(cells, missing), False
    except BadCell as bad:
        text = [c.strip() for c in cells if c and "," in c]
        if comma or not all(_THOUSANDS.fullmatch(c) for c in text):
            comma = _DECIMAL_COMMA.fullmatch(cells[bad.index] or "") is not None
        if comma:
            return cells_to_numbers(cells, missing, decimal_comma=True), True
        raise
