"""Figure of profiles of the likelihood."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from diffthrust._support.figures import BLUE, GREY, VERMILLION, literal, styled
from diffthrust._support.tables import with_error

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from diffthrust.uncertainty._profile_result import Profile, Profiles

_ACROSS = 3
_WIDE = 30.0
"""Values of more than this ratio are shown on a logarithm."""


def profile_figure(profiles: Profiles) -> Figure:
    """One panel for each profile: how the best log-likelihood falls away from the estimate.

    Beside it the parabola that the covariance stands for. The interval lies where the profile is
    below the threshold; an end that is open has no mark.
    """
    from matplotlib.figure import Figure

    shown = list(profiles.profiles.values())
    across = max(1, min(_ACROSS, len(shown)))
    down = max(1, -(-len(shown) // across))
    figure = Figure(figsize=(1.0 + 3.9 * across, 0.9 + 2.9 * down), layout="constrained")
    for i, one in enumerate(shown):
        _panel(figure.add_subplot(down, across, i + 1), one, i % across == 0)
    if figure.axes:
        handles = {
            str(line.get_label()): line
            for axes in figure.axes
            for line in axes.get_lines()
            if not str(line.get_label()).startswith("_")
        }
        figure.legend(
            handles=list(handles.values()),
            loc="outside upper left",
            ncols=len(handles),
            frameon=False,
            fontsize=9,
        )
    return figure


def _panel(axes: Axes, one: Profile, first: bool) -> None:
    limit = 0.5 * one.threshold
    x, y = _smooth(one)
    axes.axhline(limit, color="0.3", linewidth=0.9, linestyle=":", label=f"{100 * one.level:g} %")
    if one.std_error:
        wide = np.linspace(-1.25, 1.25, 101) * np.sqrt(one.threshold) * one.std_error
        axes.plot(
            one.value + wide,
            0.5 * (wide / one.std_error) ** 2,
            color=VERMILLION,
            linewidth=1.3,
            linestyle="--",
            label="covariance",
        )
    axes.plot(x, y, color=BLUE, linewidth=1.8, label="profile")
    axes.plot(one.grid, one.drop, "o", color=BLUE, markersize=2.8)
    for end in (one.low, one.high):
        if end is not None:
            axes.plot([end, end], [0.0, limit], color=BLUE, linewidth=0.9)
    axes.plot([one.value], [0.0], "|", color="0.1", markersize=12, markeredgewidth=1.6)
    unit = f" [{one.unit}]" if one.unit else ""
    title = [f"{literal(one.name)}: {_interval(one)}"]
    title += [f"{side}: {why}" for side, why in
              (("downwards", one.open_low), ("upwards", one.open_high)) if why]  # fmt: skip
    styled(
        axes,
        "\n".join(title),
        f"{literal(one.name)}{unit}",
        "drop of the log-likelihood" if first else "",
    )
    axes.set_ylim(-0.06 * limit, 1.55 * limit)
    axes.set_xlim(*_range(one))
    if _decades(one):
        axes.set_xscale("log")
    else:
        axes.locator_params(axis="x", nbins=5)
    axes.axhline(0.0, color=GREY, linewidth=0.6, zorder=0)


def _interval(one: Profile) -> str:
    arms = [abs(e - one.value) for e in (one.low, one.high) if e is not None]
    low, high = (
        with_error(e, 0.5 * min(arms))[0] if e is not None else None for e in (one.low, one.high)
    )
    if low is not None and high is not None:
        words = f"{low} to {high}"
    elif low is not None:
        words = f"at least {low}"
    elif high is not None:
        words = f"at most {high}"
    else:
        return "open to both sides"
    return f"{words} {one.unit}".rstrip()


def _decades(one: Profile) -> bool:
    """Whether the values that matter span decades, so that only a logarithm shows them all."""
    ends = [e for e in (one.low, one.high, one.value) if e is not None]
    return bool(one.grid[0] > 0 and max(ends) > _WIDE * min(ends))


def _range(one: Profile) -> tuple[float, float]:
    """As far as the crossing and a little more; of an open side what the walk has seen nearby."""
    if _decades(one):
        ends = np.log([e for e in (one.low, one.value, one.high) if e is not None])
        margin = 0.2 * np.ptp(ends)
        return float(np.exp(ends.min() - margin)), float(np.exp(ends.max() + margin))
    arms = [abs(e - one.value) for e in (one.low, one.high) if e is not None]
    arm = max(arms, default=2 * one.std_error if one.std_error else float(np.ptp(one.grid)) or 1.0)
    low = one.low if one.low is not None else max(one.grid[0], one.value - 1.6 * arm)
    high = one.high if one.high is not None else min(one.grid[-1], one.value + 1.6 * arm)
    margin = 0.2 * (high - low) or 0.2 * arm
    return low - margin, high + margin


def _smooth(one: Profile) -> tuple[np.ndarray, np.ndarray]:
    """A curve through the points: the signed root of the drop is nearly a straight line."""
    from scipy.interpolate import PchipInterpolator  # slow to import

    rising = np.concatenate([[True], np.diff(one.grid) > 0])
    x, y = one.grid[rising], np.maximum(one.drop[rising], 0.0)
    if x.size < 2:
        return x, y
    if one.value in (x[0], x[-1]):  # at a bound it rises at once, and a root would start upright
        fine = np.linspace(x[0], x[-1], 401)
        return fine, PchipInterpolator(x, y)(fine)
    root = np.sign(x - one.value) * np.sqrt(y)
    if _decades(one):
        fine = np.geomspace(x[0], x[-1], 2001)
        return fine, PchipInterpolator(np.log(x), root)(np.log(fine)) ** 2
    # by sections: an open side may reach a thousand times as far as the other
    fine = np.unique(np.concatenate([np.linspace(a, b, 13) for a, b in pairwise(x)]))
    return fine, PchipInterpolator(x, root)(fine) ** 2
