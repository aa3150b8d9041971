"""Tables and numbers for people (rich): as text that loses nothing when narrow, and as HTML."""

from __future__ import annotations

import math
import shutil
import textwrap
from collections.abc import Iterable, Iterator
from copy import copy
from dataclasses import replace
from html import escape
from io import StringIO

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.measure import Measurement
from rich.table import Column, Row, Table
from rich.text import Text

from diffthrust._support.literals import ToCopy
from diffthrust._support.visible import visible

WIDEST = 100
"""Text for people has lines of at most so many characters."""
_GAP = 2
_PROSE = 20
"""Words in a column are not squeezed below so many characters while the table can be divided."""
_WORD = 32
"""Longer words, such as paths, may be broken."""


def rendered(thing: RenderableType) -> str:
    """A table as plain text, without colours; as wide as the terminal, and at most `WIDEST`.

    Of a text only lines that are too long are broken.
    """
    width = min(WIDEST, shutil.get_terminal_size((WIDEST, 24)).columns)
    if isinstance(thing, str):
        return "\n".join(textwrap.fill(line, width) or line for line in thing.split("\n"))
    out = StringIO()
    # in a notebook rich would print past the file
    console = Console(
        file=out, width=width, force_terminal=False, force_jupyter=False, color_system=None
    )
    console.print(Visible(thing), crop=False)  # lines to copy may be longer
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"


def line_text(line: str, style: str = "") -> Text:
    """A line of prose, which is broken where it is too long; one to copy is not."""
    if isinstance(line, ToCopy):
        return Text(line, style, no_wrap=True, overflow="ignore")
    return Text(line, style)


class Visible:
    """A table or text in which no order for the terminal is left but its own colours.

    Args:
        thing: what is shown.
    """

    def __init__(self, thing: RenderableType) -> None:
        self.thing = thing

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for segment in console.render(self.thing, options):
            yield segment if segment.control else segment._replace(text=visible(segment.text))


class FittedTable(Table):
    """A table that loses nothing where it is too wide: words wrap, and columns go on below.

    Numbers are never broken. The first columns, up to the first one that stands to the right, stand
    again before those that go on below.
    """

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        free = options.update(width=100_000, max_width=100_000)
        sizes = [self._sizes(console, free, column) for column in self.columns]
        for i, columns in enumerate(_divided(self.columns, sizes, options.max_width)):
            if i:
                yield ""
            part = copy(self)
            part.columns = columns
            yield from super(FittedTable, part).__rich_console__(console, options)

    def _sizes(
        self, console: Console, options: ConsoleOptions, column: Column
    ) -> tuple[int, int, int]:
        """The widths of a column: of its longest word, one that reads well, and the natural one."""
        head = Measurement.get(console, options, column.header)
        cells = [Measurement.get(console, options, cell) for cell in column.cells]
        widest = max([head.maximum, *(cell.maximum for cell in cells)])
        if column.no_wrap:
            return widest, widest, widest
        if column.justify == "right":
            least = max([head.minimum, *(cell.maximum for cell in cells)])
            return least, least, widest
        least = min(max([head.minimum, *(cell.minimum for cell in cells)]), _WORD)
        return least, max(least, min(widest, _PROSE)), widest


def _divided(
    columns: list[Column], sizes: list[tuple[int, int, int]], room: int
) -> Iterator[list[Column]]:
    """The columns of each part of a table, with their widths."""
    count = len(columns)
    keys = next((i for i, c in enumerate(columns) if c.justify == "right"), 1) or 1
    if sum(sizes[i][1] + _GAP for i in range(keys)) > room // 2:
        keys = 1
    parts = [list(range(count))]
    if _taken(sizes[i][1] for i in range(count)) > room:
        parts, head = [], list(range(keys))
        for i in range(keys, count):
            if not parts or _taken(sizes[k][1] for k in [*parts[-1], i]) > room:
                parts.append(head)
            parts[-1] = [*parts[-1], i]
    for part in parts or [list(range(count))]:
        widths = _squeezed([sizes[i] for i in part], room)
        numbered = enumerate(zip(part, widths, strict=True))
        yield [replace(columns[i], width=width, _index=k) for k, (i, width) in numbered]


def _squeezed(sizes: list[tuple[int, int, int]], room: int) -> list[int]:
    """The widest columns made narrower, until all fit or no word could stay whole."""
    widths, least = [s[2] for s in sizes], [s[1] for s in sizes]
    if _taken(least) > room:
        least = [s[0] for s in sizes]
    while _taken(widths) > room and any(w > m for w, m in zip(widths, least, strict=True)):
        widest = max((w, i) for i, w in enumerate(widths) if w > least[i])[1]
        widths[widest] -= 1
    return widths


def _taken(widths: Iterable[int]) -> int:
    return sum(width + _GAP for width in widths) - _GAP


def texts_table(
    headings: Iterable[str], rows: Iterable[Iterable[str]], numbers: Iterable[int] = ()
) -> FittedTable:
    """A table of texts of which none is read as markup; a row has a cell for each heading."""
    table = plain_table(*headings, numbers=numbers)
    for row in rows:
        table.add_row(*map(Text, row))
    return table


def together(*parts: RenderableType) -> Group:
    """Tables and texts below each other; no text is read as markup."""
    return Group(*(Text(part) if isinstance(part, str) else part for part in parts))


def html(thing: RenderableType) -> str:
    """The same for a notebook: texts as paragraphs, tables as tables."""
    return f'<div style="max-width: 60em">{_html(thing)}</div>'


def _html(thing: RenderableType) -> str:
    if isinstance(thing, Group):
        return "".join(map(_html, thing.renderables))
    if isinstance(thing, Table):
        return _html_table(thing)
    if isinstance(thing, Text):
        return f'<div style="white-space: pre-wrap; min-height: .6em">{_marked(thing)}</div>'
    return f"<pre>{escape(str(thing))}</pre>"


def _html_table(table: Table) -> str:
    aligned = [
        f"padding: .1em .5em; text-align: {'right' if c.justify == 'right' else 'left'}"
        for c in table.columns
    ]
    heads = "".join(
        f'<th style="{align}">{_marked(column.header)}</th>'
        for align, column in zip(aligned, table.columns, strict=True)
    )
    cells = zip(*(column.cells for column in table.columns), strict=True)
    lines = "".join(
        _html_row(row, before, aligned, line)
        for row, before, line in zip(table.rows, [None, *table.rows], cells, strict=False)
    )
    head = f"<thead><tr>{heads}</tr></thead>" if table.show_header else ""
    style = "margin: .5em 0; border-collapse: collapse"
    return f'<table style="{style}">{head}<tbody>{lines}</tbody></table>'


def _html_row(
    row: Row, before: Row | None, aligned: list[str], cells: tuple[RenderableType, ...]
) -> str:
    line = "; border-top: 1px solid #8888" if before is not None and before.end_section else ""
    bold = "; font-weight: bold" if "bold" in str(row.style) else ""
    return "<tr>{}</tr>".format(
        "".join(
            f'<td style="{align}{line}{bold}">{_marked(cell)}</td>'
            for align, cell in zip(aligned, cells, strict=True)
        )
    )


def _marked(cell: RenderableType) -> str:
    """A text with its colours and weights."""
    text = cell if isinstance(cell, Text) else Text.from_markup(str(cell))
    console = Console(file=StringIO(), force_jupyter=False, force_terminal=True)
    base, parts = console.get_style(text.style), []
    for segment in text.render(console):
        css = (base + segment.style).get_html_style()
        words = escape(segment.text)
        parts.append(f'<span style="{escape(css)}">{words}</span>' if css else words)
    return "".join(parts)


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


def plain_table(*headings: str, numbers: Iterable[int] = ()) -> FittedTable:
    """A table without lines, under plain texts; the columns at ``numbers`` stand to the right."""
    table = FittedTable(box=None, padding=(0, 1), pad_edge=False, header_style="dim")
    numbers = tuple(numbers)
    for i, heading in enumerate(headings):
        justify = "right" if i in numbers else "left"
        table.add_column(Text(heading), justify=justify, overflow="fold")
    return table
