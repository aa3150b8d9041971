"""Plots of runs that live: what drove them, measured against modelled, and the residual.

The workbench shows them, and pages of reports where Bokeh is installed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from bokeh.layouts import gridplot
from bokeh.models import (
    ColumnDataSource,
    Legend,
    LegendItem,
    PlainText,
    Range1d,
    ResetTool,
    Span,
    Tool,
)

from diffthrust._support.envelope import envelopes
from diffthrust._support.figures import BLUE, VERMILLION, is_sparse
from diffthrust._support.plots import hover, plot
from diffthrust.simulation._runs import Run

FIELDS = ("measured", "modelled", "residual")
_DRIVE, _MEASURED = "#262626", "#999999"
"""Colours of what drives a run and of what is measured: those of the pictures, as Bokeh reads."""


class RunPlots:
    """Plots of one run at a time, linked in time.

    Args:
        runs: all that may be shown: their inputs and channels get a plot each.
        heights: of an input, a channel and its residual [px].
        tools: of the plots; they zoom and pan in time alone.
        drag: the tool that a drag of the mouse uses.
        scroll: likewise the wheel; none on a page, which it scrolls.

    Attributes:
        drawn: the source of all but the inputs: ``time``, ``measured0``, ``modelled0``...
        driven: the source of the inputs, which no model changes: ``time``, ``input0``...
        figures: from top to bottom.
        fields: the columns that each of these shows.
    """

    def __init__(
        self,
        runs: Sequence[Run],
        heights: tuple[int, int, int],
        tools: Sequence[Tool],
        drag: Tool,
        scroll: Tool | None = None,
    ) -> None:
        self.inputs = list(dict.fromkeys(n for run in runs for n in _driven(run)))
        self.channels = list(dict.fromkeys(n for run in runs for n in run.channels))
        self.x_range: Any = Range1d(start=0.0, end=1.0)
        self.drawn: Any = ColumnDataSource(data={"time": []})
        self.driven: Any = ColumnDataSource(data={"time": []})
        self.figures: list[Any] = []
        self.fields: list[tuple[str, ...]] = []
        self._widths: list[tuple[Any, float]] = []
        self._heights = heights
        self._tools: dict[str, Any] = {
            "tools": [*tools, ResetTool()],
            "active_drag": drag,
            "active_scroll": scroll,
        }
        for k, name in enumerate(self.inputs):
            run = next(run for run in runs if name in _driven(run))
            self._input(k, name, run.shown.unit(name, run.units.get(name, "")))
        for k, name in enumerate(self.channels):
            self._channel(k, name, [run for run in runs if name in run.channels])
        last = self.figures[-1]
        last.height += 38
        last.xaxis.axis_label = PlainText(text="time since the start of the log [s]")
        for figure in self.figures[:-1]:
            figure.xaxis.visible = False

    @property
    def layout(self) -> Any:
        """The plots, one below the other, with one toolbar."""
        grid: Any = gridplot(
            [[figure] for figure in self.figures],
            toolbar_location="right",
            toolbar_options={"logo": None},
            sizing_mode="stretch_width",
        )
        # in the order of the plots, so that the same page has the same bytes a second time
        tools = [id(tool) for figure in self.figures for tool in figure.toolbar.tools]
        grid.toolbar.tools.sort(key=lambda proxy: tools.index(id(proxy.tools[0])))
        return grid

    def _figure(self, y: str, unit: str, kind: int, *fields: str) -> Any:
        figure = plot(
            y,
            unit,
            height=self._heights[kind],
            x_range=self.x_range,
            y_range=Range1d(start=-1.0, end=1.0),
            **self._tools,
        )
        self.figures.append(figure)
        self.fields.append(fields)
        return figure

    def _input(self, k: int, name: str, unit: str) -> None:
        figure = self._figure(name.replace("_", " "), unit, 0, f"input{k}")
        line = self._line(figure, f"input{k}", _DRIVE, 1.2, source=self.driven)
        hover(figure, line, [(name, f"input{k}", unit)])

    def _channel(self, k: int, name: str, runs: Sequence[Run]) -> None:
        traces = [run.shown_channels[name] for run in runs]
        unit, dots = traces[0].unit, any(is_sparse(trace.measured) for trace in traces)
        measured, modelled, residual = (f"{field}{k}" for field in FIELDS)
        above = self._figure(name.replace("_", " "), unit, 1, measured, modelled)
        first = self._line(above, measured, _MEASURED, 2.4, dots)
        second = self._line(above, modelled, VERMILLION, 1.4)
        hover(above, second, [("measured", measured, unit), ("modelled", modelled, unit)])
        below = self._figure("residual", unit, 2, residual)
        below.add_layout(Span(location=0.0, dimension="width", line_color="#999"))
        third = self._line(below, residual, BLUE, 1.2, dots)
        hover(below, third, [("residual", residual, unit)])
        if not k:  # above, not within: it covered a peak
            above.add_layout(_legend([("measured", first), ("modelled", second)]), "above")

    def _line(
        self, figure: Any, field: str, color: str, width: float, dots: bool = False, **of: Any
    ) -> Any:
        of = {"source": self.drawn, "color": color, **of}
        if dots:  # between samples that are far apart there is no line
            return figure.scatter("time", field, size=4, **of)
        line = figure.line("time", field, line_width=width, **of)
        self._widths.append((line.glyph, width))
        return line

    def columns(self, run: Run) -> dict[str, np.ndarray]:
        """The series of a run, ``(n,)`` each, in the units of its log; NaN where it has none."""
        missing = np.full(run.time.size, np.nan)
        columns = {"time": run.time - run.time[0]}
        for k, name in enumerate(self.inputs):
            values = run.signals.get(name, missing)
            columns[f"input{k}"] = run.shown.values(name, values, run.units.get(name, ""))
        for k, name in enumerate(self.channels):
            trace = run.shown_channels.get(name)
            for field in FIELDS:
                columns[f"{field}{k}"] = missing if trace is None else getattr(trace, field)
        return columns

    def draw(self, edges: np.ndarray, columns: Mapping[str, np.ndarray]) -> None:
        """Draw the envelopes of series, those of ``columns``, between bins of `bins_of`.

        Where a bin has many samples, by thin lines: without a GPU, a frame of a pan over 1 000 000
        samples took 98 ms of a browser's processor, and 44 with lines of one pixel.
        """
        dense = edges[-1] - edges[0] > edges.size - 1
        for glyph, width in self._widths:
            glyph.line_width = 1.0 if dense else width
        drawn = envelopes(edges, columns["time"], {n: v for n, v in columns.items() if n != "time"})
        driven = {n: v for n, v in drawn.items() if n == "time" or n.startswith("input")}
        self.driven.data = driven
        self.drawn.data = {n: v for n, v in drawn.items() if n == "time" or n not in driven}

    def heights(self, *columns: Mapping[str, np.ndarray]) -> list[tuple[float, float]]:
        """The vertical range of each plot in which all of the series can be seen."""
        ranges = []
        for fields in self.fields:
            values = np.concatenate([of[name] for of in columns for name in fields])
            values = values[np.isfinite(values)]
            low, high = (values.min(), values.max()) if values.size else (-1.0, 1.0)
            room = 0.08 * float(high - low) or 1.0
            ranges.append((float(low) - room, float(high) + room))
        return ranges


def _driven(run: Run) -> list[str]:
    return [name for name in run.record.inputs if name in run.signals]


def _legend(items: Sequence[tuple[str, Any]]) -> Legend:
    legend: Any = Legend
    return legend(
        items=[LegendItem(label=words, renderers=[line]) for words, line in items],
        orientation="horizontal",
        location="top_right",
        padding=0,
        margin=0,
        spacing=14,
        label_text_font_size="11px",
        label_height=14,
        glyph_height=14,
        border_line_color=None,
    )
