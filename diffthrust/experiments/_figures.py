"""The figure of a suggested experiment."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from diffthrust._support.figures import COLOURS, unboxed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Series = Mapping[str, np.ndarray]
_BAND = 2.0
"""Half width of the noise bands, in standard deviations."""


def experiment_figure(
    sentence: str,
    time: np.ndarray,
    inputs: Series,
    predictions: Mapping[str, Series],
    noise: Mapping[str, float],
    units: Mapping[str, str],
) -> Figure:
    """Inputs on top; below, for each channel, the rivals' predictions and their difference.

    The whole test on the left; on the right the stretch where the rivals differ most. Every
    prediction has a band of two standard deviations of the noise; the differences are those of the
    truth, the first rival, from its imitations, over the same band around zero.
    """
    from matplotlib.figure import Figure

    rows = [1.0] * len(inputs) + [1.9, 1.3] * len(noise)
    figure = Figure(figsize=(11.0, 1.3 + 1.15 * sum(rows)), layout="constrained")
    grid = figure.subplots(
        len(rows), 2, sharex="col", sharey="row", height_ratios=rows, width_ratios=(2, 1)
    )
    for column, axes in enumerate(grid.T):
        for panel, (name, values) in zip(axes, inputs.items(), strict=False):
            panel.step(time, values, where="post", color="0.2", linewidth=1.1)
            _label(panel, name, units[name], column == 0)
        for i, (name, sigma) in enumerate(noise.items()):
            above, below = axes[len(inputs) + 2 * i :][:2]
            series = {rival: outputs[name] for rival, outputs in predictions.items()}
            _predictions(above, time, series, _BAND * sigma)
            _differences(below, time, series, _BAND * sigma)
            _label(above, name, units[name], column == 0)
            _label(below, "difference", units[name], column == 0)
        axes[-1].set_xlabel("time [s]", fontsize=9)
    grid[0, 1].set_xlim(*_detail(time, predictions, noise))
    grid[0, 1].set_title("where they differ most", loc="left", fontsize=9)
    figure.suptitle(textwrap.fill(sentence, 120), x=0.01, ha="left", fontsize=10, fontweight="bold")
    shown = [*grid[len(inputs), 0].get_legend_handles_labels()]
    shown = [a + b for a, b in zip(shown, grid[-1, 0].get_legend_handles_labels(), strict=True)]
    figure.legend(*shown, loc="outside lower left", ncols=3, fontsize=8, frameon=False)
    return figure


def _detail(
    time: np.ndarray, predictions: Mapping[str, Series], noise: Mapping[str, float]
) -> tuple[float, float]:
    """A stretch of a fifteenth of the test, where the differences are largest to the noise."""
    truth, *imitations = predictions.values()
    squares = [
        np.nan_to_num((truth[channel] - imitation[channel]) / sigma) ** 2
        for channel, sigma in noise.items()
        for imitation in imitations
    ]
    width = max(time.size // 15, 10)
    begin = int(np.argmax(np.convolve(np.sum(squares, axis=0), np.ones(width), mode="valid")))
    return float(time[begin]), float(time[min(begin + width, time.size - 1)])


def _predictions(panel: Axes, time: np.ndarray, series: Series, width: float) -> None:
    for i, (name, values) in enumerate(series.items()):
        colour = COLOURS[i % len(COLOURS)]
        low, high = values - width, values + width
        panel.fill_between(time, low, high, color=colour, alpha=0.18, linewidth=0)
        label, dashes = (f"imitated by {name}", "--") if i else (f"if {name} holds", "-")
        panel.plot(time, values, color=colour, linewidth=1.2, label=label, ls=dashes)


def _differences(panel: Axes, time: np.ndarray, series: Series, width: float) -> None:
    truth, *imitations = series.values()
    label = f"noise (±{_BAND:g} standard deviations)"
    panel.axhspan(-width, width, color="0.85", linewidth=0, label=label)
    panel.axhline(0.0, color="0.4", linewidth=0.8)
    for i, imitation in enumerate(imitations, 1):
        colour = COLOURS[i % len(COLOURS)]
        panel.plot(time, truth - imitation, color=colour, linewidth=1.0)


def _label(panel: Axes, name: str, unit: str, named: bool) -> None:
    if named:
        panel.set_ylabel(f"{name}\n[{unit}]" if unit else name, fontsize=8)
    unboxed(panel)
