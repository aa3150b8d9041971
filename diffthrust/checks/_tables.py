"""The rows and sentences of a check: moved quantities, sizes of the moves, and mends."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping

from diffthrust._support.names import shortened
from diffthrust._support.report import Rows, Styled
from diffthrust._support.words import number, with_error
from diffthrust.checks._expected import CheckRow

_LISTED = 10
"""Names that the summary lists."""


def moved_rows(rows: Iterable[CheckRow], *, by_fit: bool) -> Rows:
    """A row for each quantity; one block for each fit if ``by_fit``."""
    blocks: dict[str, list[tuple[str, ...]]] = {}
    for row in rows:
        value = "see below" if _wordy(row) else _cell(row.found, row)
        tolerance = "" if row.tolerance is None else f"{row.tolerance:.2g}"
        verdict = Styled(row.verdict, "good" if row.ok else "bad")
        numbers = (_cell(row.expected, row), value, row.unit, by_how_much(row), tolerance)
        block = blocks.setdefault(row.fit if by_fit else "", [])
        block.append((row.fit, row.quantity, *numbers, verdict))
    headings = ("Fit", "Quantity", "Expected", "Found", "Unit", "Moved by", "Tolerance", "")
    return Rows(headings, tuple(map(tuple, blocks.values())), numbers=(2, 3, 5, 6))


def by_size(rows: Iterable[CheckRow]) -> list[CheckRow]:
    """Rows with the largest change first: what was not compared, words, then standard errors."""

    def size(row: CheckRow) -> tuple[int, float]:
        if row.difference is not None:
            return 2, -abs(row.difference)
        if isinstance(row.expected, float) and row.change is not None:
            return 3, -abs(row.change / row.expected) if row.expected else -math.inf
        return (0 if row.verdict == "not compared" else 1), 0.0

    return sorted(rows, key=size)


def by_how_much(row: CheckRow) -> str:
    """The change in expected standard errors; in per cent where there is none."""
    if row.difference is not None:
        digits = 1 if abs(row.difference) >= 1 else 2
        return f"{row.difference:+.{digits}f} std errors"
    if row.change is None:
        return ""
    assert isinstance(row.expected, float)
    if row.expected == 0:
        return f"{row.change:+.2g}"
    return f"{100 * row.change / abs(row.expected):+.2g} %"


def sentence(row: CheckRow) -> str:
    """A row in words, for lists that hold no tables."""
    row = row.shown
    if row.expected is None:
        return row.quantity if row.found is None else f"{row.quantity}: {row.found}"
    by = f" ({by_how_much(row)})" if row.change is not None else ""
    value = "none" if row.found is None else _cell(row.found, row)
    value += f" {row.unit}" if row.unit else ""
    return f"{row.quantity}: expected {_cell(row.expected, row)}, found {value}{by}"


def remarks(rows: Iterable[CheckRow]) -> list[str]:
    """Problems in full, and each mend once, with the fits that it is for."""
    rows = list(rows)
    problems = [f"{row.fit}: {row.found}" for row in rows if _wordy(row)]
    fits: dict[str, list[str]] = {}
    for row in rows:
        if row.mend:
            fits.setdefault(row.mend, []).append(row.fit)
    return [*problems, *(f"{_names(names)}. Mend: {mend}" for mend, names in fits.items())]


def counts(passed: Mapping[str, bool], updated: Iterable[str]) -> Iterator[str]:
    """How many fits failed, which, and of which the [expected] block was rewritten."""
    failed = [fit for fit, ok in passed.items() if not ok]
    total, updated = _fits(len(passed)), list(updated)
    if failed:
        yield Styled(f"{len(failed)} of {total} failed: {_names(failed)}.", "bad")
        if updated:
            yield f"Rewritten: {_names(updated)}."
        if unchanged := len(passed) - len(failed):
            yield Styled(f"{_fits(unchanged)} unchanged.", "good")
    elif updated:
        yield Styled(f"{total} run; rewritten: {_names(updated)}.", "good")
    else:
        yield Styled(f"{total} checked, none moved.", "good")


def _fits(count: int) -> str:
    return f"{count} fit{'' if count == 1 else 's'}"


def _names(fits: Iterable[str]) -> str:
    return shortened(dict.fromkeys(fits), _LISTED)


def _wordy(row: CheckRow) -> bool:
    return isinstance(row.found, str) and " " in row.found


def _cell(value: float | str | None, row: CheckRow) -> str:
    """A number to the third digit of its standard error, so that a move of 1 % of it is visible."""
    if isinstance(value, str):
        return value
    if value is None:
        return "-"
    return with_error(value, row.std_error / 10)[0] if row.std_error else number(value, 6)
