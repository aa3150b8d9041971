"""The figure of a look."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from diffthrust.logs._figures import Panel, panels_figure
from diffthrust.survey._choice import Choice, Pick

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST = 16


def look_figure(choice: Choice, name: str) -> Figure:
    """The chosen channels below each other, inputs on top; without any, all numeric columns."""
    clock = choice.seconds
    picks = sorted(choice.channels.items(), key=lambda pair: pair[1].role != "input")
    panels = [_panel(_label(key, pick.field.name), pick, clock) for key, pick in picks]
    if not panels:
        numeric = [
            pick
            for pick in choice.columns
            if np.isfinite(pick.field.values).any() and pick.meaning.quantity != "time"
        ]
        panels = [_panel(pick.field.name, pick, clock) for pick in numeric[:_MOST]]
    return panels_figure(panels, name, *(["sample"] if choice.static else []))


def _label(channel: str, column: str) -> str:
    return channel if channel == column else f"{channel}: '{column}'"


def _panel(label: str, pick: Pick, clock: np.ndarray | None) -> Panel:
    field = pick.field
    time = field.time if field.time is not None else clock
    if time is None:
        time = np.arange(field.values.size, dtype=float)
    driving = pick.role == "input"
    return Panel(label, pick.meaning.unit, time, field.values, driving, driving)
