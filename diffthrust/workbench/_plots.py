"""The plots of the log that is shown: sent as far as they are seen, brushed, and shaded."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
from bokeh.events import SelectionGeometry
from bokeh.models import BoxSelectTool, ColumnDataSource, Label, PanTool, WheelZoomTool

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


class Plots(RunPlots):
    """The plots of the log that is shown, linked in time: one for each channel of all logs."""

    def __init__(self, runs: Sequence[Run], on_select: Callable[[float, float], None]) -> None:
        pan, wheel = PanTool(dimensions="width"), WheelZoomTool(dimensions="width")
        select = BoxSelectTool(dimensions="width", description="Select a stretch")
        many = len({name for run in runs for name in run.channels}) > 2
        super().__init__(runs, _HEIGHTS[many], [pan, wheel, select], pan, wheel)
        self.on_select = on_select
        self.lit: Any = ColumnDataSource(data={"time": []})
        self.left_out, self.brushed = _strips(), _strips()
        self.failing = {name: _strips() for name in self.channels}
        self.colors = dict(zip(self.channels, cycle(FAILING), strict=False))
        for figure, (field, *_) in zip(self.figures, self.fields, strict=True):
            self._mark(figure, field)
        self.sizes = {k: self._size(f"residual{k}") for k in range(len(self.channels))}
        self._columns: dict[str, np.ndarray] = {}
        self._lit = np.zeros(0, bool)
        self._sent, self._span, self._asked = np.array([0, 1]), (0.0, 0.0), False
        self.x_range.on_change("start", self._on_range)
        self.x_range.on_change("end", self._on_range)

    def _mark(self, figure: Any, field: str) -> None:
        """Make room for what is left out, selected and lit, and for where the channel fails."""
        strips = [(self.left_out, LEFT_OUT, 0.3), (self.brushed, SELECTED, 0.2)]
        for k, (channel, failing) in enumerate(self.failing.items()):
            if field in (f"measured{k}", f"residual{k}"):
                strips.append((failing, self.colors[channel], 0.18))
                color = SELECTED if field.startswith("measured") else VERMILLION
                figure.scatter("time", field, source=self.lit, size=5, color=color)
        for source, color, alpha in strips:
            fill = {"fill_color": color, "fill_alpha": alpha, "line_color": None}
            figure.vstrip("x0", "x1", source=source, level="underlay", **fill)
        figure.on_event(SelectionGeometry, self._on_geometry)

    def _size(self, field: str) -> Any:
        """Room for how large a residual is, in its plot: scales change, and it looks as tall."""
        label: Any = Label(x=4, y=1, x_units="screen", y_units="screen", text_font_size="10px")
        label.background_fill_color, label.background_fill_alpha = "white", 0.7
        self.figures[self.fields.index((field,))].add_layout(label)
        return label

    # -- what is shown ---------------------------------------------------------------------------

    def show(self, run: Run, left_out: Stretches = ()) -> None:
        """Show a log from end to end."""
        self._columns = self.columns(run)
        self.left_out.data = _ends(left_out)
        self.shade({})
        self.light_up(np.zeros(run.time.size, bool))
        self.brush(None)
        duration = float(self._columns["time"][-1])
        self.x_range.update(start=0.0, end=duration, bounds=(-0.2 * duration, 1.2 * duration))
        self.x_range.reset_start, self.x_range.reset_end = 0.0, duration
        self._fit_heights(anew=True)
        self._show_sizes(run)
        self._send()

    def update(self, run: Run, *, rescaled: bool = True) -> None:
        """Show the same log as another model gives it: only what has changed is sent, at once.

        Under a slider scales are not ``rescaled`` to something smaller, or the eye loses them.
        """
        self._columns = self.columns(run)
        changed = [n for n in self._columns if n.startswith(("modelled", "residual"))]
        self.drawn.data.update({n: envelope(self._sent, self._columns[n]) for n in changed})
        if self._lit.any():  # a slider sends nothing more
            self.light_up(self._lit)
        self._fit_heights(anew=rescaled)
        self._show_sizes(run)

    def _show_sizes(self, run: Run) -> None:
        for k, name in enumerate(self.channels):
            error = run.errors.channels.get(name)
            size, unit = error.shown if error else (np.nan, "")
            words = f"measured - modelled, RMS {size:.3g} {unit}".rstrip()
            self.sizes[k].text = words if np.isfinite(size) else ""

    def _fit_heights(self, *, anew: bool) -> None:
        """Let all of a series be seen, with a scale of its own or the one that it has."""
        heights = self.heights(self._columns)
        for figure, (low, high) in zip(self.figures, heights, strict=True):
            ends = figure.y_range
            if anew or low < ends.start or high > ends.end:
                ends.update(start=low, end=high)

    def shade(self, failing: Mapping[str, Stretches]) -> None:
        """Shade where each channel fails."""
        for channel, source in self.failing.items():
            source.data = _ends(failing.get(channel, ()))

    def light_up(self, selected: np.ndarray) -> None:
        """Mark samples, by booleans over those of the log."""
        self._lit = selected
        at = np.flatnonzero(selected)
        at = at[:: max(1, -(-at.size // _LIT))]
        self.lit.data = {name: values[at] for name, values in self._columns.items()}

    def brush(self, stretch: tuple[float, float] | None) -> None:
        """Show which stretch is selected."""
        self.brushed.data = _ends([stretch] if stretch else [])

    def zoom(self, start: float, stop: float) -> None:
        """Show a stretch with a little around it."""
        margin = 0.25 * (stop - start) + 10 * float(np.median(np.diff(self._columns["time"])))
        self.x_range.update(start=start - margin, end=stop + margin)

    def marked(self, where: np.ndarray) -> Stretches:
        """Marked samples as stretches of the time that is shown."""
        time = self._columns["time"]
        return [(float(time[a]), float(time[b - 1])) for a, b in stretches(where)]

    def _send(self) -> None:
        """Send what is in sight, and as much on either side."""
        start, end = float(self.x_range.start), float(self.x_range.end)
        width = end - start
        self._span = (start - _BESIDE * width, end + _BESIDE * width)
        bins = int((1 + 2 * _BESIDE) * _BINS)
        self._sent = bins_of(self._columns["time"], *self._span, bins)
        self.draw(self._sent, self._columns)

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
        last = float(self._columns["time"][-1])
        if zoomed or (start - low < near and low > 0.0) or (high - end < near and high < last):
            self._send()

    def _on_geometry(self, event: SelectionGeometry) -> None:
        if (box := box_of(event)) is not None:
            self.on_select(*box[0])


def _strips() -> Any:
    return ColumnDataSource(data=_ends(()))


def _ends(pairs: Stretches) -> dict[str, list[float]]:
    return {"x0": [start for start, _ in pairs], "x1": [stop for _, stop in pairs]}
