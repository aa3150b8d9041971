"""Figure of intervals side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING

from diffthrust._support.figures import BLUE, VERMILLION, literal

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from diffthrust.uncertainty._intervals_result import Intervals, Row

# Okabe & Ito 2008; the marks tell them apart in print as well
_LOOKS = {
    "covariance": ("0.45", "s"),
    "sandwich": (VERMILLION, "D"),
    "profile": (BLUE, "o"),
    "posterior": ("#009E73", "^"),
}
_ACROSS = 3


def intervals_figure(intervals: Intervals) -> Figure:
    """One panel for each parameter: the intervals of all methods below each other.

    The recommended one is drawn thick. An end that is open is an arrow to the edge.
    """
    from matplotlib.figure import Figure

    rows, methods = list(intervals.rows.values()), intervals.methods
    across = max(1, min(_ACROSS, len(rows)))
    down = max(1, -(-len(rows) // across))
    height = 0.8 + 0.3 * len(methods)
    figure = Figure(figsize=(1.3 + 3.7 * across, 0.5 + down * (0.4 + height)), layout="constrained")
    for i, row in enumerate(rows):
        _panel(figure.add_subplot(down, across, i + 1), row, methods)
    percent = f"{100 * intervals.level:g} % intervals, the recommended one thick"
    figure.suptitle(percent, x=0.01, ha="left", fontsize=10, fontweight="bold")
    return figure


def _panel(axes: Axes, row: Row, methods: tuple[str, ...]) -> None:
    low, high = _range(row)
    axes.axvline(row.value, color="0.75", linewidth=0.9, zorder=0)
    for y, method in enumerate(methods):
        found = row.intervals.get(method)
        if found is None:
            axes.text(row.value, y, "  none", va="center", fontsize=8, color="0.4")
            continue
        colour, mark = _LOOKS[method]
        wide = 4.0 if method == row.recommended else 1.6
        edges = [b if b is not None else e for b, e in zip(row.bounds, (low, high), strict=True)]
        ends = [e if e is not None else edge for e, edge in zip(found, edges, strict=True)]
        axes.plot(ends, [y, y], color=colour, linewidth=wide, solid_capstyle="butt")
        for end, bound, place, sign in zip(found, row.bounds, ends, "<>", strict=True):
            shape = sign if end is None and bound is None else "|"
            axes.plot([place], [y], shape, color=colour, markersize=9, clip_on=False)
        axes.plot([row.value], [y], mark, color=colour, markersize=5.5)
    for bound in row.bounds:
        if bound is not None:
            axes.axvline(bound, color="0.2", linewidth=1.2, linestyle=":")
            axes.annotate(
                "bound",
                (bound, 1.0),
                xycoords=axes.get_xaxis_transform(),
                fontsize=7,
                xytext=(2, -8),
                textcoords="offset points",
            )
    axes.set_ylim(len(methods) - 0.4, -0.6)
    axes.set_xlim(low, high)
    axes.set_yticks(range(len(methods)), [f"{m} *" if m == row.recommended else m for m in methods])
    unit = f" [{row.unit}]" if row.unit else ""
    axes.set_title(f"{literal(row.name)}{unit}", loc="left", fontsize=9)
    axes.grid(True, axis="x", color="0.9", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
    axes.tick_params(axis="y", length=0)
    if _decades(row):
        axes.set_xscale("log")
    else:
        axes.locator_params(axis="x", nbins=4)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)


def _range(row: Row) -> tuple[float, float]:
    """All ends and a margin; an open end reaches to the edge."""
    ends = [e for found in row.intervals.values() for e in found if e is not None]
    ends += [b for b in row.bounds if b is not None]
    low, high = min([*ends, row.value]), max([*ends, row.value])
    margins = [
        0.25 if any(f[i] is None for f in row.intervals.values()) and row.bounds[i] is None else 0.1
        for i in (0, 1)
    ]
    if _decades(row):
        return low * (low / high) ** margins[0], high * (high / low) ** margins[1]
    wide = high - low or abs(row.value) or 1.0
    return low - margins[0] * wide, high + margins[1] * wide


def _decades(row: Row) -> bool:
    """Whether only a logarithm shows all ends."""
    ends = [e for found in row.intervals.values() for e in found if e is not None]
    return min([*ends, row.value]) > 0 and max([*ends, row.value]) > 30 * min([*ends, row.value])
