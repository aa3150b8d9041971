"""The plots of one log: what drove it, measured against modelled, and what is left between them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
from bokeh.events import SelectionGeometry
from bokeh.layouts import gridplot
from bokeh.models import (
    BoxAnnotation,
    BoxSelectTool,
    ColumnDataSource,
    HoverTool,
    PanTool,
    PlainText,
    Range1d,
    ResetTool,
    Span,
    WheelZoomTool,
)

from diffthrust._support.figures import BLUE, VERMILLION
from diffthrust.simulation._runs import Run
from diffthrust.workbench._envelope import bins_of, envelope, envelopes, stretches
from diffthrust.workbench._look import (
    DARK,
    FAILING,
    GREEN,
    LEFT_OUT,
    SELECTED,
    box_of,
    plot,
)

_BINS = 450
"""Display: bins of what is in sight, each with a least and a greatest value. Without a GPU, a
browser drew 1 000 000 samples 1.3 times a second with 3 000 bins in all, and 4.3 times with 900."""
_BESIDE = 0.5
"""Display: widths of the picture that are sent on either side of it: a pan within them is drawn by
the browser alone."""
_LIT = 1500
"""Display: samples of a selection that light up; more would cover each other."""

_FIELDS = ("measured", "modelled", "residual")
Stretches = Sequence[tuple[float, float]]


class Plots:
    """The plots of the log that is shown, linked in time.

    Args:
        runs: of all logs: their channels get a plot each.
        on_select: is told the stretch [s] that was drawn in the plots.
    """

    def __init__(self, runs: Sequence[Run], on_select: Callable[[float, float], None]) -> None:
        self.inputs = list(dict.fromkeys(n for run in runs for n in _driven(run)))
        self.channels = list(dict.fromkeys(n for run in runs for n in run.channels))
        self.on_select = on_select
        self.x_range: Any = Range1d(start=0.0, end=1.0)
        self.inputs_drawn: Any = ColumnDataSource(data={"time": []})
        self.drawn: list[Any] = [ColumnDataSource(data={"time": []}) for _ in self.channels]
        self.lit: Any = ColumnDataSource(data={"time": []})
        self.failing: list[Any] = [
            ColumnDataSource(data={"x0": [], "x1": []}) for _ in self.channels
        ]
        self.left_out: Any = ColumnDataSource(data={"x0": [], "x1": []})
        self.brushes: list[BoxAnnotation] = []
        self.run: Run = runs[0]
        self._columns: dict[str, np.ndarray] = {}
        self._sent, self._span, self._asked = np.array([0, 1]), (0.0, 0.0), False
        self._keep(runs[0])
        self._send()
        self.layout = self._grid(runs)
        self.x_range.on_change("start", self._on_range)
        self.x_range.on_change("end", self._on_range)

    # -- drawing ---------------------------------------------------------------------------------

    def _grid(self, runs: Sequence[Run]) -> Any:
        many = len(self.channels) > 2
        drawn = [self._command(k, runs) for k in range(len(self.inputs))]
        for k, name in enumerate(self.channels):
            unit = next(r.shown_channels[name].unit for r in runs if name in r.channels)
            drawn.append(self._compared(k, name, unit, 100 if many else 122))
            drawn.append(self._residual(k, unit, 74 if many else 80))
        last = drawn[-1]
        last.height += 38
        last.xaxis.axis_label = PlainText(text="time since the start of the log [s]")
        for figure in drawn[:-1]:
            figure.xaxis.visible = False
        self.figures = drawn
        count = len(self.inputs)
        self._fields = [(drawn[k], (f"input{k}",)) for k in range(count)]
        for k in range(len(self.channels)):
            both = (f"measured{k}", f"modelled{k}")
            self._fields += [(drawn[count + 2 * k], both)]
            self._fields += [(drawn[count + 2 * k + 1], (f"residual{k}",))]
        return gridplot(
            [[figure] for figure in drawn],
            toolbar_location="right",
            toolbar_options={"logo": None},
            sizing_mode="stretch_width",
        )

    def _figure(self, y: str, unit: str, height: int) -> Any:
        pan, wheel = PanTool(dimensions="width"), WheelZoomTool(dimensions="width")
        select = BoxSelectTool(dimensions="width", description="Select a stretch")
        figure = plot(
            y,
            unit,
            height=height,
            x_range=self.x_range,
            y_range=Range1d(start=-1.0, end=1.0),
            tools=[pan, wheel, select, ResetTool()],
            active_drag=pan,
            active_scroll=wheel,
        )
        figure.vstrip(
            "x0", "x1", source=self.left_out, fill_color=LEFT_OUT, fill_alpha=0.3, line_color=None
        )
        brush = BoxAnnotation(fill_color=SELECTED, fill_alpha=0.2, line_color=None, visible=False)
        figure.add_layout(brush)
        self.brushes.append(brush)
        figure.on_event(SelectionGeometry, self._on_geometry)
        return figure

    def _command(self, k: int, runs: Sequence[Run]) -> Any:
        name = self.inputs[k]
        run = next(run for run in runs if name in _driven(run))
        unit = run.shown.unit(name, run.units.get(name, ""))
        figure = self._figure(name.replace("_", " "), unit, 74)
        figure.line("time", f"input{k}", source=self.inputs_drawn, color=GREEN, line_width=1.5)
        _hover(figure, [(name, f"input{k}", unit)])
        return figure

    def _compared(self, k: int, name: str, unit: str, height: int) -> Any:
        figure = self._figure(name.replace("_", " "), unit, height)
        self._shade(figure, k)
        for column, color, words in (("measured", DARK, "measured"), ("modelled", BLUE, "model")):
            figure.line(
                "time",
                column,
                source=self.drawn[k],
                color=color,
                line_width=1.2 if column == "measured" else 1.8,
                alpha=0.75 if column == "measured" else 1.0,
                **(
                    {} if k else {"legend_label": words}
                ),  # in the first plot: it takes time to paint
            )
        figure.scatter("time", f"measured{k}", source=self.lit, size=5, color=VERMILLION)
        if not k:
            _place_legend(figure.legend)
        _hover(figure, [("measured", "measured", unit), ("model", "modelled", unit)])
        return figure

    def _residual(self, k: int, unit: str, height: int) -> Any:
        figure = self._figure("residual", unit, height)
        self._shade(figure, k)
        figure.add_layout(Span(location=0.0, dimension="width", line_color="#999"))
        figure.line("time", "residual", source=self.drawn[k], color=VERMILLION, line_width=1.2)
        figure.scatter("time", f"residual{k}", source=self.lit, size=5, color=SELECTED)
        _hover(figure, [("residual", "residual", unit)])
        return figure

    def _shade(self, figure: Any, k: int) -> None:
        figure.vstrip(
            "x0", "x1", source=self.failing[k], fill_color=FAILING, fill_alpha=0.18, line_color=None
        )

    # -- what is shown ---------------------------------------------------------------------------

    def show(self, run: Run, left_out: Stretches = ()) -> None:
        """Show a log from end to end."""
        self.run = run
        self._keep(run)
        self.left_out.data = _strips(left_out)
        self.shade({})
        self.light_up(np.zeros(run.time.size, bool))
        self.brush(None)
        duration = float(self._columns["time"][-1])
        self.x_range.update(start=0.0, end=duration, bounds=(-0.2 * duration, 1.2 * duration))
        self.x_range.reset_start, self.x_range.reset_end = 0.0, duration
        self._fit_heights(anew=True)
        self._send()

    def update(self, run: Run, *, rescaled: bool = True) -> None:
        """Show the same log as another model gives it: only what has changed is sent, at once.

        Args:
            run: of the other model.
            rescaled: whether scales may shrink; under a slider they stay, or the eye loses them.
        """
        self.run = run
        self._keep(run)
        for k, source in enumerate(self.drawn):
            changed = (f"modelled{k}", f"residual{k}")
            columns = {n[: -len(str(k))]: envelope(self._sent, self._columns[n]) for n in changed}
            source.data.update(columns)
        self._fit_heights(anew=rescaled)

    def _fit_heights(self, *, anew: bool) -> None:
        """Let all of a series be seen, with a scale of its own or the one that it has."""
        for figure, names in self._fields:
            finite = [v[np.isfinite(v)] for v in (self._columns[name] for name in names)]
            low = min((float(v.min()) for v in finite if v.size), default=-1.0)
            high = max((float(v.max()) for v in finite if v.size), default=1.0)
            room, ends = 0.08 * (high - low) or 1.0, figure.y_range
            if anew or low < ends.start or high > ends.end:
                ends.update(start=low - room, end=high + room)

    def shade(self, failing: Mapping[str, Stretches]) -> None:
        """Shade where each channel fails."""
        for source, channel in zip(self.failing, self.channels, strict=True):
            source.data = _strips(failing.get(channel, ()))

    def light_up(self, selected: np.ndarray) -> None:
        """Mark samples, by booleans over those of the log."""
        at = np.flatnonzero(selected)
        at = at[:: max(1, -(-at.size // _LIT))]
        names = [n for n in self._columns if n.startswith(("time", "measured", "residual"))]
        self.lit.data = {name: self._columns[name][at] for name in names}

    def brush(self, stretch: tuple[float, float] | None) -> None:
        """Show which stretch is selected."""
        for brush in self.brushes:
            if stretch is not None:
                brush.update(left=stretch[0], right=stretch[1])
            brush.visible = stretch is not None

    def zoom(self, start: float, stop: float) -> None:
        """Show a stretch with a little around it."""
        margin = 0.25 * (stop - start) + 10 * float(np.median(np.diff(self._columns["time"])))
        self.x_range.update(start=start - margin, end=stop + margin)

    def marked(self, where: np.ndarray) -> Stretches:
        """Marked samples as stretches of the time that is shown."""
        return stretches(where, self._columns["time"])

    def _keep(self, run: Run) -> None:
        """Keep the series of a run, in the units of its log."""
        missing = np.full(run.time.size, np.nan)
        columns = {"time": run.time - run.time[0]}
        for k, name in enumerate(self.inputs):
            values = run.signals.get(name, missing)
            columns[f"input{k}"] = run.shown.values(name, values, run.units.get(name, ""))
        for k, name in enumerate(self.channels):
            trace = run.shown_channels.get(name)
            for field in _FIELDS:
                columns[f"{field}{k}"] = missing if trace is None else getattr(trace, field)
        self._columns = columns

    def _send(self) -> None:
        """Send what is in sight, and as much on either side."""
        time = self._columns["time"]
        start, end = float(self.x_range.start), float(self.x_range.end)
        width = end - start
        self._span = (start - _BESIDE * width, end + _BESIDE * width)
        self._sent = bins_of(time, *self._span, int((1 + 2 * _BESIDE) * _BINS))
        inputs = {f"input{k}": self._columns[f"input{k}"] for k in range(len(self.inputs))}
        self.inputs_drawn.data = envelopes(self._sent, time, inputs)
        for k, source in enumerate(self.drawn):
            columns = {field: self._columns[f"{field}{k}"] for field in _FIELDS}
            source.data = envelopes(self._sent, time, columns)

    # -- what the user does ----------------------------------------------------------------------

    def _on_range(self, attr: str, old: float, new: float) -> None:
        document = self.x_range.document
        if document is not None and not self._asked:
            # both ends come one after the other, and a drag sends sixty pairs a second
            self._asked = True
            document.add_next_tick_callback(self._sight)

    def _sight(self) -> None:
        self._asked = False
        start, end = float(self.x_range.start), float(self.x_range.end)
        (low, high), width = self._span, end - start
        near = 0.1 * width  # the end of what was sent: the next part is fetched before it is seen
        zoomed = abs((high - low) / (1 + 2 * _BESIDE) - width) > 0.01 * width
        first, last = 0.0, float(self._columns["time"][-1])
        if zoomed or (start - low < near and low > first) or (high - end < near and high < last):
            self._send()

    def _on_geometry(self, event: SelectionGeometry) -> None:
        box = box_of(event)
        if box is not None:
            self.on_select(box["x0"], box["x1"])


def _driven(run: Run) -> list[str]:
    return [name for name in run.record.inputs if name in run.signals]


def _place_legend(legend: Any) -> None:
    legend.orientation = "horizontal"
    legend.location = "top_right"
    legend.padding, legend.margin = 2, 2
    legend.label_text_font_size = "11px"
    legend.background_fill_alpha = 0.7
    legend.border_line_color = None


def _strips(pairs: Stretches) -> dict[str, list[float]]:
    return {"x0": [pair[0] for pair in pairs], "x1": [pair[1] for pair in pairs]}


def _hover(figure: Any, rows: Sequence[tuple[str, str, str]]) -> None:
    tips = [
        (escape(words), f"@{column}{{0,0.0[000]}} {escape(unit)}") for words, column, unit in rows
    ]
    line = figure.renderers[-1] if len(rows) == 1 else figure.renderers[-2]
    figure.add_tools(
        HoverTool(
            tooltips=[("time", "@time{0,0.00} s"), *tips],
            mode="vline",
            renderers=[line],
            line_policy="nearest",
        )
    )
