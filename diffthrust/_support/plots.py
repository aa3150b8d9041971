"""How figures of Bokeh look and what is read in them; only pages that live import it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from textwrap import fill
from typing import Any

from bokeh.models import (
    BasicTicker,
    ColumnDataSource,
    FactorRange,
    HoverTool,
    Label,
    PlainText,
    Range1d,
)
from bokeh.plotting import figure

from diffthrust._support.figures import BLUE
from diffthrust._support.words import humanize

_LOW = 90
"""Display: height of a figure [px] below which more than three ticks collide."""
_WORDS = 30
"""Display: characters beside each other below a staircase 190 px wide, as on a page of 1 000 px,
where "1: + command" ran into "2: + reverse"."""


def plot(y: str, unit: str, *, height: int, **options: Any) -> Any:
    """A figure with a light grid; names and units are plain text, never formulas."""
    made = figure(
        height=height,
        sizing_mode="stretch_width",
        min_border_left=64,
        min_border_right=8,
        **options,
    )
    made.yaxis.axis_label = PlainText(text=with_unit(y, unit, "\n"))
    made.yaxis.axis_label_text_font_size = "10px"
    made.axis.axis_label_text_font_style = "normal"
    made.axis.major_label_text_font_size = "11px"
    made.axis.axis_line_color = "#bbb"
    made.axis.minor_tick_line_color = None
    made.grid.grid_line_color = "#eee"
    made.outline_line_color = None
    if height < _LOW:
        made.yaxis.ticker = BasicTicker(desired_num_ticks=3, mantissas=[1, 2, 2.5, 5])
    return made


def with_unit(name: str, unit: str, between: str = " ") -> str:
    """A name with its unit in brackets."""
    return f"{name}{between}[{unit}]" if unit else name


def hover(drawn: Any, line: Any, rows: Sequence[tuple[str, str, str]]) -> None:
    """Show values beside the mouse: of each the words, its column and its unit."""
    # Bokeh reads values as HTML, and the words before them as text
    tips = [(words, f"@{column}{{%.4g}} {escape(unit)}") for words, column, unit in rows]
    tool: Any = HoverTool(
        tooltips=[("time", "@time{%.2f} s"), *tips],
        formatters={f"@{column}": "printf" for column in ("time", *(row[1] for row in rows))},
        mode="vline",
        renderers=[line],
        line_policy="nearest",
    )
    drawn.add_tools(tool)


class Staircase:
    """The error of a model after each effect that was added."""

    def __init__(self, height: int) -> None:
        self.steps: Any = ColumnDataSource(data={"step": [], "error": [], "label": [], "hatch": []})
        self.factors, self.heights = FactorRange(factors=[]), Range1d(start=0.0, end=1.0)
        drawn = plot(
            "error",
            "",
            height=height,
            x_range=self.factors,
            y_range=self.heights,
            tools=[],
            toolbar_location=None,
            styles={"flex": "1 1 200px", "min-width": "0"},
        )
        look = {"color": BLUE, "hatch_color": "white", "hatch_pattern": {"field": "hatch"}}
        drawn.vbar("step", top="error", width=0.7, source=self.steps, alpha=0.75, **look)
        self.empty: Any = Label(x=8, y=8, x_units="screen", y_units="screen", visible=False)
        self.empty.update(text="no error: the simulation fails", text_font_size="11px")
        drawn.add_layout(self.empty)
        drawn.text(
            "step",
            "error",
            text="label",
            source=self.steps,
            text_align="center",
            y_offset=-2,
            text_font_size="11px",
        )
        drawn.xaxis.major_label_text_font_size = "11px"
        self.figure = drawn

    def show(
        self,
        names: Sequence[str],
        errors: Sequence[float],
        logs: str,
        top: float,
        unfitted: int = 0,
    ) -> None:
        """Show steps: what each has more than the one before, and its error (NRMSE).

        ``logs`` says which err so much, "unseen logs"; an error ``top`` must be within the picture,
        too. The first ``unfitted`` have values that were not fitted: they are hatched.
        """
        width = _WORDS // max(len(names), 1)
        labels = [fill(humanize(name), width, break_long_words=False) for name in names]
        self.factors.factors = labels
        shown = [f"{error:.3g}" for error in errors]
        hatch = ["/" if k < unfitted else " " for k in range(len(labels))]
        self.steps.data = {"step": labels, "error": list(errors), "label": shown, "hatch": hatch}
        self.empty.visible = not any(math.isfinite(error) for error in errors)
        # no range follows a line by itself: the error that sliders had made was above the picture
        finite = [error for error in (*errors, top) if 0 < error < float("inf")]
        self.heights.end = 1.2 * max(finite, default=1.0)
        self.figure.yaxis[0].axis_label.text = f"error (NRMSE),\n{logs}"
