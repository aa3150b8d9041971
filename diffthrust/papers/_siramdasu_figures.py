"""The figures of the sequential identification of a vessel."""

from __future__ import annotations

from typing import TYPE_CHECKING

from diffthrust._support.figures import BLUE, GREY, VERMILLION, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from diffthrust.papers.siramdasu import Sequential, Transient


def sequential_figure(found: Sequential) -> Figure:
    """Six panels: what each parameter was read from, fitted and verified."""
    from matplotlib.figure import Figure

    vessel = found.vessel
    figure = Figure(figsize=(12.0, 7.2), layout="constrained")
    panels = figure.subplots(2, 3).ravel()
    found.steady_speed.draw(
        panels[0], "ln of propeller speed [rev/s]", "ln of steady surge [m/s]",
        f"exponent = {vessel.exponent:.3g}, d11 = {vessel.d11:.3g}",
    )  # fmt: skip
    panels[0].set_xlim(found.steady_speed.x.min() - 0.1, found.steady_speed.x.max() + 0.1)
    panels[0].set_ylim(found.steady_speed.y.min() - 0.1, found.steady_speed.y.max() + 0.1)
    _transient(panels[1], found.surge, "surge [m/s]", f"m11 = {vessel.m11:.3g}")
    for axes, name, x, y in (
        (panels[2], "m22", "v r", "d11 u - n^C cos a"),
        (panels[3], "d22", "v [m/s]", "n^C sin a - m11 u r"),
        (panels[4], "d33", "r [rad/s]", "(m11 - m22) u v - L n^C sin a"),
    ):
        line = getattr(found, name)
        line.draw(axes, x, y, f"{name} = {line.slope:.3g}", found.verification[name])
        ends = [*axes.get_lines()[0].get_xdata(), *axes.get_lines()[1].get_xdata()]  # pyright: ignore
        axes.set_xlim(min(*ends, 0.0) * 1.1, max(*ends, 0.0) * 1.1 + 1e-3)
    _transient(panels[5], found.yaw, "yaw rate [rad/s]", f"i33 = {vessel.i33:.3g}")
    return figure


def _transient(axes: Axes, found: Transient, label: str, title: str) -> None:
    for kind, runs, colour in (
        ("fitted to", found.runs, BLUE),
        ("verified on", found.others, GREY),
    ):
        for k, (time, measured, _) in enumerate(runs):
            axes.plot(time, measured, ".", color=colour, markersize=3, label="" if k else kind)
    for k, (time, _, course) in enumerate((*found.runs, *found.others)):
        axes.plot(time, course, color=VERMILLION, linewidth=1.2, label="" if k else "curve")
    styled(axes, title, "time since the step [s]", label)
    axes.legend(fontsize=8, frameon=False)
