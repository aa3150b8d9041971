"""Figures of posteriors, predictive bands and derived curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from diffthrust._channels import listing
from diffthrust._errors import InputError
from diffthrust._phrases import percent
from diffthrust._plots import BLUE, VERMILLION, literal, styled, thinned
from diffthrust._posterior_draws import posterior_of
from diffthrust._posterior_tables import interval_text
from diffthrust._result import Fit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from diffthrust._predict import Band, Prediction
    from diffthrust._quantities import DerivedQuantity, Quantities

LEVEL = 0.95
REGIONS = (0.5, 0.95)
"""The contours of two parameters hold these shares of the draws."""
BINS = 40
REACH = 1.0
"""An axis is stretched by at most so many of its lengths to show a value that is marked."""
# Okabe & Ito 2008, besides those of the other figures
_MARKS = ("#000000", "#009E73", "#CC79A7", "#E69F00")


def plot_corner(
    post: Any,
    fit: Fit | None = None,
    marks: Mapping[str, Any] | None = None,
    *,
    names: Sequence[str] | None = None,
) -> Figure:
    """Every parameter and every pair of them: histograms with the 95 % interval, and contours.

    Args:
        post: what `sample` gives.
        fit: a fit, whose estimate is shown by a dashed line.
        marks: other values to show, by label and parameter, such as
            ``{"published": {"alpha": 0.037}}``; of one set of values the label may be left out. A
            value far from the draws is named with an arrow.
        names: the parameters to show; by default those of the model, not of the noise.

    Raises:
        InputError: an empty posterior, or a parameter that it does not have.

    Example:
        >>> dft.plot_corner(post, fit, {"published": {"ct": 0.019}}).savefig("corner.png")
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    draws, units = _shown(post, names)
    sets = _marked(marks, draws)
    if fit is not None:
        values = {n: fit.parameters[n].value for n in draws if n in fit.parameters}
        sets = {"fit": values, **sets}
    looks = _looks(sets)
    count = len(draws)
    figure = Figure(figsize=(max(4.2, 2.3 * count), max(3.6, 2.2 * count)), layout="constrained")
    grid = figure.add_gridspec(count, count)
    limits = {n: _limits(v, [s[n] for s in sets.values() if n in s]) for n, v in draws.items()}
    for row, below in enumerate(draws):
        for column, across in enumerate(list(draws)[: row + 1]):
            axes = figure.add_subplot(grid[row, column])
            axes.set_xlim(limits[across])
            if row == column:
                _histogram(axes, across, draws[across], units[across])
                _lines(axes, across, sets, looks)
            else:
                axes.set_ylim(limits[below])
                _pair(axes, draws[across], draws[below])
                _crossings(axes, across, below, sets, looks)
            _corner_labels(axes, row, column, count, _label(across, units), _label(below, units))
    handles = [Line2D([], [], label=literal(label), **looks[label]) for label in sets]
    if handles and count > 1:
        figure.legend(handles=handles, loc="upper right", frameon=False, fontsize=10)
    elif handles:
        figure.axes[0].legend(handles=handles, frameon=False, fontsize=8)
    return figure


def plot_trace(post: Any, *, names: Sequence[str] | None = None) -> Figure:
    """Every parameter along its chains, beside the distributions of their first and second halves.

    The halves of a chain that has converged lie on one another, and no chain stands apart.

    Args:
        post: what `sample` gives.
        names: the parameters to show; by default those of the model, not of the noise.

    Raises:
        InputError: an empty posterior, or a parameter that it does not have.
    """
    from matplotlib.figure import Figure

    draws, units = _shown(post, names)
    figure = Figure(figsize=(9.0, 0.7 + 1.75 * len(draws)), layout="constrained")
    grid = figure.add_gridspec(len(draws), 2, width_ratios=[4, 1])
    for row, (name, values) in enumerate(draws.items()):
        left = figure.add_subplot(grid[row, 0])
        right = figure.add_subplot(grid[row, 1], sharey=left)
        few = values.shape[0] <= 8
        for i, chain in enumerate(values):
            colour = (BLUE, VERMILLION, *_MARKS[1:], "0.4", "#56B4E9")[i % 7] if few else BLUE
            index, kept = thinned(np.arange(chain.size, dtype=float), chain)
            left.plot(index, kept, color=colour, linewidth=0.5, alpha=0.6 if few else 0.25)
        half = values.shape[1] // 2
        edges = np.histogram_bin_edges(values, BINS)
        for part, colour, label in (
            (values[:, :half], BLUE, "first half"),
            (values[:, half:], VERMILLION, "second half"),
        ):
            if part.size:
                right.hist(part.ravel(), edges, density=True, histtype="step", color=colour,
                           orientation="horizontal", label=label)  # fmt: skip
        last = row == len(draws) - 1
        styled(left, "", "draw" if last else "", _label(name, units))
        styled(right, "", "density" if last else "", "")
        right.tick_params(labelleft=False, labelbottom=False)
        _plain_ticks(left, "y", values)
        if row == 0:
            chains = f"{values.shape[0]} chain{'s' if values.shape[0] > 1 else ''}"
            left.set_title(f"{chains} of {values.shape[1]} draws", loc="left", fontsize=9)
            right.legend(fontsize=7, frameon=False, loc="upper right")
    return figure


def prediction_figure(prediction: Prediction) -> Figure:
    """Measured points, median and bands; below, the same with the median taken off."""
    from matplotlib.figure import Figure

    count = len(prediction.channels)
    figure = Figure(figsize=(9.0, 1.2 + 3.6 * count), layout="constrained")
    grid = figure.add_gridspec(2 * count, 1, height_ratios=[3, 2] * count)
    shared = None
    for i, (name, band) in enumerate(prediction.channels.items()):
        top = figure.add_subplot(grid[2 * i], sharex=shared)
        shared = shared or top
        below = figure.add_subplot(grid[2 * i + 1], sharex=shared)
        share = percent(band.coverage)
        unit = f" [{band.unit}]" if band.unit else ""
        title = f"{name}: {share} of {band.samples} samples inside the {percent(prediction.level)}"
        _banded(top, prediction, band, np.zeros_like(band.median))
        _banded(below, prediction, band, band.median)
        styled(top, f"{literal(title)} band", "", literal(f"{name}{unit}"))
        last = i == count - 1
        styled(below, "", "time [s]" if last else "", literal(f"minus median{unit}"))
        top.tick_params(labelbottom=False)
        below.tick_params(labelbottom=last)
    figure.legend(
        *figure.axes[0].get_legend_handles_labels(),
        title=literal(prediction.log),
        title_fontproperties={"weight": "bold", "size": 12},
        alignment="left",
        loc="outside upper left",
        ncols=3,
        frameon=False,
        fontsize=9,
    )
    return figure


def curves_figure(found: Quantities) -> Figure:
    """Derived curves with their bands, one panel each.

    Raises:
        InputError: there is no curve.
    """
    from matplotlib.figure import Figure

    curves = [q for q in found.values() if q.grid is not None and q.grid.size > 1]
    if not curves:
        raise InputError(
            f"None of the quantities is a curve: {listing(found)}.",
            "Ask for commands, steps or amplitudes of several values.",
        )
    across = min(3, len(curves))
    tall = -(-len(curves) // across)
    figure = Figure(figsize=(0.6 + 4.2 * across, 0.4 + 3.4 * tall), layout="constrained")
    for i, curve in enumerate(curves):
        axes = figure.add_subplot(tall, across, i + 1)
        _curve(axes, curve, found.level)
        if i == 0:
            axes.legend(fontsize=8, frameon=False)
    return figure


def _curve(axes: Axes, q: DerivedQuantity, level: float) -> None:
    assert q.grid is not None
    order = np.argsort(q.grid)
    x = q.grid[order]
    parts = [np.where(np.isfinite(v), v, np.nan)[order] for v in (q.low, q.median, q.high)]
    low, median, high = parts
    axes.fill_between(x, low, high, color=BLUE, alpha=0.3, linewidth=0, label=f"{percent(level)}")
    dots: dict[str, Any] = {"marker": "o", "markersize": 3} if x.size <= 20 else {}
    axes.plot(x, median, color=BLUE, linewidth=1.2, label="median", **dots)
    with np.errstate(invalid="ignore"):
        positive = bool(x[0] > 0 and np.nanmin(low) > 0)
    label = q.name.replace("_", " ")
    styled(axes, literal(label), _bracketed(q.grid_name, q.grid_unit), _bracketed(label, q.unit))
    if positive and x[-1] >= 8 * x[0]:
        from matplotlib.ticker import LogLocator, NullFormatter

        axes.set_xscale("log")
        axes.set_yscale("log")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(LogLocator(10, (1.0, 2.0, 5.0)))
            axis.set_major_formatter(lambda value, _: f"{value:g}")
            axis.set_minor_formatter(NullFormatter())
        axes.margins(x=0.03)


def _banded(axes: Axes, prediction: Prediction, band: Band, off: np.ndarray) -> None:
    time = prediction.time
    step = max(1, time.size // 4000)
    t = time[::step]
    share = percent(prediction.level)

    def filled(low: np.ndarray, high: np.ndarray, label: str, **look: Any) -> None:
        ends = (low - off)[::step], (high - off)[::step]
        axes.fill_between(t, *ends, linewidth=0, label=label, **look)

    noisy = "parameters, random forces and noise" if prediction.random_forces else (
        "parameters and noise")  # fmt: skip
    filled(band.noisy_low, band.noisy_high, f"{share}: {noisy}", color=BLUE, alpha=0.22)
    filled(band.low, band.high, f"{share}: parameters", color=VERMILLION, alpha=0.55)
    axes.plot(t, (band.median - off)[::step], color=VERMILLION, linewidth=0.9, label="median")
    outside = (band.measured < band.noisy_low) | (band.measured > band.noisy_high)
    few = np.isfinite(band.measured).sum() <= 400
    size = 3.0 if few else 1.4
    for where, colour, label in (
        (~outside, "0.35", "measured, inside"),
        (outside, "#000000", "measured, outside"),
    ):
        rest = np.where(where, band.measured - off, np.nan)
        at, values = thinned(time, rest)
        axes.plot(at, values, color=colour, linestyle="none", markersize=size, label=label,
                  marker="." if colour != "#000000" else "x", markeredgewidth=0.7)  # fmt: skip


def _shown(post: Any, names: Sequence[str] | None) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Draws ``(chain, draw)`` and unit of the parameters to show."""
    posterior = posterior_of(post)
    scalars = [str(n) for n, v in posterior.data_vars.items() if set(v.dims) == {"chain", "draw"}]
    chosen = list(names) if names else [n for n in scalars if not n.startswith("noise.")]
    unknown = [n for n in chosen if n not in scalars]
    if unknown or not chosen:
        raise InputError(
            f"The posterior has no parameter {listing(unknown)}; it has {listing(scalars)}.",
            "Correct the names.",
        )
    draws = {n: np.asarray(posterior[n].transpose("chain", "draw").values, float) for n in chosen}
    return draws, {n: str(posterior[n].attrs.get("unit", "")) for n in chosen}


def _marked(marks: Any, draws: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    if not marks:
        return {}
    sets = marks if all(isinstance(v, Mapping) for v in marks.values()) else {"marked": marks}
    unknown = [n for values in sets.values() for n in values if n not in draws]
    if unknown:
        raise InputError(
            f"marks: there is no parameter {listing(unknown)} in the figure, but {listing(draws)}.",
            "Correct the names.",
        )
    return {str(label): {n: float(v) for n, v in s.items()} for label, s in sets.items()}


def _looks(sets: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    others = [label for label in sets if label != "fit"]
    looks: dict[str, dict[str, Any]] = {
        label: {"color": _MARKS[i % len(_MARKS)], "linestyle": ":", "linewidth": 1.6}
        for i, label in enumerate(others)
    }
    return {"fit": {"color": VERMILLION, "linestyle": "--", "linewidth": 1.3}, **looks}


def _limits(values: np.ndarray, marked: Sequence[float]) -> tuple[float, float]:
    """The range of nearly all draws, stretched to marks that are not far."""
    low, high = np.quantile(values, [0.0005, 0.9995])
    width = float(high - low) or abs(float(low)) or 1.0
    near = [m for m in marked if low - REACH * width <= m <= high + REACH * width]
    low, high = min([low, *near]), max([high, *near])
    return float(low - 0.06 * width), float(high + 0.06 * width)


def _histogram(axes: Axes, name: str, values: np.ndarray, unit: str) -> None:
    flat = values.ravel()
    low, median, high = np.quantile(flat, [0.5 * (1 - LEVEL), 0.5, 0.5 * (1 + LEVEL)])
    # bins as fine over the draws however far a mark stretches the axis
    axes.hist(flat, BINS, range=tuple(np.quantile(flat, [0.0005, 0.9995])), density=True,
              histtype="stepfilled", color=BLUE, alpha=0.35)  # fmt: skip
    axes.axvspan(low, high, color=BLUE, alpha=0.12, linewidth=0)
    axes.axvline(median, color=BLUE, linewidth=1.2)
    told = interval_text(float(median), float(low), float(high))
    shown = literal(name) + (f" [{unit}]" if unit else "")
    interval = f"{told[0]}  ({told[1]} to {told[2]})"
    axes.set_title(f"{shown}\n{interval}", fontsize=8, loc="left")


def _lines(axes: Axes, name: str, sets: Mapping[str, Any], looks: Mapping[str, Any]) -> None:
    low, high = axes.get_xlim()
    far = 0
    for label, values in sets.items():
        if name not in values:
            continue
        value = values[name]
        if low <= value <= high:
            axes.axvline(value, **looks[label])
            continue
        left = value < low
        text = f"← {label} {value:.4g}" if left else f"{label} {value:.4g} →"
        axes.text(0.03 if left else 0.97, 0.95 - 0.12 * far, literal(text), fontsize=8,
                  transform=axes.transAxes, ha="left" if left else "right", va="top",
                  color=looks[label]["color"])  # fmt: skip
        far += 1


def _crossings(
    axes: Axes, x: str, y: str, sets: Mapping[str, Any], looks: Mapping[str, Any]
) -> None:
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    for label, values in sets.items():
        if x in values and left <= values[x] <= right:
            axes.axvline(values[x], **looks[label])
        if y in values and bottom <= values[y] <= top:
            axes.axhline(values[y], **looks[label])


def _pair(axes: Axes, x: np.ndarray, y: np.ndarray) -> None:
    """Points, and contours of the smallest regions that hold given shares of the draws."""
    from scipy.ndimage import gaussian_filter

    x, y = x.ravel(), y.ravel()
    some = slice(None, None, max(1, x.size // 1500))
    axes.plot(x[some], y[some], ".", color=BLUE, markersize=1.5, alpha=0.25, rasterized=True)
    if x.size < 200 or not (np.ptp(x) > 0 and np.ptp(y) > 0):
        return
    ranges = [tuple(np.quantile(v, [0.0005, 0.9995]) + np.ptp(v) * np.array([-0.05, 0.05]))
              for v in (x, y)]  # fmt: skip
    counts, across, up = np.histogram2d(x, y, BINS, range=ranges)
    smooth = gaussian_filter(counts, 1.2)
    ordered = np.sort(smooth.ravel())[::-1]
    held = np.cumsum(ordered) / ordered.sum()
    levels = sorted({float(ordered[np.searchsorted(held, share)]) for share in REGIONS})
    middle = [0.5 * (edges[1:] + edges[:-1]) for edges in (across, up)]
    axes.contour(
        *middle, smooth.T, levels=levels, colors=BLUE, linewidths=[0.9, 1.4][-len(levels) :]
    )


def _corner_labels(axes: Axes, row: int, column: int, count: int, across: str, below: str) -> None:
    styled(axes, axes.get_title(loc="left"), "", "")
    axes.title.set_fontsize(8)
    _plain_ticks(axes, "x", np.array(axes.get_xlim()))
    if row == column:
        axes.tick_params(left=False, labelleft=False)
        axes.grid(False)
    else:
        _plain_ticks(axes, "y", np.array(axes.get_ylim()))
    axes.tick_params(axis="x", labelbottom=row == count - 1, labelrotation=35, labelsize=8)
    axes.tick_params(axis="y", labelleft=column == 0 and row > 0, labelsize=8)
    if row == count - 1:
        axes.set_xlabel(across, fontsize=9)
    if column == 0 and row > 0:
        axes.set_ylabel(below, fontsize=9)


def _plain_ticks(axes: Axes, side: str, values: np.ndarray) -> None:
    """Few ticks, each a whole number to read: no offset to add in one's head."""
    from matplotlib.ticker import MaxNLocator

    axis = axes.xaxis if side == "x" else axes.yaxis
    axis.set_major_locator(MaxNLocator(4))
    width, size = float(np.ptp(values)), float(np.max(np.abs(values)))
    digits = 3 if not width > 0 else max(3, int(np.ceil(np.log10(size / width))) + 2)
    axis.set_major_formatter(lambda value, _: f"{value:.{min(digits, 10)}g}")


def _label(name: str, units: Mapping[str, str]) -> str:
    return _bracketed(name, units[name])


def _bracketed(name: str, unit: str) -> str:
    return literal(f"{name} [{unit}]" if unit else name)
