"""The figure of a look."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from diffthrust.logs._figures import Panel, panels_figure
from diffthrust.survey._choice import Choice, Pick

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST = 16
"""Columns that are drawn where none was chosen."""


def look_figure(choice: Choice, name: str) -> Figure:
    """The chosen channels below each other, inputs on top; without any, all numeric columns."""
    picks = sorted(choice.channels.items(), key=lambda pair: pair[1].role != "input")
    named = [(n if n == p.field.name else f"{n}: '{p.field.name}'", p) for n, p in picks]
    if not named:
        numeric = [p for p in choice.columns if np.isfinite(p.field.values).any()]
        named = [(p.field.name, p) for p in numeric if p.meaning.quantity != "time"][:_MOST]
    clock = choice.seconds
    panels = [_panel(label, pick, clock) for label, pick in named]
    return panels_figure(panels, name, *(["sample"] if choice.static else []))


def _panel(label: str, pick: Pick, clock: np.ndarray | None) -> Panel:
    field = pick.field
    time = field.time if field.time is not None else clock
    if time is None:
        time = np.arange(field.values.size, dtype=float)
    driving = pick.role == "input"
    return Panel(label, pick.meaning.unit, time, field.values, driving, driving)
