"""Figures of describing functions."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from diffthrust._support.figures import literal, styled
from diffthrust._support.words import percent
from diffthrust.describing._values import BandValues, DescribingValues
from diffthrust.uncertainty._prediction.figures import bracketed, logarithmic
from diffthrust.uncertainty._tables import evenly

_CURVES = 6
"""Curves in one panel."""
_FEW = 3
"""With fewer amplitudes or frequencies there are curves and no map."""


def map_figure(result: DescribingValues) -> Figure:
    """Gain and phase: maps with contours, or curves where there are few amplitudes."""
    result = result.shown
    gain = np.where(result.settled, result.gain, np.nan)
    # a gain of zero (within a dead band) has no logarithm: it is hatched
    gain = np.where(gain > 0, gain, np.nan)
    title = f"{result.model}: {result.input} to {result.output}, {result.method.replace('_', ' ')}"
    labels = bracketed("gain", result.gain_unit), "phase [deg]"
    if min(gain.shape) < _FEW:
        return _curves_figure(result, title, (gain, result.phase), labels)
    figure = _figure(11.0, 4.4, title)
    first_panel, second_panel = figure.subplots(1, 2)
    empty = "output does not move"
    _map(figure, first_panel, result, gain, labels[0], empty, by_ratio=True)
    _map(figure, second_panel, result, result.phase, labels[1], empty, by_ratio=False)
    return figure


def break_figure(result: DescribingValues) -> Figure:
    """The break frequency as a map, and over frequency for several amplitudes."""
    result = result.shown
    values = result.break_frequency
    label = "break frequency [rad/s]"
    title = f"{result.model}: break frequency, {result.method.replace('_', ' ')}"
    if min(values.shape) < _FEW:
        return _curves_figure(result, title, (values,), (label,))
    figure = _figure(11.0, 4.4, title)
    first_panel, second_panel = figure.subplots(1, 2)
    _map(figure, first_panel, result, values, label, "no such lag", by_ratio=True)
    _curves(second_panel, result, values, label)
    return figure


def band_figure(result: BandValues) -> Figure:
    """Gain and phase over frequency for some amplitudes: medians, with bands behind."""
    result = result.shown
    title = f"{result.model}: {result.input} to {result.output}, {percent(result.level)} band"
    figure = _figure(11.0, 4.2, title)
    rows = evenly(result.amplitudes.size, 4)
    parts = (result.gain, bracketed("gain", result.gain_unit)), (result.phase, "phase [deg]")
    for axes, (values, label) in zip(np.ravel(figure.subplots(1, 2)), parts, strict=True):
        for j, i in enumerate(rows):
            colour = colormaps["cividis"](0.85 * j / max(rows.size - 1, 1))
            median, low, high = values[:, i]
            axes.fill_between(result.frequencies, low, high, color=colour, alpha=0.3, linewidth=0)
            curve = f"{result.amplitudes[i]:.3g} {result.input_unit}".rstrip()
            axes.plot(result.frequencies, median, color=colour, linewidth=1.2, label=curve)
        _scales(axes, result, values[:, rows], label)
    return figure


def _figure(width: float, height: float, title: str) -> Figure:
    figure = Figure(figsize=(width, height), layout="constrained")
    figure.suptitle(literal(title), fontsize=11, fontweight="bold", x=0.01, ha="left")
    return figure


def _curves_figure(result: DescribingValues, title: str, parts: Any, labels: Any) -> Figure:
    figure = _figure(5.6 * len(parts), 4.0, title)
    panels = np.ravel(figure.subplots(1, len(parts)))
    for axes, values, label in zip(panels, parts, labels, strict=True):
        _curves(axes, result, values, label)
    return figure


def _map(
    figure: Figure, axes: Axes, result: DescribingValues, values: np.ndarray, label: str,
    empty: str, *, by_ratio: bool,
) -> None:  # fmt: skip
    finite = values[np.isfinite(values)]
    x, y = result.frequencies, result.amplitudes
    unit = bracketed(f"amplitude of the {result.input}", result.input_unit)
    styled(axes, literal(label), "frequency [rad/s]", unit)
    axes.grid(False)
    for axis, grid in ((axes.xaxis, x), (axes.yaxis, y)):  # before the labels of contours are set
        logarithmic(axes, axis, grid[-1] / grid[0])
    _hatched(axes, result, values, empty)
    if finite.size:
        low, high = float(finite.min()), float(finite.max())
        levels = _levels(low, high, by_ratio)
        norm = LogNorm(levels[0], levels[-1]) if by_ratio else Normalize(levels[0], levels[-1])
        shown = np.ma.masked_invalid(values)
        # cividis reads the same with every kind of colour vision, and in grey
        mesh = axes.pcolormesh(_edges(x), _edges(y), shown, norm=norm, cmap="cividis")
        inner = [v for v in levels if low < v < high]
        if inner and min(shown.shape) >= 2:
            lines = axes.contour(x, y, shown, levels=inner, colors="white", linewidths=0.8)
            axes.clabel(lines, fmt=lambda v: f"{v:g}", fontsize=7)
        bar = figure.colorbar(mesh, ax=axes, ticks=levels, format=lambda v, _: f"{v:g}")
        bar.ax.minorticks_off()
        bar.ax.tick_params(labelsize=8)


def _hatched(axes: Axes, result: DescribingValues, values: np.ndarray, empty: str) -> None:
    """Points without an answer, and those where the output does not move or does not lag."""
    handles = []
    silent = result.settled & ~np.isfinite(values)
    for where, hatch, words in ((~result.settled, "xxxx", "not settled"), (silent, "....", empty)):
        if where.any():
            axes.pcolor(
                _edges(result.frequencies), _edges(result.amplitudes),
                np.ma.masked_where(~where, where * 1.0), hatch=hatch, facecolor="0.92",
                edgecolor="0.55", linewidth=0,
                cmap="Greys_r", vmin=0, vmax=1,
            )  # fmt: skip
            handles.append(Patch(facecolor="0.95", edgecolor="0.55", hatch=hatch, label=words))
    if handles:
        axes.legend(handles=handles, fontsize=8, loc="lower right")


def _edges(grid: np.ndarray) -> np.ndarray:
    """Borders of cells about the points, half way between them in the logarithm."""
    inner = np.sqrt(grid[:-1] * grid[1:])
    return np.concatenate([[grid[0] ** 2 / inner[0]], inner, [grid[-1] ** 2 / inner[-1]]])


def _curves(axes: Axes, result: DescribingValues, values: np.ndarray, label: str) -> None:
    rows = evenly(result.amplitudes.size, _CURVES)
    static = result.static_gain
    for j, i in enumerate(rows):
        colour = colormaps["cividis"](0.9 * j / max(rows.size - 1, 1))
        curve = f"{result.amplitudes[i]:.3g} {result.input_unit}".rstrip()
        if np.isfinite(static[i]) and result.output_unit:
            curve += f" (static {static[i] * result.amplitudes[i]:.3g} {result.output_unit})"
        dots: dict[str, Any] = {"marker": "o", "markersize": 3} if values.shape[1] <= 20 else {}
        axes.plot(result.frequencies, values[i], color=colour, linewidth=1.4, label=curve, **dots)
    _scales(axes, result, values[rows], label)


def _scales(axes: Axes, result: DescribingValues | BandValues, values: Any, label: str) -> None:
    """Labels, scales and legend of curves over the frequency."""
    styled(axes, literal(label), "frequency [rad/s]", literal(label))
    w = result.frequencies
    logarithmic(axes, axes.xaxis, w[-1] / w[0])
    finite = values[np.isfinite(values)]
    if "phase" not in label and finite.size and finite.min() > 0:
        logarithmic(axes, axes.yaxis, float(finite.max() / finite.min()))
    axes.legend(fontsize=7, frameon=False, title=f"amplitude of the {literal(result.input)}",
                title_fontsize=8)  # fmt: skip


def _levels(low: float, high: float, by_ratio: bool) -> np.ndarray:
    """Round values that reach from the lowest to the highest."""
    if not by_ratio:
        if high - low < 1e-9 * max(abs(low), abs(high), 1e-9):
            return np.array([low - 1.0, high + 1.0])
        return np.asarray(MaxNLocator(9, steps=[1, 1.5, 2, 3, 5, 10]).tick_values(low, high))
    if high < 1.5 * low:
        ticks = np.asarray(MaxNLocator(8).tick_values(low, max(high, low * 1.001)))
        return ticks[ticks > 0]
    tens = np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    parts = (1.0, 2.0, 5.0) if high / low < 2000 else (1.0,)
    all_of = np.sort(np.ravel(10.0 ** tens[:, None] * np.array(parts)))
    first = max(int(np.searchsorted(all_of, low, "right")) - 1, 0)
    last = min(int(np.searchsorted(all_of, high)), all_of.size - 1)
    return all_of[first : last + 1] if last > first else all_of[:2]
