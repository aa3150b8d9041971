"""The rows of profiles, intervals and directions, as data."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from diffthrust._support.report import Bullets, Report, Rows, Section
from diffthrust._support.words import with_error
from diffthrust.uncertainty._values import Interval, Profile, Row, shortest_half_arm


def profile_rows(profiles: Iterable[Profile], level: float) -> Rows:
    """One row for each profile."""
    percent = f"{100 * level:g} %"
    rows = []
    for p in (profile.shown for profile in profiles):
        error = shortest_half_arm(p.value, (p.low, p.high)) or p.std_error
        ends = [("open" if e is None else with_error(e, error)[0]) for e in (p.low, p.high)]
        rows.append((p.name, with_error(p.value, error)[0], *ends, p.unit))
    return Rows.of(("Profile", "Value", f"{percent} from", "to", "Unit"), rows, numbers=(1, 2, 3))


def intervals_report(
    rows: Sequence[Row],
    methods: Sequence[str],
    level: float,
    notes: Iterable[str],
    directions: Report,
) -> Report:
    """One row for each parameter, the recommended interval marked by a star, and what to say."""
    sentences = [sentence for row in rows for sentence in row.sentences]
    return Report(
        Section(f"Intervals of {100 * level:g} %; the recommended one has a star.", *notes),
        Section("", _interval_rows(rows, methods)),
        Section("Where they disagree", Bullets(sentences))
        if sentences
        else Section("", "They agree."),
        Section("What the logs know", *(p for s in directions.sections for p in s.parts)),
    )


def _interval_rows(rows: Sequence[Row], methods: Sequence[str]) -> Rows:
    cells = []
    for row in rows:
        ends = (end for interval in row.intervals.values() for end in interval)
        error = shortest_half_arm(row.value, ends)
        intervals = (
            ("* " if method == row.recommended else "")
            + _ends(row.intervals.get(method), row.bounds, error)
            for method in methods
        )
        name = f"{row.name} [{row.unit}]" if row.unit else row.name
        cells.append((name, with_error(row.value, error)[0], *intervals))
    headings = ("Parameter", "Value", *methods)
    columns = range(1, len(headings))
    return Rows.of(headings, cells, numbers=columns, unbroken=columns)


def _ends(
    interval: Interval | None, bounds: tuple[float | None, float | None], error: float | None
) -> str:
    if interval is None:
        return "-"
    return " to ".join(
        with_error(end, error)[0] if end is not None else "open" if bound is None else "bound"
        for end, bound in zip(interval, bounds, strict=True)
    )


def direction_rows(directions: Iterable[tuple[float, str, Mapping[str, float]]]) -> Rows:
    """How well each direction is known, and what it moves."""
    rows = []
    for std_error, grade, members in directions:
        moves = ", ".join(f"{name} {100 * change:+.2g} %" for name, change in members.items())
        error = f"{100 * std_error:.2g} %" if math.isfinite(std_error) else "-"
        rows.append((error, grade, moves))
    headings = ("Known to", "", "Moves together (by one standard error)")
    return Rows.of(headings, rows, numbers=(0,))
