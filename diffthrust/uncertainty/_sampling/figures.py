"""Figures of posteriors: corner and traces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any, NamedTuple

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
from diffthrust.uncertainty._prediction.draws import posterior_data, scalars_of
from diffthrust.uncertainty._prediction.figures import bracketed
from diffthrust.uncertainty._sampling.arviz import shown_in
from diffthrust.uncertainty._tables import interval_text
from diffthrust.uncertainty._values import central

_LEVEL = 0.95
_REGIONS = (0.5, 0.95)
"""The contours of two parameters hold these shares of the draws."""
_BINS = 32
_NEARLY_ALL = (0.0005, 0.9995)
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
    labels = _labels(sizes)
    sets = _marked(fit, marks, sizes)
    count = len(draws)
    figure = Figure(figsize=(max(5.4, 2.3 * count), max(3.6, 2.2 * count)), layout="constrained")
    grid = figure.add_gridspec(count, count)
    limits = {n: _limits(v, [m.values[n] for m in sets if n in m.values]) for n, v in draws.items()}
    for row, below in enumerate(draws):
        for column, across in enumerate(list(draws)[: row + 1]):
            axes = figure.add_subplot(grid[row, column])
            axes.set_xlim(limits[across])
            if row == column:
                _histogram(axes, draws[across], labels[across])
                _lines(axes, across, sets)
            else:
                axes.set_ylim(limits[below])
                _pair(axes, draws[across], draws[below])
                _crossings(axes, across, below, sets)
            _corner_labels(axes, row, column, count, labels[across], labels[below])
    handles: list[Any] = [
        Line2D([], [], color=BLUE, linewidth=1.2, label="median"),
        Patch(color=BLUE, alpha=0.2, linewidth=0, label=f"{percent(_LEVEL)} interval"),
        *(Line2D([], [], label=literal(mark.label), **mark.look) for mark in sets),
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
    labels = _labels(sizes)
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
        styled(trace, "", "draw" if last else "", labels[name])
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
    scalars = scalars_of(posterior)
    chosen = list(names) if names else [n for n in scalars if not n.startswith("noise.")]
    unknown = [n for n in chosen if n not in scalars]
    if unknown or not chosen:
        raise InputError(
            f"The posterior has no parameter {listing(unknown)}; it has {listing(scalars)}.",
            "Correct the names.",
        )
    sizes = {n: shown_in(posterior[n]) for n in chosen}
    return {n: sizes[n].value * scalars[n] for n in chosen}, sizes


def _labels(sizes: Mapping[str, Size]) -> dict[str, str]:
    """Names and units; that of an effect's parameter in two lines."""
    return {n: bracketed(n.replace(".", ".\n"), size.unit) for n, size in sizes.items()}


class _Mark(NamedTuple):
    """Values by parameter to show beside the draws, and the look of their lines."""

    label: str
    values: Mapping[str, float]
    look: Mapping[str, Any]


def _marked(fit: Fit | None, marks: Any, sizes: Mapping[str, Size]) -> list[_Mark]:
    sets = marks or {}
    if not all(isinstance(v, Mapping) for v in sets.values()):
        sets = {"marked": sets}
    unknown = [n for values in sets.values() for n in values if n not in sizes]
    if unknown:
        raise InputError(
            f"marks: there is no parameter {listing(unknown)} in the figure, but {listing(sizes)}.",
            "Correct the names.",
        )
    named = {str(label): values for label, values in sets.items()}
    if fit is not None:
        named = {"fit": {n: fit.parameters[n].value for n in sizes if n in fit.parameters}, **named}
    dashed = {"color": VERMILLION, "linestyle": "--", "linewidth": 1.3}
    dotted = ({"color": colour, "linestyle": ":", "linewidth": 1.6} for colour in cycle(_MARKS))
    return [
        _Mark(
            label,
            {n: sizes[n].value * float(v) for n, v in values.items()},
            dashed if label == "fit" else next(dotted),
        )
        for label, values in named.items()
    ]


def _limits(values: np.ndarray, marked: Sequence[float]) -> tuple[float, float]:
    """The range of nearly all draws, stretched to marks that are not far."""
    low, high = np.quantile(values, _NEARLY_ALL)
    width = float(high - low) or abs(float(low)) or 1.0
    near = [m for m in marked if low - _REACH * width <= m <= high + _REACH * width]
    low, high = min([low, *near]), max([high, *near])
    return float(low - 0.06 * width), float(high + 0.06 * width)


def _histogram(axes: Axes, values: np.ndarray, label: str) -> None:
    flat = values.ravel()
    low, median, high = central(flat, _LEVEL)
    # bins as fine over the draws however far a mark stretches the axis
    axes.hist(flat, _BINS, range=tuple(np.quantile(flat, _NEARLY_ALL)), density=True,
              histtype="stepfilled", color=BLUE, alpha=0.35)  # fmt: skip
    axes.axvspan(low, high, color=BLUE, alpha=0.12, linewidth=0)
    axes.axvline(median, color=BLUE, linewidth=1.2)
    ends = interval_text(float(median), float(low), float(high))
    axes.set_title(f"{label}\n{ends[0]}\n{ends[1]} to {ends[2]}", loc="left")


def _lines(axes: Axes, name: str, marks: Sequence[_Mark]) -> None:
    low, high = axes.get_xlim()
    far = 0
    for mark in (mark for mark in marks if name in mark.values):
        value = mark.values[name]
        if low <= value <= high:
            axes.axvline(value, **mark.look)
            continue
        below = value < low
        text = f"← {mark.label} {value:.4g}" if below else f"{mark.label} {value:.4g} →"
        axes.text(0.03 if below else 0.97, 0.95 - 0.12 * far, literal(text), fontsize=8,
                  transform=axes.transAxes, ha="left" if below else "right", va="top",
                  color=mark.look["color"])  # fmt: skip
        far += 1
    if far:  # room above the histogram
        axes.set_ylim(0.0, (1.05 + 0.2 * far) * axes.get_ylim()[1])


def _crossings(axes: Axes, x: str, y: str, marks: Sequence[_Mark]) -> None:
    sides = ((x, axes.get_xlim(), axes.axvline), (y, axes.get_ylim(), axes.axhline))
    for mark in marks:
        for name, (low, high), line in sides:
            if name in mark.values and low <= mark.values[name] <= high:
                line(mark.values[name], **mark.look)


def _pair(axes: Axes, x: np.ndarray, y: np.ndarray) -> None:
    """Points, and contours of the smallest regions that hold given shares of the draws."""
    from scipy.ndimage import gaussian_filter

    x, y = x.ravel(), y.ravel()
    some = slice(None, None, max(1, x.size // 1500))
    axes.plot(x[some], y[some], ".", color=BLUE, markersize=1.5, alpha=0.25, rasterized=True)
    if x.size < 200 or not (np.ptp(x) > 0 and np.ptp(y) > 0):
        return
    ranges = [tuple(np.quantile(v, _NEARLY_ALL) + np.ptp(v) * np.array([-0.05, 0.05]))
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
