"""Figures of a fleet: spread, drift, effects, and what pooling does."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.figures import BLUE, COLOURS, VERMILLION, literal, styled
from diffthrust._support.words import humanize
from diffthrust.many._fleet.entries import Axis
from diffthrust.many._fleet.statistics import (
    Estimates,
    between,
    trend,
    vehicle_means,
    weighted_mean,
)
from diffthrust.uncertainty._prediction.figures import bracketed

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_ACROSS = 3
_SIGMAS = NormalDist().inv_cdf(0.975)
"""Standard errors in half a 95 % interval."""
_MARKS = "osD^v"


def spread_figure(fleet: Estimates, outliers: Any) -> Figure:
    """Each vehicle's 95 % interval; behind it the mean of the fleet and its spread."""
    far = set(outliers[outliers["outlier"]][["vehicle", "parameter"]].itertuples(index=False))
    means = {name: vehicle_means(fleet, name) for name in fleet.axes}
    shared = [axis for name, axis in fleet.axes.items() if len(means[name].vehicles) > 1]
    if not shared:
        raise InputError("No parameter has estimates of two vehicles.", "There is no spread.")
    figure, panels = _panels(shared, 0.9 + 0.24 * len(fleet.vehicles))
    for axes, axis in zip(panels, shared, strict=True):
        each = means[axis.name]
        place = {name: i for i, name in enumerate(fleet.vehicles)}
        sd = between(each.values, each.errors)
        mean = weighted_mean(each.values, np.hypot(each.errors, sd)).value
        _law(axes, axis, mean, sd)
        for is_far, look in (
            (False, {"color": BLUE, "fmt": "o", "label": "vehicle, 95 % interval"}),
            (True, {"color": VERMILLION, "fmt": "D", "label": "outlier"}),
        ):
            some = [i for i, v in enumerate(each.vehicles) if ((v, axis.name) in far) == is_far]
            if some:
                at, half = each.values[some], _SIGMAS * each.errors[some]
                rows = [place[each.vehicles[i]] for i in some]
                _bars(axes, axis, at - half, at, at + half, rows, **look)
        _rows(axes, axis, fleet.vehicles)
    _legend(figure, "Spread between vehicles")
    return figure


def drift_figure(fleet: Estimates, drift: pd.DataFrame) -> Figure:
    """Each fit over time; vehicles that drift in colour, with their straight lines."""
    if drift.empty:
        raise InputError("No vehicle has fits at two times.", "There is no drift to show.")
    drifts = drift[drift["drifts"]]
    drifting = list(dict.fromkeys(drifts["vehicle"]))
    colours = COLOURS[1:]  # blue is for means elsewhere on these figures
    colour = {v: colours[i % len(colours)] for i, v in enumerate(drifting)}
    mark = {v: _MARKS[i % len(_MARKS)] for i, v in enumerate(drifting)}
    parameters = [fleet.axes[name] for name in dict.fromkeys(drift["parameter"])]
    figure, panels = _panels(parameters, 3.2)
    for axes, axis in zip(panels, parameters, strict=True):
        here = set(drifts[drifts["parameter"] == axis.name]["vehicle"])
        for vehicle in drift[drift["parameter"] == axis.name]["vehicle"]:
            times, values, errors = fleet.series(vehicle, axis.name)
            order = np.argsort(times)
            times, values, errors = times[order], values[order], errors[order]
            moves = vehicle in here
            half = _SIGMAS * errors
            axes.errorbar(
                times,
                axis.value(values),
                yerr=_arms(axis, values - half, values, values + half),
                fmt=mark[vehicle] if moves else "o",
                color=colour[vehicle] if moves else "0.65",
                markersize=5 if moves else 3,
                linewidth=1.0,
                zorder=3 if moves else 1,
                linestyle="none" if moves else "-",
                label=f"{literal(vehicle)} drifts" if moves else "other vehicles",
            )
            line = trend(times, values, errors) if moves else None
            if line:
                at = np.linspace(times[0], times[-1], 50)
                track = axis.value(line.level + line.slope * (at - line.middle))
                axes.plot(at, track, color=colour[vehicle], linewidth=1.4, zorder=2)
        time = "days since the first fit" if fleet.time_unit == "day" else "time as given"
        styled(axes, literal(axis.name), time, bracketed(axis.name, axis.unit))
    _legend(figure, "Drift within vehicles (95 % intervals)")
    return figure


def effects_figure(table: Any) -> Figure:
    """The share of each vehicle's fits that have an effect."""
    from matplotlib.figure import Figure

    names = [name for name in table.columns if name != "fits"]
    if not names:
        raise InputError("No fit of the fleet has an effect.", "There is nothing to show.")
    share = table[names].to_numpy()
    size = (2.6 + 1.1 * len(names), 2.0 + 0.3 * len(table))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.add_subplot()
    axes.pcolormesh(share, cmap="Blues", vmin=0.0, vmax=1.0, edgecolors="white", linewidth=1.5)
    for row, vehicle in enumerate(table.index):
        for column in range(len(names)):
            count = round(share[row, column] * table.loc[vehicle, "fits"])
            if count:
                shade = "white" if share[row, column] > 0.55 else "0.1"
                axes.text(column + 0.5, row + 0.5, f"{count} of {table.loc[vehicle, 'fits']}",
                          ha="center", va="center", color=shade, fontsize=8)  # fmt: skip
    words = [humanize(name).replace(" ", "\n") for name in names]
    axes.set_xticks(np.arange(len(names)) + 0.5, words, fontsize=8)
    axes.set_yticks(np.arange(len(table)) + 0.5, [literal(v) for v in table.index], fontsize=8)
    axes.invert_yaxis()
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)
    axes.set_title("Fits with an effect, by vehicle", loc="left", fontsize=11, weight="bold")
    return figure


def pooled_figure(
    fleet: Estimates, parameters: Sequence[Axis], posterior: Any, pooled: Any, level: float
) -> Figure:
    """Each vehicle by itself and pooled; behind it the median of the fleet and its spread."""
    vehicles = [str(vehicle) for vehicle in posterior["vehicle"].values]
    share = f"{100 * level:g} %"
    width = NormalDist().inv_cdf(0.5 + level / 2)
    figure, panels = _panels(list(parameters), 0.9 + 0.34 * len(vehicles))
    for axes, axis in zip(panels, parameters, strict=True):
        alone = vehicle_means(fleet, axis.name)
        middle = float(np.median(axis.coordinate(posterior[f"{axis.name}.mean"].values)))
        _law(axes, axis, middle, float(np.median(posterior[f"{axis.name}.between"].values)))
        table: Any = pooled[pooled["parameter"] == axis.name]
        low, at, high = (axis.coordinate(table[c].to_numpy()) for c in ("low", "median", "high"))
        rows = np.array([vehicles.index(v) for v in table["vehicle"]])
        half = width * alone.errors
        mine = np.array([vehicles.index(v) for v in alone.vehicles]) - 0.17
        look: dict[str, Any] = {"color": VERMILLION, "mfc": "white", "zorder": 2}
        _bars(axes, axis, alone.values - half, alone.values, alone.values + half, mine, fmt="o",
              label=f"by itself, {share}", **look)  # fmt: skip
        _bars(axes, axis, low, at, high, rows + 0.17, fmt="s", color=BLUE, zorder=3,
              label=f"pooled, {share}")  # fmt: skip
        ends = np.concatenate([low, high])
        # The axis follows the pooled intervals: the separate one of a vehicle with poor logs may
        # be orders of magnitude wider.
        margin = 0.6 * np.ptp(ends)
        axes.set_xlim(*axis.value(np.array([ends.min() - margin, ends.max() + margin])))
        _rows(axes, axis, vehicles)
    _legend(figure, "Separate fits and pooled")
    return figure


def _panels(parameters: list[Axis], height: float) -> tuple[Figure, list[Axes]]:
    from matplotlib.figure import Figure

    across = min(_ACROSS, len(parameters))
    down = -(-len(parameters) // across)
    size = (1.2 + 3.6 * across, 0.6 + height * down)
    figure = Figure(figsize=size, layout="constrained")
    return figure, [figure.add_subplot(down, across, i + 1) for i in range(len(parameters))]


def _law(axes: Axes, axis: Axis, mean: float, sd: float) -> None:
    low, middle, high = axis.value(np.array([mean - sd, mean, mean + sd]))
    axes.axvspan(low, high, color="0.9", label="fleet, one standard deviation", zorder=0)
    axes.axvline(middle, color="0.45", linewidth=1.0, label="fleet", zorder=1)


def _bars(axes: Axes, axis: Axis, low: Any, at: Any, high: Any, rows: Any, **look: Any) -> None:
    """Horizontal intervals given in coordinates."""
    arms = _arms(axis, low, at, high)
    axes.errorbar(axis.value(at), rows, xerr=arms, markersize=4.5, linewidth=1.2, **look)


def _arms(axis: Axis, low: Any, at: Any, high: Any) -> np.ndarray:
    return np.abs(np.stack([axis.value(low), axis.value(high)]) - axis.value(at))


def _rows(axes: Axes, axis: Axis, vehicles: Any) -> None:
    styled(axes, literal(axis.name), bracketed(axis.name, axis.unit), "")
    axes.set_yticks(np.arange(len(vehicles)), [literal(v) for v in vehicles])
    axes.set_ylim(len(vehicles) - 0.4, -0.6)
    axes.margins(x=0.04)
    axes.locator_params(axis="x", nbins=5)


def _legend(figure: Figure, title: str) -> None:
    handles = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(
        handles=list(handles.values()),
        labels=list(handles),
        title=title,
        title_fontproperties={"weight": "bold", "size": 12},
        alignment="left",
        loc="outside upper left",
        ncols=4,
        frameon=False,
        fontsize=9,
    )
