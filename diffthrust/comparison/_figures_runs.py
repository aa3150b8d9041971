"""A figure of runs: what was measured, what was modelled, and the difference."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from diffthrust._support.figures import BLUE, GREY, VERMILLION, literal, thinned
from diffthrust.models._base.model import Model
from diffthrust.simulation._runs import Run, Trace, are_tables

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS = 3


def comparison_figure(model: Model, runs: Sequence[Run]) -> Figure:
    """Measured and modelled on top, the residual below, for each channel of each run.

    One column for each run; after three runs a new block of rows begins. Long runs are thinned to
    the extremes of every stretch, so that no spike is lost.
    """
    from matplotlib.figure import Figure

    runs = [run for run in runs if run.channels]
    channels = list(dict.fromkeys(name for run in runs for name in run.channels))
    across = max(1, min(_COLUMNS, len(runs)))
    blocks = max(1, -(-len(runs) // across))
    tall = blocks * max(1, len(channels))
    figure = Figure(figsize=(1.6 + 5.6 * across, 1.0 + 3.1 * tall), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.08, h_pad=0.05)  # pyright: ignore
    grid = figure.add_gridspec(2 * tall, across, height_ratios=[3, 1.3] * tall)
    limits = {
        name: _common([run.channels[name] for run in runs if name in run.channels])
        for name in channels
    }
    for i, run in enumerate(runs):
        block, column = divmod(i, across)
        shared = None
        last = [name for name in channels if name in run.channels][-1]
        for j, name in enumerate(channels):
            if name not in run.channels:
                continue
            row = 2 * (block * len(channels) + j)
            top = figure.add_subplot(grid[row, column], sharex=shared)
            shared = shared or top
            below = figure.add_subplot(grid[row + 1, column], sharex=shared)
            static = are_tables(model, [run])
            _pair(top, below, run, name, static)
            below.set_ylim(-limits[name], limits[name])
            _label(top, below, name, run, column == 0, name == last, static)
    if figure.axes:
        handles = [*figure.axes[0].get_lines(), *figure.axes[1].get_lines()]
        figure.legend(
            handles=[line for line in handles if not str(line.get_label()).startswith("_")],
            title=textwrap.fill(str(model), 60),
            title_fontproperties={"weight": "bold", "size": 13},
            alignment="left",
            loc="outside upper left",
            ncols=3,
            frameon=False,
        )
    return figure


def _pair(top: Axes, below: Axes, run: Run, name: str, static: bool) -> None:
    trace = run.channels[name]
    measured: dict[str, Any] = {"color": GREY, "linewidth": 2.4}
    few = static or np.isfinite(trace.measured).sum() <= 150
    if few:
        measured |= {"marker": "o", "markersize": 5, "linestyle": "none"}
    t, y = thinned(run.time, trace.measured)
    top.plot(t, y, label="measured", **measured)
    t, y = thinned(run.time, trace.modelled)
    modelled: dict[str, Any] = {"color": VERMILLION, "linewidth": 1.1}
    if static:
        modelled |= {"marker": "x", "markersize": 5, "linestyle": "none"}
    top.plot(t, y, label="modelled", **modelled)
    t, y = thinned(run.time, trace.residual)
    residual: dict[str, Any] = {"color": BLUE, "linewidth": 0.8, "label": "measured - modelled"}
    if few:
        residual |= {"marker": "o", "markersize": 3, "linestyle": "none"}
    below.axhline(0.0, color="0.4", linewidth=0.8)
    below.plot(t, y, **residual)


def _label(
    top: Axes, below: Axes, name: str, run: Run, first: bool, last: bool, static: bool
) -> None:
    trace, error = run.channels[name], run.errors.channels.get(name)
    unit = f" [{trace.unit}]" if trace.unit else ""
    lines = [literal(run.name)] if name == next(iter(run.channels)) else []
    if error is not None:
        size = f"RMSE {error.rmse:.3g} {trace.unit}".rstrip()
        percent = f"{round(error.fit_percent, 1) + 0.0:.1f} %"
        lines.append(f"{name}: {size}, NRMSE {error.nrmse:.3g}, fit {percent}")
    top.set_title("\n".join(lines), loc="left", fontsize=9)
    for axes, label in ((top, f"{name}{unit}"), (below, f"residual{unit}")):
        if first:
            axes.set_ylabel(label, fontsize=9)
        axes.grid(True, color="0.9", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize=8)
        axes.margins(x=0.01)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    top.tick_params(labelbottom=False)
    if last:
        below.set_xlabel("sample" if static else "time [s]", fontsize=9)


def _common(traces: list[Trace]) -> float:
    """One limit for the residuals of a channel, so that runs can be compared by eye."""
    largest = 0.0
    for trace in traces:
        seen = np.abs(trace.residual[np.isfinite(trace.residual)])
        largest = max(largest, float(seen.max(initial=0.0)))
    return 1.1 * largest if 0 < largest < 1e300 else 1.0
