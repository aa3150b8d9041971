"""The outcome of a check for people: what moved, by how much, and what to do."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Protocol

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.text import Text

from diffthrust._support.tables import number, plain_table, with_error

if TYPE_CHECKING:
    from diffthrust.checks._expected import CheckRow

_LISTED = 10
"""Names that the summary lists."""


class _Checked(Protocol):
    """What is shown of a check."""

    @property
    def rows(self) -> tuple[CheckRow, ...]: ...
    @property
    def runs(self) -> Sequence[_Ran]: ...
    @property
    def updated(self) -> tuple[str, ...]: ...


class _Ran(Protocol):
    """What is shown of a fit that was run again."""

    @property
    def fit(self) -> str: ...
    @property
    def ok(self) -> bool: ...
    @property
    def since(self) -> str: ...


def check_table(checked: _Checked, everything: bool = False) -> RenderableType:
    """What moved, the largest first, with what to do about it, and a summary.

    Args:
        checked: the outcome.
        everything: show every quantity in the order of the fits, also those that did not move.
    """
    rows = checked.rows if everything else by_size(row for row in checked.rows if not row.ok)
    rows = [row.shown for row in rows]
    table = plain_table(
        *("Fit", "Quantity", "Expected", "Found", "Unit", "Moved by", "Tolerance", ""),
        numbers=(2, 3, 5, 6),
    )
    last = rows[0].fit if rows else ""
    for row in rows:
        if everything and row.fit != last:
            table.add_section()
            last = row.fit
        table.add_row(
            escape(row.fit),
            escape(row.quantity),
            _cell(row.expected, row),
            "see below" if _wordy(row) else _cell(row.found, row),
            escape(row.unit),
            by_how_much(row),
            "" if row.tolerance is None else f"{row.tolerance:.2g}",
            Text(row.verdict, "green" if row.ok else "bold red"),
        )
    parts: list[RenderableType] = [table] if rows else []
    since = [Text(f"{run.fit}: {run.since}") for run in checked.runs if run.since]
    return Group(*parts, *_remarks(rows), *since, *_summary(checked))


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
    """The change in expected standard errors; in per cent where there is none.

    Example:
        >>> by_how_much(CheckRow("one", "alpha", 1.0, 1.4, 0.01, False, std_error=0.1))
        '+4.0 std errors'
    """
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
    """A row in words, for lists that hold no tables.

    Example:
        >>> sentence(CheckRow("one", "alpha", 1.0, 1.4, 0.01, False, std_error=0.1))
        'alpha: expected 1.000, found 1.400 (+4.0 std errors)'
    """
    row = row.shown
    if row.expected is None:
        return row.quantity if row.found is None else f"{row.quantity}: {row.found}"
    by = f" ({by_how_much(row)})" if row.change is not None else ""
    found = "none" if row.found is None else _cell(row.found, row)
    found += f" {row.unit}" if row.unit else ""
    return f"{row.quantity}: expected {_cell(row.expected, row)}, found {found}{by}"


def _remarks(rows: Iterable[CheckRow]) -> list[Text]:
    """Problems in full, and each mend once, with the fits that it is for."""
    problems = [Text(f"{row.fit}: {row.found}") for row in rows if _wordy(row)]
    fits: dict[str, list[str]] = {}
    for row in rows:
        if row.mend:
            fits.setdefault(row.mend, []).append(row.fit)
    return [*problems, *(Text(f"{_names(who)}. Mend: {mend}") for mend, who in fits.items())]


def _summary(checked: _Checked) -> list[Text]:
    failed = [run.fit for run in checked.runs if not run.ok]
    fits = _fits(len(checked.runs))
    if not failed and checked.updated:
        return [Text(f"{fits} run; written anew: {_names(checked.updated)}.", "bold green")]
    if not failed:
        return [Text(f"{fits} checked, none moved.", "bold green")]
    parts = [Text(f"{len(failed)} of {fits} failed: {_names(failed)}.", "bold red")]
    if checked.updated:
        parts.append(Text(f"Written anew: {_names(checked.updated)}."))
    if rest := len(checked.runs) - len(failed):
        parts.append(Text(f"{_fits(rest)} unchanged.", "green"))
    return parts


def _fits(count: int) -> str:
    return f"{count} fit{'' if count == 1 else 's'}"


def _names(fits: Iterable[str]) -> str:
    names = list(dict.fromkeys(fits))
    more = len(names) - _LISTED
    return ", ".join(names[:_LISTED]) + (f" and {more} more" if more > 0 else "")


def _wordy(row: CheckRow) -> bool:
    return isinstance(row.found, str) and " " in row.found


def _cell(value: float | str | None, row: CheckRow) -> str:
    """A number to the third digit of its standard error, so that a move of a hundredth is seen."""
    if isinstance(value, str):
        return escape(value)
    if value is None:
        return "-"
    return with_error(value, row.std_error / 10)[0] if row.std_error else number(value, 6)
