"""What figures share, made with matplotlib's objects: no global state, no window."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# Okabe & Ito 2008: told apart with every kind of colour vision
BLUE, VERMILLION, GREY = "#0072B2", "#D55E00", "0.6"
_POINTS = 4000


def literal(name: str) -> str:
    """A name from outside, which must not be read as a formula."""
    return name.replace("$", r"\$")


def styled(axes: Axes, title: str, x: str, y: str) -> None:
    """Title and labels of one panel, a light grid behind, and no box."""
    axes.set_title(title, loc="left", fontsize=9)
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)
    axes.grid(True, color="0.9", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
    axes.margins(x=0.01)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def thinned(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """At most some thousand points that look the same: the extremes of every stretch.

    Args:
        time: ``(n,)``.
        values: ``(n,)``; NaN where there is a gap.
    """
    values = np.where(np.isfinite(values), values, np.nan)
    if values.size <= _POINTS:
        return time, values
    width = -(-values.size // (_POINTS // 2))
    count = -(-values.size // width)
    padded = np.full(count * width, np.nan)
    padded[: values.size] = values
    rows = padded.reshape(count, width)
    start = np.arange(count) * width
    low = np.argmin(np.where(np.isnan(rows), np.inf, rows), axis=1)
    high = np.argmax(np.where(np.isnan(rows), -np.inf, rows), axis=1)
    index = np.sort(np.stack([start + low, start + high], axis=1), axis=1).reshape(-1)
    return time[index], values[index]
