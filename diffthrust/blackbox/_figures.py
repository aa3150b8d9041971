"""A black-box model held against a log, as a figure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from diffthrust._support.figures import BLUE, GREY, VERMILLION, is_sparse, literal, styled, thinned
from diffthrust.logs._log import Log


def model_figure(
    title: str,
    log: Log,
    units: Mapping[str, str],
    simulated: Mapping[str, np.ndarray],
    predicted: Mapping[str, np.ndarray],
    fits: Mapping[str, float],
) -> Figure:
    """Measured, simulated and predicted outputs; below, what is left of each."""
    outputs = tuple(simulated)
    figure = Figure(figsize=(8.5, 4.6 * len(outputs)), layout="constrained")
    panels = figure.subplots(
        2 * len(outputs), 1, sharex=True, height_ratios=[3, 1.5] * len(outputs)
    )
    for i, name in enumerate(outputs):
        top, below = panels[2 * i], panels[2 * i + 1]
        unit = units[name]
        words = f"{name} [{unit}]" if unit else name
        measured = log.values(name, unit)
        # Of a channel at half the rate of its log no two samples are neighbours, to be joined.
        dots: dict[str, Any] = (
            {"marker": "o", "markersize": 3, "linestyle": "none"} if is_sparse(measured) else {}
        )
        look = {"color": GREY, "linewidth": 2.4, **dots}
        top.plot(*thinned(log.time, measured), label="measured", **look)
        top.plot(*thinned(log.time, simulated[name]), color=VERMILLION, linewidth=1.2,
                 label="simulated freely")  # fmt: skip
        if predicted:
            top.plot(*thinned(log.time, predicted[name]), color=BLUE, linewidth=0.9,
                     linestyle="--", label="predicted one step ahead")  # fmt: skip
        fit = f", fit {fits[name]:.1f} %" if name in fits else ""
        styled(top, f"{literal(title)}{fit} in free simulation", "", words)
        top.legend(fontsize=8, frameon=False, ncols=3)
        below.axhline(0.0, color="0.4", linewidth=0.8)
        look = {"color": VERMILLION, "linewidth": 0.9, **dots}
        below.plot(*thinned(log.time, measured - simulated[name]), **look)
        if predicted:
            look = {"color": BLUE, "linewidth": 0.9, **dots}
            below.plot(*thinned(log.time, measured - predicted[name]), **look)
        last = name == outputs[-1]
        styled(below, "", "time [s]" if last else "", f"residual [{unit}]" if unit else "residual")
    return figure
