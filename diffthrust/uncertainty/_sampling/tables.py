"""Draws as tables for people."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.text import Text

from diffthrust._support.tables import plain_table, with_error
from diffthrust.estimation._tables import closing_parts
from diffthrust.uncertainty._prediction.tables import interval_text
from diffthrust.uncertainty._sampling.summary import Sampled

HEADINGS = ("Parameter", "Median", "95 % from", "to", "Unit", "R-hat", "ESS bulk", "ESS tail")
"""The headings of `draw_rows`, but for the last column, which is the fit's estimate."""


def draw_rows(sampled: Sampled) -> list[tuple[str, ...]]:
    """One row for each parameter, with the fit's estimate at the end."""
    rows = []
    for name, s in sampled.parameters.items():
        fitted = sampled.fit.parameters.get(name) or (sampled.fit.disturbance or {}).get(name)
        estimate = "-"
        if fitted is not None:
            value, error = with_error(*fitted.shown[:2])
            estimate = value if fitted.std_error is None else f"{value} ± {error}"
        interval = interval_text(*(s.per * x for x in (s.median, s.low, s.high)))
        mixing = f"{s.rhat:.3f}", f"{s.ess_bulk:.0f}", f"{s.ess_tail:.0f}"
        rows.append((name, *interval, s.shown_unit, *mixing, estimate))
    return rows


def sample_table(sampled: Sampled) -> RenderableType:
    """Convergence in words, the parameters, and how the predictions of unseen logs came out."""
    judged = sampled.convergence
    colour = "bold green" if judged.status.ok else "bold red"
    parts: list[RenderableType] = [
        Text(str(sampled.fit.model), style="bold"),
        Text.assemble(("Status: ", "bold"), (judged.status.value, colour)),
        Text(judged.message),
        Text(),
    ]
    table = plain_table(*HEADINGS, "Fit", numbers=(1, 2, 3, 5, 6, 7, 8))
    for row in draw_rows(sampled):
        table.add_row(*map(escape, row))
    parts += [table, Text(), sampled.intervals.table(), Text()]
    for prediction in sampled.predictions:
        parts += [prediction.table(), Text()]
    if not sampled.predictions:
        parts.append(Text("There is no unseen log to hold the predictions against."))
    notes = (Text(f"Note: {note}") for note in sampled.fit.notes)
    return Group(*parts, *notes, *closing_parts(sampled.closing))
