"""What a paper prints, beside what follows here."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from diffthrust._support.tables import number, plain_table, rendered  # the library's own look


@dataclass(frozen=True)
class Printed:
    """One figure of a paper.

    Args:
        what: it is.
        paper: as printed.
        ours: what follows from the paper's own data or equations here.
        unit: of both.
        remark: how they hang together.
        source: the paper, where a table is of several.
    """

    what: str
    paper: float
    ours: float
    unit: str
    remark: str = ""
    source: str = ""

    @property
    def ratio(self) -> float:
        """Ours over the paper's."""
        return self.ours / self.paper if self.paper else math.nan


def printed_table(rows: Iterable[Printed]) -> str:
    """Figure, paper, ours, ratio and remark as text; where rows name it, their source first."""
    rows = list(rows)
    headings = ("Figure", "Paper", "Ours", "Unit", "Ratio", "Remark")
    first = ("Source",) if any(row.source for row in rows) else ()
    numbers = tuple(i + len(first) for i in (1, 2, 4))
    table = plain_table(*first, *headings, numbers=numbers)
    source = rows[0].source if rows else ""
    for row in rows:
        if row.source != source:
            table.add_section()
            source = row.source
        table.add_row(*(row.source for _ in first), row.what, f"{row.paper:g}", number(row.ours),
                      row.unit, number(row.ratio, 3), row.remark)  # fmt: skip
    return rendered(table)
