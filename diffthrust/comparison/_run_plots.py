"""Plots of runs that live: what drove them, measured against modelled, and the residual.

The workbench shows them, and pages of reports where Bokeh is installed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from bokeh.events import DoubleTap
from bokeh.layouts import column, gridplot, row
from bokeh.models import (
    BoxZoomTool,
    ColumnDataSource,
    CustomJS,
    Legend,
    LegendItem,
    PanTool,
    PlainText,
    Range1d,
    ResetTool,
    Span,
    Tool,
    WheelZoomTool,
)

from diffthrust._support.envelope import bins_of, envelope, envelopes
from diffthrust._support.figures import BLUE, VERMILLION, is_sparse
from diffthrust._support.live import Live
from diffthrust._support.plots import Staircase, hover, plot
from diffthrust.simulation._record import are_tables
from diffthrust.simulation._runs import Run

_FIELDS = ("measured", "modelled", "residual")
_DRIVE, _MEASURED = "#262626", "#999999"
"""Colours of what drives a run and of what is measured: those of the pictures, as Bokeh reads."""


class RunPlots:
    """Plots of one run at a time, linked in time.

    All ``runs`` that may be shown give a plot to each of their inputs and channels; ``heights`` are
    those of an input, a channel and its residual [px]. The tools zoom and pan in time alone; a page
    needs no ``scroll``, as the wheel scrolls it.

    Of the sources, ``driven`` has the inputs, which no model changes (``time``, ``input0``...), and
    ``drawn`` all else (``time``, ``measured0``, ``modelled0``...). ``figures`` go from top to
    bottom; ``fields`` are the columns that each of these shows.
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
        measured, modelled, residual = (f"{field}{k}" for field in _FIELDS)
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
            for field in _FIELDS:
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
        inputs = [n for n in drawn if n.startswith("input")]
        self.driven.data = {n: drawn[n] for n in ("time", *inputs)}
        self.drawn.data = {n: v for n, v in drawn.items() if n not in inputs}

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


_NUMBERS = 60_000
"""Numbers in a figure of a page, 0.3 MB in it: more cannot be seen, and a page has several."""
_FEWEST = 300
"""Bins of a log on a page, each with a least and a greatest value; fewer look coarse. Where more
logs are there than fit, the worst are shown."""
_CHOOSE = """
const [log, model] = cb_obj.tags
driven.data = logs[log].data
cb_obj.data = {...logs[log].data, ...models[log][model].data}
const x = figures[0].x_range
if (x.tags[0] != log) {  // models of one log keep its scale: the eye sees the error fall
  const ends = (start, end) => ({start, end, reset_start: start, reset_end: end})
  figures.forEach((figure, k) => figure.y_range.setv(ends(...heights[log][k])))
  x.setv({...ends(0, durations[log]), tags: [log]})
}
"""


def live_runs(
    models: Mapping[str, Sequence[Run]],
    errors: Sequence[float] = (),
    logs: str = "",
) -> Live | None:
    """Runs on a page, to choose log and model, the last first; ``None`` without time (tables).

    Where there are several models, their errors (NRMSE) are drawn as a staircase beside the plots;
    ``logs`` says which err so much, "unseen logs".
    """
    runs = [of for of in zip(*models.values(), strict=True) if of[-1].channels]
    if not runs or are_tables(run.record for run, *_ in runs):
        return None
    runs.sort(key=lambda of: -np.nan_to_num(of[0].errors.nrmse, nan=-1.0))
    zoom = BoxZoomTool(dimensions="width")
    tools = [zoom, PanTool(dimensions="width"), WheelZoomTool(dimensions="width")]
    plots = RunPlots([run for of in runs for run in of], (96, 170, 100), tools, zoom)
    width = 1 + len(plots.inputs) + len(plots.channels) * (1 + 2 * len(models))
    shown = runs[: max(1, _NUMBERS // (2 * _FEWEST * width))]
    bins = _NUMBERS // (2 * width * len(shown))
    stock, remark = _stock(plots, shown, bins)
    plots.drawn.js_on_change("tags", stock)
    first = len(models) - 1
    plots.driven.data = dict(stock.args["logs"][0].data)
    plots.drawn.data = {**stock.args["logs"][0].data, **stock.args["models"][0][first].data}
    for figure, (low, high) in zip(plots.figures, stock.args["heights"][0], strict=True):
        figure.y_range.update(start=low, end=high)
        figure.js_on_event(DoubleTap, CustomJS(args={"x": plots.x_range}, code="x.reset()"))
    plots.x_range.update(start=0.0, end=stock.args["durations"][0], tags=[0])
    choices = {"Log": [of[0].name for of in shown], "Model": list(models)}
    layout = plots.layout
    if len(models) > 1 and errors:
        stairs = Staircase(250)
        stairs.show(list(models), errors, logs, 0.0)
        layout = row(
            stairs.figure,
            column(layout, sizing_mode="stretch_width", styles={"flex": "4 1 420px"}),
            sizing_mode="stretch_width",
            styles={"flex-wrap": "wrap"},
        )
    if len(shown) < len(runs):
        remark += f" The {len(shown)} worst of {len(runs)} logs."
    return Live(layout, plots.drawn, choices, (0, first), remark.strip())


def _stock(plots: RunPlots, runs: Sequence[Sequence[Run]], bins: int) -> tuple[Any, str]:
    """What is drawn when a log and a model are chosen, and what is said of its resolution."""
    logs, models, heights, durations, most = [], [], [], [], 1
    for of in runs:
        columns = [plots.columns(run) for run in of]
        time = columns[0]["time"]
        edges = bins_of(time, float(time[0]), float(time[-1]), bins)
        most = max(most, int(np.diff(edges).max()))
        changed = [name for name in columns[0] if name.startswith(("modelled", "residual"))]
        same = {n: v for n, v in columns[0].items() if n not in changed and n != "time"}
        logs.append(ColumnDataSource(data=envelopes(edges, time, same)))
        models.append(
            [ColumnDataSource(data={n: envelope(edges, c[n]) for n in changed}) for c in columns]
        )
        heights.append(plots.heights(*columns))
        durations.append(float(time[-1]))
    args = {"logs": logs, "models": models, "heights": heights, "durations": durations}
    args |= {"figures": plots.figures, "driven": plots.driven}
    words = f"Drawn by the least and the greatest of each {most} samples." if most > 1 else ""
    return CustomJS(args=args, code=_CHOOSE), words
