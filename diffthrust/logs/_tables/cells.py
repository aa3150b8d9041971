"""Parse cells of text as numbers."""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

_DECIMAL_COMMA = re.compile(r"\s*[+-]?(\d+,\d*|,\d+)([eE][+-]?\d+)?\s*")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?")


@dataclass
class BadCell(Exception):
    """A cell that is not a number, with its row in the current column."""

    index: int
    text: str
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
    """Read numbers cell by cell, ``(n,)``; `BadCell` for one that is no number.

    Empty text, ``nan``, None and the words in ``missing`` become NaN.
    """
    out = np.full(len(cells), np.nan)
    for index, cell in enumerate(cells):
        text = cell.strip() if cell else ""
        if not text or text in missing:
            continue
        number = text
        if decimal_comma:
            if "." in number:
                raise BadCell(index, quoted(text), "a number with a decimal comma, as above it")
            number = number.replace(",", ".", 1)
        try:
            out[index] = float(number)
        except ValueError:
            raise BadCell(index, quoted(text)) from None
        if "_" in number or not number.isascii():  # Python accepts 1_000, no other program does
            raise BadCell(index, quoted(text))
    return out


def number_cells(
    cells: Sequence[str | None], missing: Collection[str], comma: bool
) -> tuple[np.ndarray, bool]:
    """Read a column of numbers, ``(n,)``, and say whether they had decimal commas; or `BadCell`.

    ``comma`` says that commas are decimal commas, as with semicolons between cells. Otherwise they
    are read so only if they cannot be thousands separators.
    """
    try:
        return cells_to_numbers(cells, missing), False
    except BadCell as bad:
        text = [c.strip() for c in cells if c and "," in c]
        # "1,234" in a file with commas between quoted cells may be 1234 or 1.234: refused. "1,23"
        # among them can only be a decimal comma.
        if comma or not all(_THOUSANDS.fullmatch(c) for c in text):
            comma = _DECIMAL_COMMA.fullmatch(cells[bad.index] or "") is not None
        if comma:
            return cells_to_numbers(cells, missing, decimal_comma=True), True
        raise
