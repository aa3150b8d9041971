"""The figure of a suggested experiment."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np

from diffthrust._support.figures import BLUE, VERMILLION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from diffthrust.experiments._suggest import Experiment

_COLOURS = (BLUE, VERMILLION, "#009E73", "#CC79A7", "#E69F00", "#56B4E9")  # Okabe & Ito 2008
_BAND = 2.0
"""Half width of the noise bands, in standard deviations."""


def experiment_figure(test: Experiment) -> Figure:
    """The inputs on top; below, for each channel, the rivals' predictions and their difference.

    The whole test on the left; on the right the stretch where the rivals differ most.

    Every prediction has a band of two standard deviations of the noise; the differences are those
    of ``test.truth`` from its imitations, over the same band around zero.
    """
    from matplotlib.figure import Figure

    channels = list(test.noise)
    rows = [1.0] * len(test.inputs) + [1.9, 1.3] * len(channels)
    figure = Figure(figsize=(11.0, 1.3 + 1.15 * sum(rows)), layout="constrained")
    grid = figure.subplots(
        len(rows), 2, sharex="col", sharey="row", height_ratios=rows, width_ratios=(2, 1)
    )
    for column, axes in enumerate(grid.T):
        for panel, (name, values) in zip(axes, test.inputs.items(), strict=False):
            panel.step(test.time, values, where="post", color="0.2", linewidth=1.1)
            _label(panel, name, test.units[name], column == 0)
        for i, name in enumerate(channels):
            above, below = axes[len(test.inputs) + 2 * i :][:2]
            _predictions(above, test, name)
            _differences(below, test, name)
            _label(above, name, test.units[name], column == 0)
            _label(below, "difference", test.units[name], column == 0)
        axes[-1].set_xlabel("time [s]", fontsize=9)
    grid[0, 1].set_xlim(*_detail(test))
    grid[0, 1].set_title("where they differ most", loc="left", fontsize=9)
    figure.suptitle(
        textwrap.fill(test.sentence, 120), x=0.01, ha="left", fontsize=10, fontweight="bold"
    )
    shown = [*grid[len(test.inputs), 0].get_legend_handles_labels()]
    shown = [a + b for a, b in zip(shown, grid[-1, 0].get_legend_handles_labels(), strict=True)]
    figure.legend(*shown, loc="outside lower left", ncols=3, fontsize=8, frameon=False)
    return figure


def _detail(test: Experiment) -> tuple[float, float]:
    """A stretch of a fifteenth of the test, where the differences are largest to the noise."""
    first, *others = _order(test)
    squares = [
        np.nan_to_num(test.difference(channel, first, name) / sigma) ** 2
        for channel, sigma in test.noise.items()
        for name in others
    ]
    width = max(test.time.size // 15, 10)
    begin = int(np.argmax(np.convolve(np.sum(squares, axis=0), np.ones(width), mode="valid")))
    return float(test.time[begin]), float(test.time[min(begin + width, test.time.size - 1)])


def _order(test: Experiment) -> list[str]:
    """The truth of the worst pair first."""
    return [test.truth, *(name for name in test.rivals if name != test.truth)]


def _predictions(panel: Axes, test: Experiment, channel: str) -> None:
    width = _BAND * test.noise[channel]
    for i, name in enumerate(_order(test)):
        values, colour = test.predictions[name][channel], _COLOURS[i % len(_COLOURS)]
        panel.fill_between(
            test.time, values - width, values + width, color=colour, alpha=0.18, linewidth=0
        )
        label = f"if {name} holds" if i == 0 else f"imitated by {name}"
        panel.plot(
            test.time, values, color=colour, linewidth=1.2, label=label, ls="-" if i == 0 else "--"
        )


def _differences(panel: Axes, test: Experiment, channel: str) -> None:
    first, *others = _order(test)
    width = _BAND * test.noise[channel]
    panel.axhspan(
        -width, width, color="0.85", linewidth=0, label=f"noise (±{_BAND:g} standard deviations)"
    )
    panel.axhline(0.0, color="0.4", linewidth=0.8)
    for i, name in enumerate(others, 1):
        apart = test.difference(channel, first, name)
        panel.plot(test.time, apart, color=_COLOURS[i % len(_COLOURS)], linewidth=1.0)


def _label(panel: Axes, name: str, unit: str, named: bool) -> None:
    if named:
        panel.set_ylabel(f"{name}\n[{unit}]" if unit else name, fontsize=8)
    panel.grid(True, color="0.9", linewidth=0.6)
    panel.set_axisbelow(True)
    panel.tick_params(labelsize=8)
    panel.margins(x=0.01)
    for side in ("top", "right"):
        panel.spines[side].set_visible(False)
