"""A figure of runs: what was measured, what was modelled, and the difference."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from diffthrust._support.figures import BLUE, GREY, VERMILLION, is_sparse, literal, thinned, unboxed
from diffthrust.models._base.model import Model
from diffthrust.simulation._record import are_tables
from diffthrust.simulation._runs import Run, Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS = 3
_COLOURS, _STYLES = ("0.15", VERMILLION, BLUE), ("-", "--", ":")
_DRIVES = [(_COLOURS[k % 3], _STYLES[(k + k // 3) % 3]) for k in range(9)]
"""Of inputs in one plot: no two alike among the commands of a craft with eight thrusters."""
_LINES = ("measured", "modelled", "measured - modelled")


def comparison_figure(model: Model, runs: Sequence[Run]) -> Figure:
    """What drove each run on top; below, for each channel, measured, modelled and the residual.

    One column for each run; after three runs a new block of rows begins. Long runs are thinned to
    the extremes of every stretch, so that no spike is lost.
    """
    from matplotlib.figure import Figure

    runs = [run for run in runs if run.channels]
    channels = list(dict.fromkeys(name for run in runs for name in run.channels))
    across = max(1, min(_COLUMNS, len(runs)))
    blocks = max(1, -(-len(runs) // across))
    drives = drives_of(model, runs)
    heights = [1.3] * len(drives) + [3, 1.3] * max(1, len(channels))
    size = (1.6 + 5.6 * across, 1.0 + 0.72 * blocks * sum(heights))
    figure = Figure(figsize=size, layout="constrained")
    figure.get_layout_engine().set(w_pad=0.08, h_pad=0.05)  # pyright: ignore
    grid = figure.add_gridspec(blocks * len(heights), across, height_ratios=heights * blocks)
    limits = {
        name: _common([run.shown_channels[name] for run in runs if name in run.channels])
        for name in channels
    }
    for i, run in enumerate(runs):
        block, column = divmod(i, across)
        shared = None
        last = [name for name in channels if name in run.channels][-1]
        above = block * len(heights)
        static = are_tables([run.record])
        for j, names in enumerate(drives):
            driven = figure.add_subplot(grid[above + j, column], sharex=shared)
            shared = shared or driven
            draw_drive(driven, run, names, column == 0, static)
            if j == 0:
                driven.set_title(literal(run.name), loc="left", fontsize=9)
        for j, name in enumerate(channels):
            if name not in run.channels:
                continue
            row = above + len(drives) + 2 * j
            top = figure.add_subplot(grid[row, column], sharex=shared)
            shared = shared or top
            below = figure.add_subplot(grid[row + 1, column], sharex=shared)
            _pair(top, below, run, name, static)
            below.set_ylim(-limits[name], limits[name])
            _label(top, below, name, run, column == 0, name == last, static)
            if not drives and name == next(iter(run.channels)):
                words = f"{literal(run.name)}\n{top.get_title('left')}"
                top.set_title(words, loc="left", fontsize=9)
    handles = [line for axes in figure.axes for line in axes.get_lines()]
    legend = {str(line.get_label()): line for line in handles if line.get_label() in _LINES}
    if legend:
        figure.legend(
            handles=[legend[word] for word in _LINES if word in legend],
            title=textwrap.fill(str(model), 60),
            title_fontproperties={"weight": "bold", "size": 13},
            alignment="left",
            loc="outside upper left",
            ncols=3,
            frameon=False,
        )
    return figure


def drives_of(model: Model, runs: Sequence[Run]) -> list[list[str]]:
    """The inputs that drove the runs, those of one unit together."""
    groups: dict[str, list[str]] = {}
    for name, unit in model.inputs.items():
        shown = [run.shown.unit(name, unit) for run in runs if name in run.log.inputs]
        if shown:
            groups.setdefault(shown[0], []).append(name)
    return list(groups.values())


def draw_drive(axes: Axes, run: Run, names: Sequence[str], first: bool, static: bool) -> None:
    """The inputs of a run, as they were written; a held one is drawn in steps."""
    names = [name for name in names if name in run.log.inputs]
    for name, (colour, style) in zip(names, cycle(_DRIVES), strict=False):
        values = run.shown.values(name, run.signals[name], run.units[name])
        held = run.log.hold[name] == "zero" and not static
        axes.plot(
            *thinned(run.time, values),
            color=colour,
            linestyle="none" if static else style,
            marker="." if static else "",
            linewidth=1.0,
            drawstyle="steps-post" if held else "default",
            label=f"_{name}",
        )
    unit = run.shown.unit(names[0], run.units[names[0]]) if names else ""
    what, labels = _drive_words(names)
    if first:
        axes.set_ylabel(what + (f"\n[{unit}]" if unit else ""), fontsize=8)
    if len(names) > 1:
        place: dict[str, Any] = {"loc": "upper right", "ncols": 3}
        if len(names) > 3:  # above, where it covers no line
            place = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.98), "handlelength": 1.4}
            place["ncols"] = min(len(names), 8)
        axes.legend(axes.get_lines(), labels, fontsize=7, frameon=False, **place)
    unboxed(axes)
    axes.tick_params(labelbottom=False)


def _drive_words(names: Sequence[str]) -> tuple[str, list[str]]:
    """What stands at the axis of some inputs, and each one's name: "command" of t1, t2, ..."""
    parts = {name.rpartition(".")[2] for name in names}
    owners = [name.rpartition(".")[0] for name in names]
    if len(names) > 1 and len(parts) == 1 and all(owners):
        return parts.pop(), owners
    return " / ".join(names), list(names)


def _pair(top: Axes, below: Axes, run: Run, name: str, static: bool) -> None:
    trace = run.shown_channels[name]
    few = static or np.isfinite(trace.measured).sum() <= 150 or is_sparse(trace.measured)
    grey: dict[str, Any] = {"color": GREY, "linewidth": 2.4, "markersize": 5, "label": "measured"}
    red: dict[str, Any] = {
        "color": VERMILLION,
        "linewidth": 1.1,
        "markersize": 5,
        "label": "modelled",
    }
    blue: dict[str, Any] = {
        "color": BLUE,
        "linewidth": 0.8,
        "markersize": 3,
        "label": "measured - modelled",
    }
    below.axhline(0.0, color="0.4", linewidth=0.8)
    for axes, values, style, dots in (
        (top, trace.measured, grey, "o" if few else ""),
        (top, trace.modelled, red, "x" if static else ""),
        (below, trace.residual, blue, "o" if few else ""),
    ):
        marks: dict[str, Any] = {"marker": dots, "linestyle": "none"} if dots else {}
        axes.plot(*thinned(run.time, values), **style, **marks)


def _label(
    top: Axes, below: Axes, name: str, run: Run, first: bool, last: bool, static: bool
) -> None:
    trace, error = run.shown_channels[name], run.errors.channels.get(name)
    unit = f" [{trace.unit}]" if trace.unit else ""
    if error is not None:
        size = f"RMSE {error.shown.value:.3g} {error.shown.unit}".rstrip()
        percent = f"{round(error.fit_percent, 1) + 0.0:.1f} %"
        words = f"{name}: {size}, NRMSE {error.nrmse:.3g}, fit {percent}"
        top.set_title(words, loc="left", fontsize=9)
    for axes, label in ((top, f"{name}{unit}"), (below, f"residual{unit}")):
        if first:
            axes.set_ylabel(label, fontsize=9)
        unboxed(axes)
    top.tick_params(labelbottom=False)
    if last:
        below.set_xlabel("sample" if static else "time [s]", fontsize=9)


def _common(traces: list[Trace]) -> float:
    """One limit for the residuals of a channel, so that runs can be compared by eye."""
    largest = 0.0
    for trace in traces:
        sizes = np.abs(trace.residual[np.isfinite(trace.residual)])
        largest = max(largest, float(sizes.max(initial=0.0)))
    return 1.1 * largest if 0 < largest < 1e300 else 1.0
