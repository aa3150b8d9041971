"""Figures of profiles of the likelihood, and of intervals side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from diffthrust._support.figures import BLUE, GREY, VERMILLION, literal, styled
from diffthrust._support.words import with_error
from diffthrust.uncertainty._values import Profile, Row, shortest_half_arm

_ACROSS = 3
_WIDE = 30.0
"""Values of more than this ratio are shown on a logarithm."""
# Okabe & Ito 2008; the marks tell them apart in print as well
_LOOKS = {
    "covariance": ("0.45", "s"),
    "sandwich": (VERMILLION, "D"),
    "profile": (BLUE, "o"),
    "posterior": ("#009E73", "^"),
}


def profile_figure(profiles: Sequence[Profile]) -> Figure:
    """One panel for each profile: how the best log-likelihood falls away from the estimate.

    Beside it the parabola that the covariance stands for. The interval lies where the profile is
    below the threshold; an end that is open has no mark.
    """
    figure, panels = _panels(
        len(profiles), lambda across, down: (1 + 3.9 * across, 0.9 + 2.9 * down)
    )
    for i, (axes, profile) in enumerate(zip(panels, profiles, strict=True)):
        _profile_panel(axes, profile.shown, i % _ACROSS == 0)
    handles = {
        label: line
        for axes in panels
        for line, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    if handles:
        look: dict[str, Any] = {"loc": "outside upper left", "frameon": False, "fontsize": 9}
        figure.legend(handles=[*handles.values()], ncols=len(handles), **look)
    return figure


def _panels(
    count: int, size: Callable[[int, int], tuple[float, float]]
) -> tuple[Figure, list[Axes]]:
    """A figure of panels in rows; its size by the numbers of columns and rows."""
    across = max(1, min(_ACROSS, count))
    down = max(1, -(-count // across))
    figure = Figure(figsize=size(across, down), layout="constrained")
    return figure, [figure.add_subplot(down, across, i + 1) for i in range(count)]


def _profile_panel(axes: Axes, p: Profile, first: bool) -> None:
    limit = 0.5 * p.threshold
    x, y = _smooth(p)
    axes.axhline(limit, color="0.3", linewidth=0.9, linestyle=":", label=f"{100 * p.level:g} %")
    if p.std_error:
        wide = np.linspace(-1.25, 1.25, 101) * np.sqrt(p.threshold) * p.std_error
        look: dict[str, Any] = {"color": VERMILLION, "linewidth": 1.3, "linestyle": "--"}
        axes.plot(p.value + wide, 0.5 * (wide / p.std_error) ** 2, label="covariance", **look)
    axes.plot(x, y, color=BLUE, linewidth=1.8, label="profile")
    axes.plot(p.grid, p.drop, "o", color=BLUE, markersize=2.8)
    for end in (p.low, p.high):
        if end is not None:
            axes.plot([end, end], [0.0, limit], color=BLUE, linewidth=0.9)
    axes.plot([p.value], [0.0], "|", color="0.1", markersize=12, markeredgewidth=1.6)
    unit = f" [{p.unit}]" if p.unit else ""
    title = [f"{literal(p.name)}: {_interval(p)}"]
    sides = (("downwards", p.open_low), ("upwards", p.open_high))
    title += [f"{side}: {why}" for side, why in sides if why]
    y_label = "drop of the log-likelihood" if first else ""
    styled(axes, "\n".join(title), f"{literal(p.name)}{unit}", y_label)
    axes.set_ylim(-0.06 * limit, 1.55 * limit)
    _scale(axes, 5, *_profile_range(p))
    axes.axhline(0.0, color=GREY, linewidth=0.6, zorder=0)


def _interval(p: Profile) -> str:
    error = shortest_half_arm(p.value, (p.low, p.high))
    low, high = ("" if e is None else with_error(e, error)[0] for e in (p.low, p.high))
    if not (low or high):
        return "open to both sides"
    words = f"{low} to {high}" if low and high else f"at least {low}" if low else f"at most {high}"
    return f"{words} {p.unit}".rstrip()


def _span_decades(values: Sequence[float]) -> bool:
    """Whether only a logarithm shows all values."""
    return min(values) > 0 and max(values) > _WIDE * min(values)


def _scale(axes: Axes, ticks: int, low: float, high: float, logarithmic: bool) -> None:
    axes.set_xlim(low, high)
    if logarithmic:
        axes.set_xscale("log")
    else:
        axes.locator_params(axis="x", nbins=ticks)


def _profile_range(p: Profile) -> tuple[float, float, bool]:
    """As far as the crossing and a little more, and whether on a logarithm.

    Of an open side what the walk has seen nearby.
    """
    ends = [e for e in (p.low, p.value, p.high) if e is not None]
    if p.grid[0] > 0 and _span_decades(ends):
        margin = (max(ends) / min(ends)) ** 0.2
        return min(ends) / margin, max(ends) * margin, True
    arms = [abs(e - p.value) for e in (p.low, p.high) if e is not None]
    arm = max(arms, default=2 * p.std_error if p.std_error else float(np.ptp(p.grid)) or 1.0)
    low = p.low if p.low is not None else max(p.grid[0], p.value - 1.6 * arm)
    high = p.high if p.high is not None else min(p.grid[-1], p.value + 1.6 * arm)
    margin = 0.2 * (high - low) or 0.2 * arm
    return low - margin, high + margin, False


def _smooth(p: Profile) -> tuple[np.ndarray, np.ndarray]:
    """A curve through the points: the signed root of the drop is nearly a straight line."""
    from scipy.interpolate import PchipInterpolator  # slow to import

    # a walk that was blocked by bounds may repeat a point: the interpolation needs rising ones
    rising = np.concatenate([[True], np.diff(p.grid) > 0])
    x, y = p.grid[rising], np.maximum(p.drop[rising], 0.0)
    if x.size < 2:
        return x, y
    if p.value in (x[0], x[-1]):  # at a bound it rises at once, and a root would start upright
        fine = np.linspace(x[0], x[-1], 401)
        return fine, PchipInterpolator(x, y)(fine)
    root = np.sign(x - p.value) * np.sqrt(y)
    if _profile_range(p)[2]:
        fine = np.geomspace(x[0], x[-1], 2001)
        return fine, PchipInterpolator(np.log(x), root)(np.log(fine)) ** 2
    # by sections: an open side may reach a thousand times as far as the other
    fine = np.unique(np.concatenate([np.linspace(a, b, 13) for a, b in pairwise(x)]))
    return fine, PchipInterpolator(x, root)(fine) ** 2


def intervals_figure(rows: Sequence[Row], methods: Sequence[str], level: float) -> Figure:
    """One panel for each parameter: the intervals of all methods below each other.

    The recommended one is drawn thick. An end that is open is an arrow to the edge.
    """
    height = 1.2 + 0.3 * len(methods)
    figure, panels = _panels(
        len(rows), lambda across, down: (1.3 + 3.7 * across, 0.5 + down * height)
    )
    for axes, row in zip(panels, rows, strict=True):
        _interval_panel(axes, row, methods)
    percent = f"{100 * level:g} % intervals, the recommended one thick"
    figure.suptitle(percent, x=0.01, ha="left", fontsize=10, fontweight="bold")
    return figure


def _interval_panel(axes: Axes, row: Row, methods: Sequence[str]) -> None:
    low, high, logarithmic = _interval_range(row)
    axes.axvline(row.value, color="0.75", linewidth=0.9, zorder=0)
    for y, method in enumerate(methods):
        interval = row.intervals.get(method)
        if interval is None:
            axes.text(row.value, y, "  none", va="center", fontsize=8, color="0.4")
            continue
        colour, mark = _LOOKS[method]
        wide = 4.0 if method == row.recommended else 1.6
        edges = [b if b is not None else e for b, e in zip(row.bounds, (low, high), strict=True)]
        ends = [e if e is not None else edge for e, edge in zip(interval, edges, strict=True)]
        axes.plot(ends, [y, y], color=colour, linewidth=wide, solid_capstyle="butt")
        for end, bound, place, sign in zip(interval, row.bounds, ends, "<>", strict=True):
            shape = sign if end is None and bound is None else "|"
            axes.plot([place], [y], shape, color=colour, markersize=9, clip_on=False)
        axes.plot([row.value], [y], mark, color=colour, markersize=5.5)
    for bound in row.bounds:
        if bound is not None:
            axes.axvline(bound, color="0.2", linewidth=1.2, linestyle=":")
            beside: dict[str, Any] = {
                "xytext": (2, -8),
                "textcoords": "offset points",
                "fontsize": 7,
            }
            axes.annotate("bound", (bound, 1.0), xycoords=axes.get_xaxis_transform(), **beside)
    axes.set_ylim(len(methods) - 0.4, -0.6)
    axes.set_yticks(range(len(methods)), [f"{m} *" if m == row.recommended else m for m in methods])
    unit = f" [{row.unit}]" if row.unit else ""
    styled(axes, f"{literal(row.name)}{unit}", "", "")
    axes.grid(False, axis="y")
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    _scale(axes, 4, low, high, logarithmic)


def _interval_range(row: Row) -> tuple[float, float, bool]:
    """All ends and a margin, and whether on a logarithm; an open end reaches to the edge."""
    ends = [row.value]
    ends += [e for interval in row.intervals.values() for e in interval if e is not None]
    logarithmic = _span_decades(ends)
    ends += [b for b in row.bounds if b is not None]
    low, high = min(ends), max(ends)
    margins = [
        0.25 if any(f[i] is None for f in row.intervals.values()) and row.bounds[i] is None else 0.1
        for i in (0, 1)
    ]
    if logarithmic:
        return low * (low / high) ** margins[0], high * (high / low) ** margins[1], True
    wide = high - low or abs(row.value) or 1.0
    return low - margins[0] * wide, high + margins[1] * wide, False
