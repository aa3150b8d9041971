"""Reports for the terminal (rich): tables keep every cell even where the terminal is narrow.

The only file that imports rich; all others hand over a `Report`.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator
from copy import copy
from dataclasses import replace
from io import StringIO

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.measure import Measurement
from rich.table import Column, Table
from rich.text import Text

from diffthrust._support.literals import ToCopy
from diffthrust._support.report import Bullets, Line, Outcome, Report, Rows, Section, Styled
from diffthrust._support.visible import visible

Renderable = RenderableType
WIDEST = 100
"""Columns of text for people: longer lines are hard to read."""
_STYLES = {
    "strong": "bold",
    "quiet": "dim",
    "good": "bold green",
    "bad": "bold red",
    "doubtful": "bold yellow",
    "term": "bold cyan",
}
_GAP = 2
"""Blanks between two columns."""
_PROSE = 20
"""Columns of words are not squeezed below this width while the table can be divided instead."""
_WORD = 32
"""Longer words, such as paths, may be broken."""


def report_text(report: Report) -> str:
    """A report as plain text without colours, as wide as the terminal and at most `WIDEST`."""
    return plain_text(report, min(WIDEST, shutil.get_terminal_size((WIDEST, 24)).columns))


def plain_text(report: Report, width: int) -> str:
    """A report as plain text of a width."""
    out = StringIO()
    # Without force_jupyter=False rich detects a notebook, ignores `file`, and displays its output
    # in the cell instead.
    console = Console(
        file=out, width=width, force_terminal=False, force_jupyter=False, color_system=None
    )
    console.print(renderable(report), crop=False)  # lines to copy may be longer than the width
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"


def print_report(report: Report) -> None:
    """Print a report to the terminal, in colours."""
    Console(highlight=False, force_jupyter=False).print(renderable(report), crop=False)


def renderable(report: Report) -> Renderable:
    """A report for any console of rich."""
    parts: list[RenderableType] = []
    for section in report.sections:
        if section.texts:
            parts += [Text()] if parts else []
            parts += _section(section)
    return _Visible(Group(*parts))


def _section(section: Section) -> Iterator[RenderableType]:
    if section.title:
        yield Text(section.title, "bold")
    for text in section.texts:
        if isinstance(text, Rows):
            yield _table(text)
        elif isinstance(text, Bullets):
            for sentence in text:  # a grid indents the lines that follow the first
                bullet = Table.grid(padding=(0, 1, 0, 0))
                bullet.add_row("-", _text(sentence))
                yield bullet
        elif isinstance(text, Outcome):
            yield Text.assemble((f"{text.label}: ", "bold"), _text(text.word))
            yield _text(text.sentences)
        elif isinstance(text, Line):
            yield Text.assemble(*map(_text, text))
        else:
            yield _text(text)


def _text(text: str) -> Text:
    """A text, no part of it read as markup; code to copy is not broken where it is too long."""
    style = _STYLES.get(text.style, "") if isinstance(text, Styled) else ""
    if isinstance(text, ToCopy) or (isinstance(text, Styled) and not text.breakable):
        return Text(text, style, no_wrap=True, overflow="ignore")
    return Text(text, style)


def _table(rows: Rows) -> FittedTable:
    table = FittedTable(
        box=None,
        padding=(0, 1),
        pad_edge=False,
        header_style="dim",
        show_header=bool(rows.headings),
    )
    width = len(rows.headings or next(filter(None, rows.blocks))[0])
    for i in range(width):
        table.add_column(
            Text(rows.headings[i]) if rows.headings else "",
            justify="right" if i in rows.numbers else "left",
            overflow="fold",
            no_wrap=i in rows.unbroken,
        )
    for block in rows.blocks:
        for row in block:
            table.add_row(*map(_text, row))  # as Text: rich would read "[m/s]" as markup
    return table


class _Visible:
    """Output without control sequences for the terminal other than those of rich itself.

    Names of files and columns come from outside and may contain some.
    """

    def __init__(self, content: RenderableType) -> None:
        self._content = content

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for segment in console.render(self._content, options):
            yield segment if segment.control else segment._replace(text=visible(segment.text))


class FittedTable(Table):
    """A table that keeps every cell where it is too wide: words wrap, columns continue below.

    Numbers are never broken. The first columns, up to the first one of numbers, are repeated before
    the columns that continue below. (A plain table of rich cuts cells off with an ellipsis.)
    """

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        free = options.update(width=100_000, max_width=100_000)
        sizes = [self._sizes(console, free, column) for column in self.columns]
        for i, columns in enumerate(_divided(self.columns, sizes, options.max_width)):
            if i:
                yield ""
            segment = copy(self)
            segment.columns = columns
            yield from super(FittedTable, segment).__rich_console__(console, options)

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
    """The columns of each segment of a table, with their widths."""
    count = len(columns)
    keys = next((i for i, c in enumerate(columns) if c.justify == "right"), 1) or 1
    if sum(sizes[i][1] + _GAP for i in range(keys)) > room // 2:
        keys = 1
    segments = [list(range(count))]
    if _taken(sizes[i][1] for i in range(count)) > room:
        segments, head = [], list(range(keys))
        for i in range(keys, count):
            if not segments or _taken(sizes[k][1] for k in [*segments[-1], i]) > room:
                segments.append(head)
            segments[-1] = [*segments[-1], i]
    for segment in segments or [list(range(count))]:
        widths = _squeezed([sizes[i] for i in segment], room)
        numbered = enumerate(zip(segment, widths, strict=True))
        # rich looks up the cells of a column by its index, which is that of the whole table.
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
