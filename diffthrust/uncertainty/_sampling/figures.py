"""Figures of posteriors: corner and traces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from diffthrust._support.errors import InputError
from diffthrust._support.figures import BLUE, VERMILLION, literal, showing, styled, thinned
from diffthrust._support.names import listing
from diffthrust._support.words import percent
from diffthrust.estimation._result import Fit
from diffthrust.logs._written import Size
from diffthrust.uncertainty._prediction.draws import posterior_data
from diffthrust.uncertainty._prediction.figures import bracketed
from diffthrust.uncertainty._prediction.tables import interval_text
from diffthrust.uncertainty._sampling.arviz import shown_in

_LEVEL = 0.95
_REGIONS = (0.5, 0.95)
"""The contours of two parameters hold these shares of the draws."""
_BINS = 32
_REACH = 1.0
"""Most lengths of its own by which an axis is stretched to show a value that is marked."""
# Okabe & Ito 2008, besides those of the other figures
_MARKS = ("#000000", "#009E73", "#CC79A7", "#E69F00")


@showing
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
        >>> marks = {"published": {"ct": 0.019}}
        >>> dft.uncertainty.plot_corner(post, fit, marks).savefig("corner.png")
    """
    draws, sizes = _shown(post, names)
    units = {n: size.unit for n, size in sizes.items()}
    sets = _marked(marks, draws)
    if fit is not None:
        values = {n: fit.parameters[n].value for n in draws if n in fit.parameters}
        sets = {"fit": values, **sets}
    sets = {label: {n: sizes[n].value * v for n, v in s.items()} for label, s in sets.items()}
    looks = _looks(sets)
    count = len(draws)
    figure = Figure(figsize=(max(5.4, 2.3 * count), max(3.6, 2.2 * count)), layout="constrained")
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
    handles: list[Any] = [
        Line2D([], [], color=BLUE, linewidth=1.2, label="median"),
        Patch(color=BLUE, alpha=0.2, linewidth=0, label=f"{percent(_LEVEL)} interval"),
        *(Line2D([], [], label=literal(label), **looks[label]) for label in sets),
    ]
    if count > 1:
        regions = f"{' and '.join(map(percent, _REGIONS))} of the draws"
        handles.append(Line2D([], [], color=BLUE, linewidth=0.9, label=regions))
    where = "upper right" if count > 1 else "outside right upper"
    figure.legend(handles=handles, loc=where, frameon=False, fontsize=9)
    return figure


@showing
def plot_trace(post: Any, *, names: Sequence[str] | None = None) -> Figure:
    """Every parameter along its chains, beside the distributions of their first and second halves.

    The halves of a chain that has converged lie on one another, and no chain stands apart.

    Args:
        post: what `sample` gives.
        names: the parameters to show; by default those of the model, not of the noise.

    Raises:
        InputError: an empty posterior, or a parameter that it does not have.

    Example:
        >>> dft.uncertainty.plot_trace(post, names=["alpha"]).savefig("trace.png")
    """
    draws, sizes = _shown(post, names)
    units = {n: size.unit for n, size in sizes.items()}
    figure = Figure(figsize=(9.0, 0.7 + 1.75 * len(draws)), layout="constrained")
    grid = figure.add_gridspec(len(draws), 2, width_ratios=[4, 1])
    for row, (name, values) in enumerate(draws.items()):
        trace = figure.add_subplot(grid[row, 0])
        density = figure.add_subplot(grid[row, 1], sharey=trace)
        few = values.shape[0] <= 8
        for i, chain in enumerate(values):
            colour = (BLUE, VERMILLION, *_MARKS[1:], "0.4", "#56B4E9")[i % 7] if few else BLUE
            index, kept = thinned(np.arange(chain.size, dtype=float), chain)
            trace.plot(index, kept, color=colour, linewidth=0.5, alpha=0.6 if few else 0.25)
        half = values.shape[1] // 2
        edges = np.histogram_bin_edges(values, _BINS).tolist()
        for chosen, colour, label in (
            (values[:, :half], BLUE, "first half"),
            (values[:, half:], VERMILLION, "second half"),
        ):
            if chosen.size:
                density.hist(chosen.ravel(), edges, density=True, histtype="step", color=colour,
                           orientation="horizontal", label=label)  # fmt: skip
        last = row == len(draws) - 1
        styled(trace, "", "draw" if last else "", _label(name, units))
        styled(density, "", "density" if last else "", "")
        density.tick_params(labelleft=False, labelbottom=False)
        _plain_ticks(trace, "y", values)
        if row == 0:
            chains = f"{values.shape[0]} chain{'s' if values.shape[0] > 1 else ''}"
            trace.set_title(f"{chains} of {values.shape[1]} draws", loc="left", fontsize=9)
            density.legend(fontsize=7, frameon=False, loc="upper right")
    return figure


def _shown(post: Any, names: Sequence[str] | None) -> tuple[dict[str, np.ndarray], dict[str, Size]]:
    """Draws ``(chain, draw)`` of the parameters to show, in the units for people, and these."""
    posterior = posterior_data(post)
    scalars = [str(n) for n, v in posterior.data_vars.items() if set(v.dims) == {"chain", "draw"}]
    chosen = list(names) if names else [n for n in scalars if not n.startswith("noise.")]
    unknown = [n for n in chosen if n not in scalars]
    if unknown or not chosen:
        raise InputError(
            f"The posterior has no parameter {listing(unknown)}; it has {listing(scalars)}.",
            "Correct the names.",
        )
    sizes = {n: shown_in(posterior[n]) for n in chosen}
    draws = {
        n: sizes[n].value * np.asarray(posterior[n].transpose("chain", "draw").values, float)
        for n in chosen
    }
    return draws, sizes


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
    labels = [label for label in sets if label != "fit"]
    looks: dict[str, dict[str, Any]] = {
        label: {"color": _MARKS[i % len(_MARKS)], "linestyle": ":", "linewidth": 1.6}
        for i, label in enumerate(labels)
    }
    return {"fit": {"color": VERMILLION, "linestyle": "--", "linewidth": 1.3}, **looks}


def _limits(values: np.ndarray, marked: Sequence[float]) -> tuple[float, float]:
    """The range of nearly all draws, stretched to marks that are not far."""
    low, high = np.quantile(values, [0.0005, 0.9995])
    width = float(high - low) or abs(float(low)) or 1.0
    near = [m for m in marked if low - _REACH * width <= m <= high + _REACH * width]
    low, high = min([low, *near]), max([high, *near])
    return float(low - 0.06 * width), float(high + 0.06 * width)


def _histogram(axes: Axes, name: str, values: np.ndarray, unit: str) -> None:
    flat = values.ravel()
    low, median, high = np.quantile(flat, [0.5 * (1 - _LEVEL), 0.5, 0.5 * (1 + _LEVEL)])
    # bins as fine over the draws however far a mark stretches the axis
    axes.hist(flat, _BINS, range=tuple(np.quantile(flat, [0.0005, 0.9995])), density=True,
              histtype="stepfilled", color=BLUE, alpha=0.35)  # fmt: skip
    axes.axvspan(low, high, color=BLUE, alpha=0.12, linewidth=0)
    axes.axvline(median, color=BLUE, linewidth=1.2)
    ends = interval_text(float(median), float(low), float(high))
    shown = _label(name, {name: unit})
    axes.set_title(f"{shown}\n{ends[0]}\n{ends[1]} to {ends[2]}", loc="left")


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
        below = value < low
        text = f"← {label} {value:.4g}" if below else f"{label} {value:.4g} →"
        axes.text(0.03 if below else 0.97, 0.95 - 0.12 * far, literal(text), fontsize=8,
                  transform=axes.transAxes, ha="left" if below else "right", va="top",
                  color=looks[label]["color"])  # fmt: skip
        far += 1
    if far:  # room above the histogram
        axes.set_ylim(0.0, (1.05 + 0.2 * far) * axes.get_ylim()[1])


def _crossings(
    axes: Axes, x: str, y: str, sets: Mapping[str, Any], looks: Mapping[str, Any]
) -> None:
    (low, high), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    for label, values in sets.items():
        if x in values and low <= values[x] <= high:
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
    counts, across, up = np.histogram2d(x, y, _BINS, range=ranges)
    smooth = gaussian_filter(counts, 1.2)
    ordered = np.sort(smooth.ravel())[::-1]
    held = np.cumsum(ordered) / ordered.sum()
    # highest density regions: from the fullest bins down until they hold the share
    levels = sorted({float(ordered[np.searchsorted(held, share)]) for share in _REGIONS})
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
    """Few ticks, each to be read as it is: no offset to add in one's head."""
    axis = axes.xaxis if side == "x" else axes.yaxis
    axis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    width, size = float(np.ptp(values)), float(np.max(np.abs(values)))
    if not width > 0:
        return
    places = max(0, -int(np.floor(np.log10(width / 4))))
    digits = max(2, int(np.ceil(np.log10(size / width))) + 2)
    plain = places <= 7 and 1e-3 <= size < 1e6
    kind = f".{places}f" if plain else f".{min(digits, 10)}g"
    axis.set_major_formatter(lambda value, _: f"{value:{kind}}")


def _label(name: str, units: Mapping[str, str]) -> str:
    """Name and unit; that of an effect's parameter in two lines."""
    return bracketed(name.replace(".", ".\n"), units[name])
