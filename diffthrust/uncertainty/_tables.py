"""Profiles, intervals and directions as tables for people."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.text import Text

from diffthrust._support.tables import plain_table, with_error
from diffthrust.uncertainty._intervals_row import Interval, Row
from diffthrust.uncertainty._profile_curve import Profile


def profiles_table(
    profiles: Sequence[Profile], level: float, sentences: Iterable[str]
) -> RenderableType:
    """One row for each profile, and the sentences."""
    percent = f"{100 * level:g} %"
    table = plain_table("Profile", "Value", f"{percent} from", "to", "Unit", numbers=(1, 2, 3))
    for p in (profile.shown for profile in profiles):
        arms = [abs(e - p.value) for e in (p.low, p.high) if e is not None and e != p.value]
        error = 0.5 * min(arms) if arms else p.std_error
        ends = [("open" if e is None else with_error(e, error)[0]) for e in (p.low, p.high)]
        table.add_row(escape(p.name), with_error(p.value, error)[0], *ends, escape(p.unit))
    return Group(table, Text(), *(Text(s) for s in sentences))


def intervals_table(
    rows: Sequence[Row],
    methods: Sequence[str],
    level: float,
    notes: Iterable[str],
    directions: RenderableType,
) -> RenderableType:
    """One row for each parameter, the recommended interval marked by a star, and what to say."""
    headings = ("Parameter", "Value", *methods)
    table = plain_table(*headings, numbers=range(1, len(headings)))
    for column in table.columns[1:]:
        column.no_wrap = True
    for row in rows:
        error = _error(row)
        cells = [
            ("* " if method == row.recommended else "")
            + _ends(row.intervals.get(method), row.bounds, error)
            for method in methods
        ]
        name = escape(f"{row.name} [{row.unit}]" if row.unit else row.name)
        table.add_row(name, with_error(row.value, error)[0], *cells)
    parts = [
        Text(f"Intervals of {100 * level:g} %; the recommended one has a star.", style="bold"),
        *(Text(note) for note in notes),
        Text(),
        table,
        Text(),
    ]
    sentences = [sentence for row in rows for sentence in row.sentences]
    if sentences:
        parts += [Text("Where they disagree", style="bold")]
        parts += [Text(f"- {s}") for s in sentences]
    else:
        parts += [Text("They agree.")]
    parts += [Text(), Text("What the logs know", style="bold"), directions]
    return Group(*parts)


def _ends(
    interval: Interval | None, bounds: tuple[float | None, float | None], error: float | None
) -> str:
    if interval is None:
        return "-"
    return " to ".join(
        with_error(end, error)[0] if end is not None else "open" if bound is None else "bound"
        for end, bound in zip(interval, bounds, strict=True)
    )


def _error(row: Row) -> float | None:
    """What sets the number of digits of a row: half of the shortest arm."""
    ends = [e for interval in row.intervals.values() for e in interval if e is not None]
    arms = [abs(e - row.value) for e in ends if e != row.value]
    return 0.5 * min(arms) if arms else None


def directions_table(
    directions: Iterable[tuple[float, str, Mapping[str, float]]],
) -> RenderableType:
    """How well each direction is known, and what it moves.

    Args:
        directions: of each its standard error, its grade, and the relative changes by parameter.
    """
    table = plain_table("Known to", "", "Moves together (by one standard error)", numbers=(0,))
    for std_error, grade, members in directions:
        moves = ", ".join(f"{escape(n)} {100 * c:+.2g} %" for n, c in members.items())
        table.add_row(f"{100 * std_error:.2g} %" if math.isfinite(std_error) else "-", grade, moves)
    return table
