"""The signal path drawn: boxes of ports where effects act, arrows between them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from bokeh.models import Arrow, ColumnDataSource, Range1d, TapTool, VeeHead
from bokeh.plotting import figure

from diffthrust._support.figures import BLUE
from diffthrust.workbench._look import RIGHT
from diffthrust.workbench._signal_path import SignalPath

_FILL = {"input": "#e8f5f0", "port": "#ffffff", "state": "#f0f0f0", "output": "#f0f0f0"}
_CHOSEN, _WITH = "#cfe6f5", "#ffe7c2"


class PathFigure:
    """The drawing of a signal path; a box with effects can be chosen.

    Args:
        path: what is drawn.
        choices: names of the boxes that have effects.
        on_choose: is told the name of the box that was tapped.
    """

    def __init__(
        self, path: SignalPath, choices: list[str], on_choose: Callable[[str], None]
    ) -> None:
        self.nodes, self.choices, self.on_choose = path.nodes, set(choices), on_choose
        places = {node.name: (node.column, -node.row) for node in self.nodes}
        columns = max(node.column for node in self.nodes)
        rows = max(node.row for node in self.nodes)
        self.source: Any = ColumnDataSource(
            data={
                "name": [node.name for node in self.nodes],
                "label": [node.name.replace("_", "\n") for node in self.nodes],
                "x": [places[node.name][0] for node in self.nodes],
                "y": [places[node.name][1] for node in self.nodes],
                "fill": [_FILL[node.kind] for node in self.nodes],
                "line": [BLUE if node.name in self.choices else "#aaa" for node in self.nodes],
                "width": [1.0] * len(self.nodes),
            }
        )
        self.figure = self._drawn(columns, rows)
        for begin, end in path.edges:
            self.figure.add_layout(_arrow(places[begin], places[end]))
        self.source.selected.on_change("indices", self._on_tap)

    def _drawn(self, columns: float, rows: float) -> Any:
        tap = TapTool()
        drawn: Any = figure(
            width=RIGHT - 10,
            height=int(70 + 58 * rows),
            x_range=Range1d(start=-0.55, end=columns + 0.55),
            y_range=Range1d(start=-rows - 0.6, end=0.6),
            tools=[tap],
            toolbar_location=None,
            min_border=0,
        )
        drawn.axis.visible = False
        drawn.grid.visible = False
        drawn.outline_line_color = None
        boxes = drawn.rect(
            "x",
            "y",
            width=0.84,
            height=0.62,
            source=self.source,
            fill_color="fill",
            line_color="line",
            line_width="width",
            border_radius=4,
        )
        boxes.nonselection_glyph = boxes.selection_glyph = None
        size = "9px" if columns > 4.5 else "10px"  # "propeller" has 45 px where there are six
        drawn.text(
            "x",
            "y",
            text="label",
            source=self.source,
            text_align="center",
            text_baseline="middle",
            text_font_size=size,
            text_line_height=0.95,
        ).level = "overlay"
        return drawn

    def mark(self, chosen: str, added: Mapping[str, int]) -> None:
        """Mark the box that is chosen, and those with effects.

        Args:
            chosen: its name.
            added: how many effects of the model act at each box.
        """
        fills, widths = [], []
        for node in self.nodes:
            fill = _WITH if added.get(node.name) else _FILL[node.kind]
            fills.append(_CHOSEN if node.name == chosen and not added.get(node.name) else fill)
            widths.append(2.5 if node.name == chosen else 1.0)
        self.source.data["fill"] = fills
        self.source.data["width"] = widths

    def _on_tap(self, attr: str, old: list[int], new: list[int]) -> None:
        if new:
            name = self.nodes[new[0]].name
            self.source.selected.indices = []
            if name in self.choices:
                self.on_choose(name)


def _arrow(begin: tuple[float, float], end: tuple[float, float]) -> Arrow:
    """An arrow from the edge of a box to that of another."""
    (x0, y0), (x1, y1) = begin, end
    half = np.array([0.42, 0.31])
    step = np.array([x1 - x0, y1 - y0])
    reach = float(np.min(half / np.maximum(np.abs(step), 1e-9)))
    a, b = np.array(begin) + reach * step, np.array(end) - reach * step
    arrow: Any = Arrow
    return arrow(
        x_start=a[0],
        y_start=a[1],
        x_end=b[0],
        y_end=b[1],
        line_color="#888",
        end=VeeHead(size=6, fill_color="#888", line_color="#888"),
    )
