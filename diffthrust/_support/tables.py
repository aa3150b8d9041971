"""Tables and numbers for people (rich)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from io import StringIO

from rich.console import Console, RenderableType
from rich.table import Table


def rendered(thing: RenderableType, width: int = 100) -> str:
    """A table as plain text, without colours."""
    out = StringIO()
    Console(file=out, width=width, force_terminal=False, color_system=None).print(thing)
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"


def boxed(headings: Iterable[str], rows: Iterable[tuple[str, ...]]) -> str:
    """A table in a box, as plain text; a row has a cell for each heading."""
    table = Table(*headings)
    for row in rows:
        table.add_row(*row)
    return rendered(table)


def number(value: float | None, digits: int = 4) -> str:
    """A number with some significant digits, ``-`` where there is none.

    Example:
        >>> number(0.0123456)
        '0.01235'
    """
    if value is None or math.isnan(value):
        return "-"
    if value == 0 or 1e-4 <= abs(value) < 1e6:
        places = digits - 1 - (math.floor(math.log10(abs(value))) if value else 0)
        return f"{value:.{min(max(places, 0), digits + 3)}f}"
    return f"{value:.{digits - 1}e}" if math.isfinite(value) else f"{value}"


def with_error(value: float, error: float | None) -> tuple[str, str]:
    """A value and its standard error, both to the second digit of the error.

    Example:
        >>> with_error(0.0370107, 3.0357e-05)
        ('0.037011', '0.000030')
    """
    if error is None or not error > 0 or not math.isfinite(value):
        return number(value), "-" if error is None else number(error, 2)
    places = 1 - math.floor(math.log10(error))
    if 0 <= places <= 8 and abs(value) < 1e6:
        return f"{value:.{places}f}", f"{error:.{places}f}"
    digits = 2
    if value:
        digits = max(2, 2 + math.floor(math.log10(abs(value))) - math.floor(math.log10(error)))
    return f"{value:.{min(digits, 12) - 1}e}", f"{error:.1e}"


def plain_table(*headings: str, numbers: Iterable[int] = ()) -> Table:
    """A table without lines; the columns at ``numbers`` stand to the right."""
    table = Table(box=None, padding=(0, 1), pad_edge=False, header_style="dim")
    for i, heading in enumerate(headings):
        justify = "right" if i in tuple(numbers) else "left"
        table.add_column(heading, justify=justify, overflow="fold")
    return table
