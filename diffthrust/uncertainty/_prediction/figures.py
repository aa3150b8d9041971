"""Figures of predictive bands and of derived curves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from diffthrust._support.errors import InputError
from diffthrust._support.figures import BLUE, VERMILLION, literal, styled, thinned
from diffthrust._support.names import listing
from diffthrust._support.words import percent
from diffthrust.uncertainty._prediction.band import Band, DerivedQuantity


def prediction_figure(
    log: str, time: np.ndarray, channels: Mapping[str, Band], level: float, random_forces: bool
) -> Figure:
    """Measured points, median and bands; below, the same with the median taken off."""
    count = len(channels)
    noise = f"start{', random forces' if random_forces else ''} and noise"
    figure = Figure(figsize=(9.0, 1.2 + 3.6 * count), layout="constrained")
    panels = figure.subplots(2 * count, 1, sharex=True, height_ratios=[3, 2] * count)
    labels = f"{percent(level)}: parameters, {noise}", f"{percent(level)}: parameters and start"
    for i, (name, band) in enumerate((n, band.shown) for n, band in channels.items()):
        top, below = panels[2 * i], panels[2 * i + 1]
        share = percent(band.coverage)
        unit = f" [{band.unit}]" if band.unit else ""
        title = f"{name}: {share} of {band.samples} samples inside the {percent(level)}"
        _banded(top, time, band, np.zeros_like(band.median), labels)
        _banded(below, time, band, band.median, labels)
        styled(top, f"{literal(title)} band", "", literal(f"{name}{unit}"))
        styled(below, "", "time [s]" if i == count - 1 else "", literal(f"minus median{unit}"))
    figure.legend(
        *figure.axes[0].get_legend_handles_labels(),
        title=literal(log),
        title_fontproperties={"weight": "bold", "size": 12},
        alignment="left",
        loc="outside upper left",
        ncols=3,
        frameon=False,
        fontsize=9,
    )
    return figure


def curves_figure(quantities: Mapping[str, DerivedQuantity], level: float) -> Figure:
    """Derived curves with their bands, one panel each."""
    curves = [q.shown for q in quantities.values() if q.grid is not None and q.grid.size > 1]
    if not curves:
        raise InputError(
            f"None of the quantities is a curve: {listing(quantities)}.",
            "Ask for commands, steps or amplitudes of several values.",
        )
    across = min(3, len(curves))
    tall = -(-len(curves) // across)
    figure = Figure(figsize=(0.6 + 4.2 * across, 0.4 + 3.4 * tall), layout="constrained")
    for i, curve in enumerate(curves, 1):
        axes = figure.add_subplot(tall, across, i)
        _curve(axes, curve, level)
        axes.legend(fontsize=8, frameon=False)
    return figure


def _curve(axes: Axes, q: DerivedQuantity, level: float) -> None:
    assert q.grid is not None
    order = np.argsort(q.grid)
    x = q.grid[order]
    parts = [np.where(np.isfinite(v), v, np.nan)[order] for v in (q.low, q.median, q.high)]
    low, median, high = parts
    with np.errstate(invalid="ignore"):
        thin = np.nanmax(high - low) < 0.01 * np.nanmax(np.abs(high))
    words = f"{percent(level)} band{', narrower than the line' if thin else ''}"
    axes.fill_between(x, low, high, color=BLUE, alpha=0.3, linewidth=0, label=words)
    dots: dict[str, Any] = {"marker": "o", "markersize": 3} if x.size <= 20 else {}
    axes.plot(x, median, color=BLUE, linewidth=1.2, label="median", **dots)
    with np.errstate(invalid="ignore"):
        positive = bool(x[0] > 0 and np.nanmin(low) > 0)
    label = q.name.replace("_", " ")
    styled(axes, literal(label), bracketed(q.grid_name, q.grid_unit), bracketed(label, q.unit))
    if positive and x[-1] >= 8 * x[0]:
        logarithmic(axes, axes.xaxis, x[-1] / x[0])
        logarithmic(axes, axes.yaxis, np.nanmax(high) / np.nanmin(low))
        axes.margins(x=0.03)


def logarithmic(axes: Axes, axis: Any, span: float) -> None:
    """A logarithmic axis with plain numbers, for values of so large a ratio."""
    if span <= 1.0:
        return
    (axes.set_xscale if axis is axes.xaxis else axes.set_yscale)("log")
    dense = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0) if span < 10 else (1.0, 2.0, 5.0)
    axis.set_major_locator(LogLocator(10, dense if span < 1000 else (1.0,)))
    axis.set_major_formatter(lambda value, _: f"{value:g}")
    axis.set_minor_formatter(NullFormatter())


def _banded(
    axes: Axes, time: np.ndarray, band: Band, off: np.ndarray, labels: tuple[str, str]
) -> None:
    some = slice(None, None, max(1, time.size // 4000))
    for low, high, label, colour, alpha in (
        (band.noisy_low, band.noisy_high, labels[0], BLUE, 0.22),
        (band.low, band.high, labels[1], VERMILLION, 0.55),
    ):
        ends = (low - off)[some], (high - off)[some]
        axes.fill_between(time[some], *ends, linewidth=0, label=label, color=colour, alpha=alpha)
    axes.plot(time[some], (band.median - off)[some], color=VERMILLION, linewidth=0.9,
              label="median")  # fmt: skip
    outside = (band.measured < band.noisy_low) | (band.measured > band.noisy_high)
    size = 3.0 if np.isfinite(band.measured).sum() <= 400 else 1.4
    for where, colour, mark, label in (
        (~outside, "0.35", ".", "measured, inside"),
        (outside, "#000000", "x", "measured, outside"),
    ):
        at, values = thinned(time, np.where(where, band.measured - off, np.nan))
        axes.plot(at, values, mark, color=colour, markersize=size, label=label,
                  markeredgewidth=0.7)  # fmt: skip


def bracketed(name: str, unit: str) -> str:
    """A label with its unit."""
    return literal(f"{name} [{unit}]" if unit else name)
