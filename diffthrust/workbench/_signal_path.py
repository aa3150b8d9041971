"""The signal path of a model, from its own equations, and its drawing.

The equations are evaluated at one point, and again with each signal and each port a little off:
whatever changes depends on it. So a model of the user's own is drawn like the library's.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Mapping
from typing import Any, NamedTuple, cast

import numpy as np
from bokeh.models import Arrow, ColumnDataSource, Range1d, TapTool, VeeHead
from bokeh.plotting import figure

from diffthrust._support.figures import BLUE
from diffthrust.models._base.effect import Reading
from diffthrust.models._base.model import Model
from diffthrust.models._base.signals import Signals
from diffthrust.simulation._integrate import plain_rate
from diffthrust.workbench._look import RIGHT

_OFF = 1e-3
"""Numerics: by how much a signal is off; a dependence weaker than a billionth of that is none."""
_FILL = {"input": "#e8f5f0", "port": "#ffffff", "state": "#f0f0f0", "output": "#f0f0f0"}
_CHOSEN, _WITH = "#cfe6f5", "#ffe7c2"
_BOX = (0.84, 0.62)
"""Display: width and height of a box, of the way to the next."""

Edge = tuple[str, str]


class Node(NamedTuple):
    """A signal of the path, with its place from left to right and from top to bottom.

    Its kind is "input", "port", "state" or "output"; a state that is measured is a state.
    """

    name: str
    kind: str
    column: float
    row: float


class SignalPath(NamedTuple):
    """Nodes with their places, feedback below, and arrows between them."""

    nodes: tuple[Node, ...]
    edges: tuple[Edge, ...]


def signal_path(model: Model) -> SignalPath:
    """The signal path of a model without its effects.

    Example:
        >>> path = signal_path(dft.SpeedLoopThruster())
        >>> ("target", "loop") in path.edges, ("speed", "loop") in path.edges
        (True, True)
    """
    model = model._copy(effects=())
    edges = _edges(model)
    linked = {name for edge in edges for name in edge}
    kinds = dict.fromkeys(model.inputs, "input") | dict.fromkeys(model.ports, "port")
    kinds |= dict.fromkeys(model.states, "state")
    kinds |= {name: "output" for name in model.outputs if name not in kinds}
    names = [name for name in kinds if name in linked or kinds[name] in ("input", "port")]
    places = _places(names, edges, kinds)
    return SignalPath(tuple(Node(n, kinds[n], *places[n]) for n in names), tuple(edges))


def _edges(model: Model) -> list[Edge]:
    """From each signal to what depends on it at once, not by way of another port."""
    names = [*model.inputs, *model.states]
    point = {name: 0.6 + 0.17 * index for index, name in enumerate(names)}
    point = dict.fromkeys(model.optional_inputs, 0.5) | {"time": 0.0} | point
    plain = _evaluated(model, point, "")

    def reached(signal: str, port: str) -> set[str]:
        values = {**point, signal: point[signal] + _OFF} if signal else point
        moved = _evaluated(model, values, port).items()
        return {n for n, v in moved if abs(v - plain[n]) > 1e-9 * _OFF} - {signal or port}

    ports = set(model.ports)
    ends = {n: reached(n, "") for n in names} | {port: reached("", port) for port in model.ports}
    return [
        (name, end)
        for name in ends
        for end in ends[name]
        if not any(end in ends[via] for via in ends[name] & ports - {end})
    ]


def _evaluated(model: Model, point: Mapping[str, float], off: str) -> dict[str, float]:
    """What arrives at each port, the rate of each state, and each output that is no state."""
    signals = Signals(point)
    ports = Reading((), signals, {off: _OFF})
    rates, outputs = model.equations(signals, ports)
    values = {n: v for n, v in outputs.items() if n not in model.states}
    values |= {name: plain_rate(rate) for name, rate in rates.items()}
    return {name: float(value) for name, value in {**values, **ports.seen}.items()}


def _places(
    names: Collection[str], edges: Collection[Edge], kinds: Mapping[str, str]
) -> dict[str, tuple[float, float]]:
    """By name column and row: from the inputs to the right, ports that lead back below."""
    depth = {name: 0 for name in names if kinds[name] == "input"}
    queue = deque(depth)
    while queue:
        name = queue.popleft()
        for begin, end in edges:
            if begin == name and end not in depth:
                depth[end] = depth[name] + 1
                queue.append(end)
    depth |= {name: 1 for name in names if name not in depth}
    into, out = {end: begin for begin, end in edges}, dict(edges)
    rows: dict[float, list[str]] = {}
    for name in names:
        column = float(depth[name])
        if kinds[name] == "port" and name in into and name in out:
            begin, end = depth[into[name]], depth[out[name]]
            column = 0.5 * (begin + end) if end < depth[name] else column
        rows.setdefault(column, []).append(name)
    places = {}
    for column, beside in rows.items():
        taken = [len(rows.get(float(c), ())) for c in (int(column), int(column) + 1)]
        below = max(taken) if column != int(column) else 0
        places |= {name: (column, float(below + index)) for index, name in enumerate(beside)}
    return places


class PathFigure:
    """The drawing of a signal path; of the boxes in ``choices`` one can be chosen by a tap."""

    def __init__(
        self, path: SignalPath, choices: Collection[str], on_choose: Callable[[str], None]
    ) -> None:
        self.nodes, self.choices, self.on_choose = path.nodes, choices, on_choose
        names = [node.name for node in path.nodes]
        self.source: Any = ColumnDataSource(
            data={
                "label": [name.replace("_", "\n") for name in names],
                "x": [node.column for node in path.nodes],
                "y": [-node.row for node in path.nodes],
                "fill": [_FILL[node.kind] for node in path.nodes],
                "line": [BLUE if name in choices else "#aaa" for name in names],
                "width": [1.0] * len(names),
            }
        )
        columns = max(node.column for node in path.nodes)
        rows = max(node.row for node in path.nodes)
        self.figure: Any = figure(
            width=RIGHT - 10,
            height=int(70 + 58 * rows),
            x_range=Range1d(start=-0.55, end=columns + 0.55),
            y_range=Range1d(start=-rows - 0.6, end=0.6),
            tools=[TapTool()],
            toolbar_location=None,
            min_border=0,
        )
        self.figure.axis.visible = self.figure.grid.visible = False
        self.figure.outline_line_color = None
        self._draw_boxes("9px" if columns > 4.5 else "10px")  # "propeller" has 45 px of six
        places = {node.name: np.array([node.column, -node.row]) for node in path.nodes}
        for begin, end in path.edges:
            self.figure.add_layout(_arrow(places[begin], places[end]))
        self.source.selected.on_change("indices", self._on_tap)

    def _draw_boxes(self, size: str) -> None:
        colors = {"fill_color": "fill", "line_color": "line", "line_width": "width"}
        shape = {"width": _BOX[0], "height": _BOX[1], "border_radius": 4}
        boxes = self.figure.rect("x", "y", source=self.source, **shape, **colors)
        boxes.nonselection_glyph = boxes.selection_glyph = None
        middle = {"text_align": "center", "text_baseline": "middle", "text_line_height": 0.95}
        words = {"text": "label", "text_font_size": size, **middle}
        self.figure.text("x", "y", source=self.source, **words).level = "overlay"

    def mark(self, chosen: str, added: Collection[str]) -> None:
        """Mark the box that is chosen, and those at which effects of the model act."""
        fills = []
        for node in self.nodes:
            fill = _CHOSEN if node.name == chosen else _FILL[node.kind]
            fills.append(_WITH if node.name in added else fill)
        self.source.data["fill"] = fills
        self.source.data["width"] = [2.5 if node.name == chosen else 1.0 for node in self.nodes]

    def _on_tap(self, attr: str, old: list[int], new: list[int]) -> None:
        if new:
            name = self.nodes[new[0]].name
            self.source.selected.indices = []
            if name in self.choices:
                self.on_choose(name)


def _arrow(begin: np.ndarray, end: np.ndarray) -> Any:
    """An arrow from the edge of a box to that of another."""
    step = end - begin
    reach = float(np.min(0.5 * np.array(_BOX) / np.maximum(np.abs(step), 1e-9)))
    (x0, y0), (x1, y1) = begin + reach * step, end - reach * step
    head = VeeHead(size=6, fill_color="#888", line_color="#888")
    arrow = cast(Any, Arrow)
    return arrow(x_start=x0, y_start=y0, x_end=x1, y_end=y1, line_color="#888", end=head)
