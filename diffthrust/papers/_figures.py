"""The figures of the papers' methods."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from diffthrust._support.figures import BLUE, GREY, VERMILLION, styled, thinned
from diffthrust.models import Vessel
from diffthrust.papers._line import FittedLine, Transient
from diffthrust.uncertainty._prediction.physical import Quantity

_Points = tuple[np.ndarray, np.ndarray]


def static_test_figure(
    thrust: FittedLine, speed: FittedLine, ct: Quantity, ratio: Quantity
) -> Figure:
    """The two lines of a static test."""
    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    thrust_panel, second_panel = figure.subplots(1, 2)
    _line(thrust_panel, thrust, "speed |speed| [rad²/s²]", "thrust [N]", f"ct = {ct}")
    _line(second_panel, speed, "command [V]", "speed |speed| [rad²/s²]", f"beta/alpha = {ratio}")
    return figure


def dynamic_test_figure(
    time: np.ndarray, command: np.ndarray, measured: np.ndarray, simulated: np.ndarray, label: str
) -> Figure:
    """The command of a dynamic test, and what was measured and simulated."""
    figure = Figure(figsize=(8.0, 4.6), layout="constrained")
    top, below = figure.subplots(2, 1, sharex=True)
    top.plot(*thinned(time, command), color="0.4", linewidth=0.9)
    styled(top, "Dynamic test", "", "command [V]")
    below.plot(*thinned(time, measured), color=BLUE, linewidth=1.2, label="measured")
    dashed: dict[str, Any] = {"color": VERMILLION, "linewidth": 1.0, "linestyle": "--"}
    below.plot(*thinned(time, simulated), label="simulated", **dashed)
    _finished(below, "", "time [s]", label, ncols=2)
    return figure


def steady_map_figure(thrust: np.ndarray, printed: np.ndarray, modelled: np.ndarray) -> Figure:
    """Voltage against thrust, by equation 7 and of the model."""
    figure = Figure(figsize=(6.0, 4.0), layout="constrained")
    axes = figure.subplots()
    equation = "equation 7: R T / Km + Ke √(T / KT)"
    axes.plot(thrust, printed, color=VERMILLION, linestyle="--", label=equation)
    axes.plot(thrust, modelled, color=BLUE, label="steady state of the model, with friction")
    _finished(axes, "Steady map of the thruster", "thrust [N]", "voltage [V]")
    return figure


def calibration_figure(
    lines: Mapping[str, FittedLine], together: FittedLine, slope: float, intercept: float
) -> Figure:
    """The readings of a depth sensor, the line through them, and the datasheet's."""
    figure = Figure(figsize=(6.5, 4.4), layout="constrained")
    axes = figure.subplots()
    x = np.array([0.0, max(float(line.x.max()) for line in lines.values())])
    looks = (("o", BLUE), ("s", "#009E73"), ("^", "#CC79A7"), ("v", GREY))
    for i, (name, line) in enumerate(lines.items()):
        marker, colour = looks[min(i, 3)]
        axes.plot(line.x, line.y, marker, color=colour, markersize=4, label=name)
    label = f"line: {together.slope:.4f} V/m, {together.intercept:.3f} V"
    axes.plot(x, together(x), color=VERMILLION, linewidth=1.3, label=label)
    label = f"datasheet: {slope:g} V/m, {intercept:g} V"
    axes.plot(x, slope * x + intercept, color="black", linestyle="--", linewidth=1.3, label=label)
    title = "Depth sensor: readings and the datasheet's line"
    _finished(axes, title, "depth [m]", "reading [V]", loc="center right")
    return figure


def sequential_figure(
    vessel: Vessel,
    steady_speed: FittedLine,
    surge: Transient,
    lines: Mapping[str, FittedLine],
    yaw: Transient,
    verification: Mapping[str, _Points],
) -> Figure:
    """Six panels: what each parameter of a vessel was read from, fitted and verified."""
    figure = Figure(figsize=(12.0, 7.2), layout="constrained")
    panels = figure.subplots(2, 3).ravel()
    _line(
        panels[0], steady_speed, "ln of propeller speed [rev/s]", "ln of steady surge [m/s]",
        f"exponent = {vessel.exponent:.3g}, d11 = {vessel.d11:.3g}",
    )  # fmt: skip
    panels[0].set_xlim(steady_speed.x.min() - 0.1, steady_speed.x.max() + 0.1)
    panels[0].set_ylim(steady_speed.y.min() - 0.1, steady_speed.y.max() + 0.1)
    _transient(panels[1], surge, "surge [m/s]", f"m11 = {vessel.m11:.3g}")
    for axes, name, x, y in (
        (panels[2], "m22", "v r", "d11 u - n^C cos a"),
        (panels[3], "d22", "v [m/s]", "n^C sin a - m11 u r"),
        (panels[4], "d33", "r [rad/s]", "(m11 - m22) u v - L n^C sin a"),
    ):
        line = lines[name]
        _line(axes, line, x, y, f"{name} = {line.slope:.3g}", verification[name])
        ends = [*axes.get_lines()[0].get_xdata(), *axes.get_lines()[1].get_xdata()]  # pyright: ignore
        axes.set_xlim(min(*ends, 0.0) * 1.1, max(*ends, 0.0) * 1.1 + 1e-3)
    _transient(panels[5], yaw, "yaw rate [rad/s]", f"i33 = {vessel.i33:.3g}")
    return figure


def _line(
    axes: Axes, line: FittedLine, x: str, y: str, title: str, verification: _Points | None = None
) -> None:
    """Points and their line; ``verification`` are points ``(x, y)`` that were not fitted."""
    axes.plot(line.x, line.y, "o", color=BLUE, markersize=5, label="fitted to")
    shown = line.x
    if verification is not None:
        axes.plot(*verification, "s", color=GREY, markersize=5, label="verified on")
        shown = np.concatenate([shown, verification[0]])
    ends = np.array([min(0.0, shown.min()), shown.max()])
    axes.plot(ends, line(ends), color=VERMILLION, linewidth=1.3, label="line")
    _finished(axes, title, x, y)


def _transient(axes: Axes, transient: Transient, label: str, title: str) -> None:
    kinds = (("fitted to", transient.runs, BLUE), ("verified on", transient.others, GREY))
    for kind, runs, colour in kinds:
        for k, (time, measured, _) in enumerate(runs):
            axes.plot(time, measured, ".", color=colour, markersize=3, label="" if k else kind)
    for k, (time, _, course) in enumerate((*transient.runs, *transient.others)):
        axes.plot(time, course, color=VERMILLION, linewidth=1.2, label="" if k else "curve")
    _finished(axes, title, "time since the step [s]", label)


def _finished(axes: Axes, title: str, x: str, y: str, **legend: Any) -> None:
    styled(axes, title, x, y)
    axes.legend(fontsize=8, frameon=False, **legend)
