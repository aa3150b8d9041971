"""Locate a table among rows of cells: its header, and a row of units or of more names below it."""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from diffthrust.logs._tables.text import formats_of, is_date, is_number, quoted
from diffthrust.logs._units import is_common, unit_in

SEARCHED = 200
"""Rows at the top of a file in which the header is searched."""
_WORDS = re.compile(r"[^\W_]+")
_WORD = re.compile(r"[^\W\d_]{3}")
"""Three letters in a row: a mark for what is missing ("n/a", "-") has fewer."""


@dataclass(frozen=True)
class Placement:
    """Position of a table.

    ``header`` and ``first`` are indices of rows: of the header, and of the first samples;
    ``skipped`` says by index what rows between them hold, such as units; ``preamble`` is the number
    of rows above the header. ``units``, by column, are from the header or from a row below it.
    ``measure`` is how plausible it is, to compare ways of splitting the same text into cells:
    number of wanted names in the header, whether it is as wide as the rows of numbers, the number
    of those rows, their share of numbers, and their width.
    """

    names: list[str]
    header: int
    first: int
    units: dict[str, str]
    skipped: dict[int, str]
    preamble: int
    measure: tuple[int, bool, int, float, int]


def locate(rows: Sequence[Sequence[str]], wanted: Collection[str]) -> Placement | None:
    """Find the table in the top rows of a file, cells without blanks; None if all are empty.

    The header is the first row that has all wanted names, or else the row above the first row of
    numbers.
    """
    filled = [k for k, row in enumerate(rows) if any(row)]
    if not filled:
        return None
    matched = {k: len(set(rows[k]) & set(wanted)) for k in filled}
    shares: dict[int, dict[int, float]] = {}
    for k in filled:
        share = _numeric_share(rows[k])
        # Half: a row of samples may hold a status word and empty cells beside its numbers.
        if share >= 0.5:
            shares.setdefault(len(_trimmed(rows[k])), {})[k] = share
    width = max(shares, key=lambda n: (len(shares[n]), n), default=0)
    numbers, widths = shares.get(width, {}), {width}
    header = filled[0]
    if wanted and max(matched.values()) == len(set(wanted)):
        header = max(filled, key=lambda k: matched[k])
    elif numbers:
        cells = len(rows[min(numbers)])
        above = [k for k in filled if k < min(numbers)]
        # A column that is filled in the first rows only makes these wider than those that follow;
        # a table that was merged from messages begins with that of any of its columns.
        while above and any(
            above[-1] in of_width and (n > width or len(rows[above[-1]]) == cells)
            for n, of_width in shares.items()
        ):
            first = above.pop()
            widths.add(size := len(_trimmed(rows[first])))
            numbers[first] = shares[size][first]
        widths |= {n for n, of_width in shares.items() for k in of_width if len(rows[k]) == cells}
        header = _header_of(rows, above, widths) if above else min(numbers)
    names = _trimmed(rows[header])
    units = {name: unit for name in names if (unit := unit_in(name))}
    below = [k for k in filled if k > header][:3]
    skipped: dict[int, str] = {}
    # With one row below the header it is the only sample, whatever it looks like.
    if len(below) > 1 and _are_names(rows[below[0]], rows[header]):
        skipped[below.pop(0)] = "more names"
    unit_names = _units(rows[below[0]]) if len(below) > 1 else None
    if unit_names:
        skipped[below[0]] = "units"
        units |= {name: unit for name, unit in zip(names, unit_names, strict=False) if unit}
    return Placement(
        names,
        header,
        max([header, *skipped]) + 1,
        units,
        skipped,
        preamble=filled.index(header),
        measure=(
            matched[header],
            len(names) > 1 and len(names) in widths,
            len(numbers),
            sum(numbers.values()) / max(len(numbers), 1),
            width or len(names),
        ),
    )


def _header_of(rows: Sequence[Sequence[str]], above: Sequence[int], widths: set[int]) -> int:
    """The header among the rows above the numbers."""
    *earlier, last = above
    # The row right above the numbers may hold units, with the names above it.
    if earlier and len(_trimmed(rows[earlier[-1]])) in widths and _units(rows[last]):
        *earlier, last = earlier
    if earlier and _are_names(rows[last], rows[earlier[-1]]):
        short, long = rows[earlier[-1]], rows[last]
        # Or it holds long names: they say of several columns the same, or leave out the units that
        # most of the short ones tell ("speed_rpm", and "propeller speed" below it). Not below a row
        # of values or groups ("Mass", "3 kg"; "Motor A" four times), nor below one of units.
        units, fewer = (sum(map(_tells_unit, row)) for row in (short, long))
        spelt = len(set(short)) == len(short) < 2 * units and fewer < units and not _units(short)
        if len(set(long)) < len(set(short)) or spelt:
            return earlier[-1]
    return last


def _tells_unit(name: str) -> bool:
    """Whether a name has its unit in brackets, or a common one for its last word ("t_s")."""
    *others, last = _WORDS.findall(name) or [""]
    named = any(not is_number(word) for word in others)
    return bool(unit_in(name) or (named and (len(last) > 1 or last == "s") and is_common(last)))


def skipped_notes(
    placement: Placement, rows: Sequence[Sequence[str]], number: Sequence[int], word: str
) -> list[str]:
    """Notes on skipped rows; ``number`` gives the row numbers in the file."""
    notes: list[str] = []
    if placement.preamble:
        many = placement.preamble > 1
        which = f"{placement.preamble} {word}s were" if many else f"a {word} was"
        notes.append(f"{which} skipped: the header is {word} {number[placement.header]}.")
    for at, what in placement.skipped.items():
        cells = quoted(", ".join(rows[at]))[1:-1]
        notes.append(f"{word} {number[at]} was skipped: it holds {what} ({cells}).")
    return notes


def _trimmed(row: Sequence[str]) -> list[str]:
    """Drop empty cells at the end: a delimiter after the last cell does not open another."""
    cells = list(row)
    while len(cells) > 1 and not cells[-1]:
        cells.pop()
    return cells


def _numeric_share(row: Sequence[str]) -> float:
    """The share of numbers and dates among non-empty cells."""
    full = [cell for cell in row if cell]
    return sum(is_number(c) or is_date(c) or bool(formats_of([c])) for c in full) / len(full)


def _are_names(row: Sequence[str], header: Sequence[str]) -> bool:
    """Whether a row holds more names: as many cells as the header, in words, mostly different.

    A file of the SWAMP has its long names below the short ones. A sample of nothing but words is
    one of marks for what is missing, which repeat.
    """
    cells = _trimmed(row)
    if len(cells) < 2 or len(cells) != len(_trimmed(header)) or not all(cells):
        return False
    if _numeric_share(cells) > 0 or _units(cells):
        return False
    return all(map(_WORD.search, cells)) and 2 * len(set(cells)) > len(cells)


def _units(row: Sequence[str]) -> list[str] | None:
    """The units in a row of units; None for any other row."""
    bare = [cell.strip("[]()<> ") for cell in row]
    recognized = [unit_in(f"[{cell}]") if cell not in ("", "-") else "" for cell in bare]
    named = sum(cell not in ("", "-") for cell in bare)
    if any(map(is_number, bare)) or not any(recognized):
        return None
    # Half of the cells: "m", "s" or "A" may also be a code or a name, a row of such rarely is.
    return recognized if 2 * sum(map(bool, recognized)) >= named else None
