"""Where a table stands among rows of cells: its header, and a row of units below it."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from diffthrust.logs._tables.cells import is_number, quoted
from diffthrust.logs._tables.dates import formats_of, is_date
from diffthrust.logs._units import unit_in

SEARCHED = 200
"""Rows at the top of a file among which the header is looked for."""

Measure = tuple[int, bool, int, float, int]


@dataclass(frozen=True)
class Placement:
    """Where a table stands.

    Args:
        names: of its columns.
        header: index of the row that holds them.
        first: index of the first row of samples.
        units: unit by column, from the header or from a row of units below it.
        unit_row: index of the row of units, where there is one.
        preamble: how many rows above the header are not of the table.
        measure: how sure this is, to compare with other ways to cut the same text into cells: how
            many of the wanted names the header has, whether it has as many cells as the rows, how
            many of these there are, the share of numbers in them, and how many cells.
    """

    names: list[str]
    header: int
    first: int
    units: dict[str, str]
    unit_row: int | None
    preamble: int
    measure: Measure


def locate(rows: Sequence[Sequence[str]], wanted: Collection[str]) -> Placement | None:
    """Find the table in rows of cells.

    The header is the first row that names all that is wanted; where none does, the one above the
    first row of numbers.

    Args:
        rows: cells as text, without blanks around them, of the top of the file.
        wanted: names that the header should have.

    Returns:
        The placement, or None where every cell is empty.
    """
    filled = [k for k, row in enumerate(rows) if any(row)]
    if not filled:
        return None
    matched = {k: len(set(rows[k]) & set(wanted)) for k in filled}
    shares: dict[int, dict[int, float]] = {}
    for k in filled:
        share = _share(rows[k])
        if share >= 0.5:
            shares.setdefault(len(_trimmed(rows[k])), {})[k] = share
    width = max(shares, key=lambda n: (len(shares[n]), n), default=0)
    numbers = shares.get(width, {})
    header = filled[0]
    if wanted and max(matched.values()) == len(set(wanted)):
        header = max(filled, key=lambda k: matched[k])
    elif numbers:
        above = [k for k in filled if k < min(numbers)]
        if len(above) > 1 and len(_trimmed(rows[above[-2]])) == width and _units(rows[above[-1]]):
            above.pop()
        header = above[-1] if above else min(numbers)
    names = _trimmed(rows[header])
    units = {name: unit for name in names if (unit := unit_in(name))}
    below = [k for k in filled if k > header][:2]
    own = _units(rows[below[0]]) if len(below) == 2 else None
    if own:
        units |= {name: unit for name, unit in zip(names, own, strict=False) if unit}
    return Placement(
        names,
        header,
        below[0] + 1 if own else header + 1,
        units,
        below[0] if own else None,
        preamble=filled.index(header),
        measure=(
            matched[header],
            len(names) == width > 1,
            len(numbers),
            sum(numbers.values()) / max(len(numbers), 1),
            width or len(names),
        ),
    )


def said(
    placement: Placement, rows: Sequence[Sequence[str]], number: Sequence[int], word: str
) -> list[str]:
    """Sentences on the rows that were skipped; ``number`` counts the rows as the file does."""
    notes = []
    if placement.preamble:
        many = placement.preamble > 1
        which = f"{placement.preamble} {word}s were" if many else f"a {word} was"
        notes.append(f"{which} skipped: the header is {word} {number[placement.header]}.")
    if placement.unit_row is not None:
        cells = quoted(", ".join(rows[placement.unit_row]))[1:-1]
        row = number[placement.unit_row]
        notes.append(f"{word} {row} was skipped: it holds units ({cells}).")
    return notes


def _trimmed(row: Sequence[str]) -> list[str]:
    """The cells but for empty ones at the end: a delimiter behind the last is no further cell."""
    cells = list(row)
    while len(cells) > 1 and not cells[-1]:
        cells.pop()
    return cells


def _share(row: Sequence[str]) -> float:
    """The share of numbers and dates among the cells that are not empty."""
    full = [cell for cell in row if cell]
    return sum(is_number(c) or is_date(c) or bool(formats_of([c])) for c in full) / len(full)


def _units(row: Sequence[str]) -> list[str] | None:
    """The units in a row that holds nothing else; None for another row."""
    bare = [cell.strip("[]()<> ") for cell in row]
    known = [unit_in(f"[{cell}]") if cell not in ("", "-") else "" for cell in bare]
    named = sum(cell not in ("", "-") for cell in bare)
    if any(map(is_number, bare)) or not any(known):
        return None
    return known if 2 * sum(map(bool, known)) >= named else None
