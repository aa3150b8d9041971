"""The figure of a closed loop's run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from diffthrust._support.figures import BLUE, GREY, VERMILLION, styled, thinned
from diffthrust.control._faults import Change

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from diffthrust.control._loop_result import LoopRun

_WIDE = {"color": GREY, "linewidth": 2.4}
_THIN = {"color": VERMILLION, "linewidth": 1.1}
_OTHER = {"color": BLUE, "linewidth": 1.1}
_ESTIMATES = "_estimate"


def run_figure(run: LoopRun) -> Figure:
    """One panel each for what is followed, the error, thrust, command, speed, and estimates."""
    from matplotlib.figure import Figure

    of = run.loop.controller.of
    estimates = [name for name in run.signals if name.endswith(_ESTIMATES)]
    panels = [(of, ("reference", of)), ("error", ("error",))]
    if "wanted_thrust" in run.signals:
        panels.append(("thrust", ("wanted_thrust", "thrust")))
    same = np.array_equal(run["command"], run["motor_command"])
    panels.append(("command", ("command",) if same else ("command", "motor_command")))
    if of != "speed" and "speed" in run.signals:
        panels.append(("speed", ("compensator.wanted_speed", "speed")))
    panels += [(name.removeprefix("compensator."), (name,)) for name in estimates]
    figure = Figure(figsize=(8.0, 0.8 + 1.9 * len(panels)), layout="constrained")
    rows = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (label, names) in zip(rows, panels, strict=True):
        _draw(axes, run, label, tuple(name for name in names if name in run.signals))
        axes.tick_params(labelbottom=False)
    rows[-1].tick_params(labelbottom=True)
    rows[-1].set_xlabel("time [s]", fontsize=9)
    parts = (run.loop.controller, run.loop.compensator)
    title = ", ".join(type(part).__name__ for part in parts if part is not None)
    if run.diverged is not None:
        title += f": ran away at {run.diverged:.3g} s"
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
    return figure


def _draw(axes: Axes, run: LoopRun, label: str, names: tuple[str, ...]) -> None:
    styles = (_WIDE, _THIN) if len(names) == 2 else (_OTHER,)
    for name, style in zip(names, styles, strict=True):
        axes.plot(
            *thinned(run.time, run[name]),
            label=name.removeprefix("compensator.").replace("_", " "),
            **style,
        )
    for fault in run.loop.faults:  # pyright: ignore[reportGeneralTypeIssues]
        if fault.at <= run.time[-1]:
            axes.axvline(fault.at, color="0.4", linewidth=0.8, linestyle=":")
            if label == run.loop.controller.of:
                word = "change" if isinstance(fault, Change) else type(fault).__name__.lower()
                axes.annotate(f" {word}", (fault.at, 0.97), xycoords=("data", "axes fraction"),
                              va="top", fontsize=8, color="0.4")  # fmt: skip
    unit = run.units[names[-1]]
    styled(axes, "", "", f"{label.replace('_', ' ')}" + (f"\n[{unit}]" if unit else ""))
    if len(names) == 2:
        axes.legend(loc="lower right", bbox_to_anchor=(1, 1), fontsize=8, frameon=False, ncols=2)
