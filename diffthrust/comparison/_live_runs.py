"""Runs on a page of a report: their plots, with a choice of log and model, in one file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from bokeh.events import DoubleTap
from bokeh.layouts import column, row
from bokeh.models import BoxZoomTool, ColumnDataSource, CustomJS, PanTool, WheelZoomTool

from diffthrust._support.envelope import bins_of, envelope, envelopes
from diffthrust._support.live import Live
from diffthrust._support.plots import Staircase
from diffthrust.comparison._run_plots import RunPlots
from diffthrust.simulation._record import are_tables
from diffthrust.simulation._runs import Run

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
    args = {
        "logs": logs,
        "models": models,
        "heights": heights,
        "durations": durations,
        "figures": plots.figures,
        "driven": plots.driven,
    }
    words = f"Drawn by the least and the greatest of each {most} samples." if most > 1 else ""
    return CustomJS(args=args, code=_CHOOSE), words
