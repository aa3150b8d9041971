"""What a paper prints, beside what follows here."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from diffthrust._support.report import Report, Rows, Section  # the library's own look
from diffthrust._support.tables import report_text
from diffthrust._support.words import number

NEAR = 0.05
"""A figure is reproduced where ours is so near: most are printed with two digits."""


@dataclass(frozen=True)
class Printed:
    """One figure of a paper.

    Args:
        what: it is.
        paper: as printed.
        ours: what follows from the paper's other data or equations here; ``None`` where nothing
            that is printed leads to it (what was measured, and whose record is not printed).
        unit: of both.
        remark: how they hang together, or why not.
        source: the paper, where a table is of several.
    """

    what: str
    paper: float
    ours: float | None
    unit: str
    remark: str = ""
    source: str = ""

    @property
    def ratio(self) -> float:
        """Ours over the paper's."""
        return math.nan if self.ours is None else self.ours / self.paper

    @property
    def outcome(self) -> str:
        """Reproduced; not, and by how much; or not to be checked."""
        if self.ours is None:
            return "cannot be checked"
        away = 100.0 * (self.ratio - 1.0)
        return f"{'reproduced' if abs(away) <= 100.0 * NEAR else 'not'}, {away:+.3g} %"


def printed_table(rows: Iterable[Printed]) -> str:
    """Figure, paper, ours, outcome and why as text; where rows name it, their source first."""
    rows = list(rows)
    headings = ("Figure", "Paper", "Ours", "Unit", "Outcome", "Why")
    first = ("Source",) if any(row.source for row in rows) else ()
    numbers = tuple(i + len(first) for i in (1, 2))
    blocks: dict[str, list[tuple[str, ...]]] = {}
    for row in rows:
        blocks.setdefault(row.source, []).append(
            (*(row.source for _ in first), row.what, f"{row.paper:g}", number(row.ours),
             row.unit, row.outcome, row.remark)
        )  # fmt: skip
    table = Rows((*first, *headings), tuple(map(tuple, blocks.values())), numbers)
    return report_text(Report(Section("", table)))


def counts(rows: Iterable[Printed]) -> dict[str, list[str]]:
    """Figures by how they come out: by every way that leads to them, by some of them, by none."""
    ways: dict[str, list[Printed]] = {}
    for row in rows:
        ways.setdefault(row.what, []).append(row)
    outcomes: dict[str, list[str]] = {
        "reproduced": [], "reproduced by some ways only": [], "not reproduced": [],
        "cannot be checked": [],
    }  # fmt: skip
    for what, several in ways.items():
        near = [abs(row.ratio - 1.0) <= NEAR for row in several if row.ours is not None]
        if not near:
            outcomes["cannot be checked"].append(what)
        elif any(near):
            some = "" if all(near) else " by some ways only"
            outcomes[f"reproduced{some}"].append(what)
        else:
            outcomes["not reproduced"].append(what)
    return outcomes
