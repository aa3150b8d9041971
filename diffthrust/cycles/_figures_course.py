"""Figure of a thruster loop's course from rest (Yoerger et al. 1990, figure 14)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from diffthrust._support.figures import BLUE, GREY, VERMILLION, styled
from diffthrust.cycles._oscillation import LoopCourse

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def course_figure(course: LoopCourse, levels: Mapping[str, float], title: str) -> Figure:
    """Command and thrust over time, with what the formulas and the balance say of the peak."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 4.4), layout="constrained")
    axes = figure.add_subplot()
    axes.plot(course.time, course.output, color=GREY, linewidth=1.6, label="thrust")
    axes.plot(course.time, course.input, color=BLUE, linewidth=1.3, label="command")
    for style, (name, level) in zip((":", "--", "-"), levels.items(), strict=False):
        for side in (level, -level):
            axes.axhline(
                side,
                color=VERMILLION,
                linestyle=style,
                linewidth=0.9,
                label=f"{name}: {level:.2f} N" if side > 0 else "",
            )
    styled(axes, title, "time [s]", "force [N]")
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=8.5)
    return figure
