"""The plots of the log that is shown: sent as far as they are seen, brushed, and shaded."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from bokeh.events import SelectionGeometry
from bokeh.models import BoxAnnotation, BoxSelectTool, ColumnDataSource, PanTool, WheelZoomTool

from diffthrust._support.envelope import bins_of, envelope, stretches
from diffthrust._support.figures import VERMILLION
from diffthrust.comparison._run_plots import RunPlots
from diffthrust.simulation._runs import Run
from diffthrust.workbench._look import FAILING, LEFT_OUT, SELECTED, box_of

_BINS = 450
"""Display: bins of what is in sight, each with a least and a greatest value. Without a GPU, a
browser drew 1 000 000 samples 1.3 times a second with 3 000 bins in all, and 4.3 times with 900."""
_BESIDE = 0.5
"""Display: widths of the picture that are sent on either side of it: a pan within them is drawn by
the browser alone."""
_LIT = 1500
"""Display: samples of a selection that light up; more would cover each other."""
_HEIGHTS = {True: (56, 84, 54), False: (60, 112, 62)}
"""Display: of an input, a channel and its residual [px], by whether there are over two channels: at
1 280 x 720 the staircase is above the lower edge."""
Stretches = Sequence[tuple[float, float]]


class Plots:
    """The plots of the log that is shown, linked in time.

    Args:
        runs: of all logs: their channels get a plot each.
        on_select: is told the stretch [s] that was drawn in the plots.
    """

    def __init__(self, runs: Sequence[Run], on_select: Callable[[float, float], None]) -> None:
        pan, wheel = PanTool(dimensions="width"), WheelZoomTool(dimensions="width")
        select = BoxSelectTool(dimensions="width", description="Select a stretch")
        many = len({name for run in runs for name in run.channels}) > 2
        self.plots = RunPlots(runs, _HEIGHTS[many], [pan, wheel, select], pan, wheel)
        self.layout, self.figures = self.plots.layout, self.plots.figures
        self.drawn, self.x_range = self.plots.drawn, self.plots.x_range
        self.on_select = on_select
        self.lit: Any = ColumnDataSource(data={"time": []})
        self.left_out: Any = _no_strips()
        self.failing = {name: _no_strips() for name in self.plots.channels}
        self.brushes: list[BoxAnnotation] = []
        for figure, fields in zip(self.figures, self.plots.fields, strict=True):
            self._mark(figure, fields)
        for k, source in enumerate(self.failing.values()):
            for figure in self._of_channel(k):
                _strip(figure, source, FAILING, 0.18)
        self.run: Run = runs[0]
        self._columns: dict[str, np.ndarray] = {}
        self._sent, self._span, self._asked = np.array([0, 1]), (0.0, 0.0), False
        self.x_range.on_change("start", self._on_range)
        self.x_range.on_change("end", self._on_range)

    def _of_channel(self, k: int) -> list[Any]:
        """The plots of a channel and of its residual."""
        pairs = zip(self.figures, self.plots.fields, strict=True)
        return [f for f, fields in pairs if fields[0] in (f"measured{k}", f"residual{k}")]

    def _mark(self, figure: Any, fields: tuple[str, ...]) -> None:
        """Make room for what is left out, selected and lit."""
        _strip(figure, self.left_out, LEFT_OUT, 0.3)
        brush = BoxAnnotation(fill_color=SELECTED, fill_alpha=0.2, line_color=None, visible=False)
        figure.add_layout(brush)
        self.brushes.append(brush)
        figure.on_event(SelectionGeometry, self._on_geometry)
        if not fields[0].startswith("input"):
            color = SELECTED if fields[0].startswith("measured") else VERMILLION
            figure.scatter("time", fields[0], source=self.lit, size=5, color=color)

    # -- what is shown ---------------------------------------------------------------------------

    def show(self, run: Run, left_out: Stretches = ()) -> None:
        """Show a log from end to end."""
        self.run, self._columns = run, self.plots.columns(run)
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
        self.run, self._columns = run, self.plots.columns(run)
        changed = [n for n in self._columns if n.startswith(("modelled", "residual"))]
        self.drawn.data.update({n: envelope(self._sent, self._columns[n]) for n in changed})
        if self._lit.any():  # a slider sends nothing more
            self.light_up(self._lit)
        self._fit_heights(anew=rescaled)

    def _fit_heights(self, *, anew: bool) -> None:
        """Let all of a series be seen, with a scale of its own or the one that it has."""
        heights = self.plots.heights(self._columns)
        for figure, (low, high) in zip(self.figures, heights, strict=True):
            ends = figure.y_range
            if anew or low < ends.start or high > ends.end:
                ends.update(start=low, end=high)

    def shade(self, failing: Mapping[str, Stretches]) -> None:
        """Shade where each channel fails."""
        for channel, source in self.failing.items():
            source.data = _strips(failing.get(channel, ()))

    def light_up(self, selected: np.ndarray) -> None:
        """Mark samples, by booleans over those of the log."""
        self._lit = selected
        at = np.flatnonzero(selected)
        at = at[:: max(1, -(-at.size // _LIT))]
        self.lit.data = {name: values[at] for name, values in self._columns.items()}

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

    def _send(self) -> None:
        """Send what is in sight, and as much on either side."""
        start, end = float(self.x_range.start), float(self.x_range.end)
        width = end - start
        self._span = (start - _BESIDE * width, end + _BESIDE * width)
        time, bins = self._columns["time"], int((1 + 2 * _BESIDE) * _BINS)
        self._sent = bins_of(time, *self._span, bins)
        self.plots.draw(self._sent, self._columns)

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


def _no_strips() -> Any:
    return ColumnDataSource(data=_strips(()))


def _strips(pairs: Stretches) -> dict[str, list[float]]:
    return {"x0": [pair[0] for pair in pairs], "x1": [pair[1] for pair in pairs]}


def _strip(figure: Any, source: Any, color: str, alpha: float) -> None:
    """Shade stretches behind all lines of a plot."""
    shade = {"fill_color": color, "fill_alpha": alpha, "line_color": None}
    figure.vstrip("x0", "x1", source=source, level="underlay", **shade)
