"""The figures of closed loops: signals over time, and a vessel's run along a path."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from diffthrust._support.figures import BLUE, GREY, VERMILLION, styled, thinned
from diffthrust.control._controllers import Block, Controller
from diffthrust.control._faults import Change, Fault
from diffthrust.control._mpc import MPC
from diffthrust.control._recorded import RunSignals
from diffthrust.logs._units import convert
from diffthrust.models._base.model import Model

_WIDE = {"color": GREY, "linewidth": 2.4}
_THIN = {"color": VERMILLION, "linewidth": 1.1}
_OTHER = {"color": BLUE, "linewidth": 1.1}
_ESTIMATES = "_estimate"
_SHOWN = {"rad": "deg"}
"""Units that a person reads more easily than those of the model."""


def run_figure(
    run: RunSignals, blocks: Sequence[Block], faults: Sequence[Fault], units: Mapping[str, str]
) -> Figure:
    """One panel each for what is followed, the error, thrust, command, speed, and estimates.

    The first of the blocks is the controller.
    """
    assert isinstance(blocks[0], Controller)
    of = blocks[0].of
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
    for axes, (label, signals) in zip(rows, panels, strict=True):
        names = tuple(name for name in signals if name in run.signals)
        _panel(axes, run, names, f"{label.replace('_', ' ')}", units[names[-1]])
        for fault in (fault for fault in faults if fault.at <= run.time[-1]):
            axes.axvline(fault.at, color="0.4", linewidth=0.8, linestyle=":")
            if label == of:
                word = "change" if isinstance(fault, Change) else type(fault).__name__.lower()
                axes.annotate(f" {word}", (fault.at, 0.97), xycoords=("data", "axes fraction"),
                              va="top", fontsize=8, color="0.4")  # fmt: skip
        axes.tick_params(labelbottom=axes is rows[-1])
    rows[-1].set_xlabel("time [s]", fontsize=9)
    return _titled(figure, ", ".join(type(block).__name__ for block in blocks), run)


def _panel(axes: Axes, run: RunSignals, names: tuple[str, ...], label: str, unit: str) -> None:
    styles = (_WIDE, _THIN) if len(names) == 2 else (_OTHER,)
    for name, style in zip(names, styles, strict=True):
        shown = name.removeprefix("compensator.").replace("_", " ")
        axes.plot(*thinned(run.time, run[name]), label=shown, **style)
    styled(axes, "", "", label + (f"\n[{unit}]" if unit else ""))
    if len(names) == 2:
        _legend(axes, 2)


def track_figure(run: RunSignals, vessel: Model, mpc: MPC) -> Figure:
    """The path over the water on top; errors, what has limits, and what was estimated below."""
    limited = list(mpc.limits)
    estimating = mpc.disturbance is not None
    below = 1 + len(limited) + estimating
    figure = Figure(figsize=(8.0, 3.4 + 1.8 * below), layout="constrained")
    grid = figure.add_gridspec(1 + below, 1, height_ratios=[2.0] + [1.0] * below)
    _over_the_water(figure.add_subplot(grid[0]), run, mpc.point)
    first = figure.add_subplot(grid[1])
    errors = {"along": "along (ahead +)", "across": "across (starboard +)"}
    _lines(first, run, errors, "error\n[m]")
    first.axhline(0.0, color="0.4", linewidth=0.6)
    rows = [figure.add_subplot(grid[2 + i], sharex=first) for i in range(below - 1)]
    for axes, name in zip(rows, limited, strict=False):
        _limited(axes, run, vessel, name, mpc.limits[name])
    if estimating:
        units = {"north": "m/s²", "east": "m/s²", "yaw": "rad/s²"}
        pushes = {f"push.{name}": f"{name} [{unit}]" for name, unit in units.items()}
        _lines(rows[-1], run, pushes, "unexplained\nacceleration")
    for axes in (first, *rows)[:-1]:
        axes.tick_params(labelbottom=False)
    (first, *rows)[-1].set_xlabel("time [s]", fontsize=9)
    return _titled(figure, f"{vessel} under MPC", run)


def _titled(figure: Figure, title: str, run: RunSignals | None = None) -> Figure:
    if run is not None and run.diverged is not None:
        title += f": ran away at {run.diverged:.3g} s"
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
    return figure


def _lines(axes: Axes, run: RunSignals, names: Mapping[str, str], label: str) -> None:
    """Signals by name with their labels."""
    styles = (_OTHER, _THIN, {"color": "0.3", "linewidth": 1.1, "linestyle": ":"})
    for (name, words), style in zip(names.items(), styles, strict=False):
        axes.plot(run.time, run[name], label=words, **style)
    styled(axes, "", "", label)
    _legend(axes, len(names))


def _legend(axes: Axes, columns: int) -> None:
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1), fontsize=8, frameon=False, ncols=columns)


def _over_the_water(axes: Axes, run: RunSignals, point: float) -> None:
    axes.plot(run["reference.east"], run["reference.north"], label="path", **_WIDE)
    east, north = run["point.east"], run["point.north"]
    name = "control point" if point else "vessel"
    axes.plot(east, north, color=VERMILLION, linewidth=1.2, label=name)
    axes.plot(east[0], north[0], "o", color=VERMILLION, markersize=5, label="start")
    axes.set_aspect("equal", adjustable="datalim")
    styled(axes, "", "east [m]", "north [m]")
    axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))


def _limited(
    axes: Axes, run: RunSignals, vessel: Model, name: str, limits: tuple[float, float]
) -> None:
    """An input, which is held between samples, or a state."""
    unit = {**vessel.all_states, **vessel.inputs}[name]
    shown = _SHOWN.get(unit, unit)
    values = convert(run[name], unit, shown, where=name)
    held = name in vessel.inputs
    axes.plot(run.time, values, color=BLUE, linewidth=1.1,
              drawstyle="steps-post" if held else "default")  # fmt: skip
    for limit in filter(math.isfinite, limits):
        axes.axhline(float(convert(np.asarray(float(limit)), unit, shown, where=name)), color="0.3",
                     linewidth=0.9, linestyle="--")  # fmt: skip
    styled(axes, "", "", f"{name.replace('_', ' ')}\n[{shown}], limits dashed")


def allocation_figure(
    title: str, axes: Sequence[str], as_is: Mapping[str, np.ndarray], corrected: np.ndarray
) -> Figure:
    """A panel for each command: what it does along each axis, as it is and corrected."""
    rows, height = (len(as_is) + 1) // 2, 0.8 + 0.32 * len(axes)
    figure = Figure(figsize=(8.0, 0.8 + height * rows), layout="constrained")
    grid = figure.subplots(rows, 2, sharex=True, squeeze=False)
    panels = list(grid.flat)
    names = [n if n in as_is else f"{n} (no command)" for n in axes]
    places = np.arange(len(axes))
    for panel, (command, shares), after in zip(panels, as_is.items(), corrected.T, strict=False):
        panel.barh(places - 0.18, shares, 0.32, color=VERMILLION, label="as it is")
        panel.barh(places + 0.18, after, 0.32, color=BLUE, label="corrected")
        panel.set_yticks(places, names, fontsize=8)
        panel.tick_params(labelsize=8, labelbottom=True)
        panel.invert_yaxis()
        panel.axvline(0.0, color=GREY, linewidth=0.8)
        panel.set_title(f"{command} command", loc="left", fontsize=9)
        panel.spines[["top", "right"]].set_visible(False)
    for panel in panels[len(as_is) :]:
        panel.set_visible(False)
    panels[0].legend(fontsize=8, frameon=False)
    figure.supxlabel("acts as a command of", fontsize=9)
    return _titled(figure, title)
