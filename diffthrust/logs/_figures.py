"""A log in a line, its channels as rows of a table, and over time below each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from diffthrust._support.figures import BLUE, is_sparse, literal, styled, thinned
from diffthrust._support.report import Report, Rows, Section
from diffthrust._support.words import number
from diffthrust.logs._edits import LogEdits
from diffthrust.logs._held import Hold
from diffthrust.logs._written import ShownUnits

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_FEW = 150
"""Samples up to which each has a mark."""
_GAP = 5.0
"""A step longer than this multiple of the median step is a gap."""
_MOST = 200
"""Gaps that are shaded."""
_SHADE = "#E69F00"


@dataclass(frozen=True)
class Panel:
    """One channel: stamps [s] and values, ``(n,)``; whether it drives, and keeps its value."""

    label: str
    unit: str
    time: np.ndarray
    values: np.ndarray
    driving: bool = False
    steps: bool = False


def line_of(log: LogEdits, duration: float, holds: Mapping[str, Hold]) -> str:
    """Its size, and its channels with their units."""
    display = ShownUnits([log.written])

    def described(channels: Mapping[str, np.ndarray]) -> str:
        texts = []
        for key, samples in channels.items():
            about = [f"{n} missing"] if (n := int(np.isnan(samples).sum())) else []
            about += ["unsigned"] if key in log.unsigned else []
            about += [f"{holds[key].readings} readings, repeated"] if key in holds else []
            unit = display.unit(key, log.units[key])
            texts.append(f"{key} [{unit}]" if unit else key)
            texts[-1] += f" ({', '.join(about)})" if about else ""
        return ", ".join(texts) or "none"

    return (
        f"Log({log.name!r}: {len(log)} samples over {duration:.6g} s, inputs: "
        f"{described(log.inputs)}; measured: {described(log.measured)})"
    )


def report_of(log: LogEdits, duration: float, step: float) -> Report:
    """Its size, its channels with their range, and its notes."""
    display, rows = ShownUnits([log.written]), []
    for name, samples in {**log.inputs, **log.measured}.items():
        valid = display.values(name, samples[np.isfinite(samples)], log.units[name])
        ends = [number(float(pick(valid)), 4) for pick in (np.min, np.mean, np.max)]
        kind = "input" if name in log.inputs else "measured"
        kind += ", unsigned" * (name in log.unsigned)
        unit = display.unit(name, log.units[name])
        rows.append((name, kind, *ends, unit, str(samples.size - valid.size)))
    headings = ("Channel", "", "Least", "Mean", "Greatest", "Unit", "Missing")
    size = f"Log {log.name!r}: {len(log)} samples over {duration:.6g} s, "
    size += f"a sample every {step:.4g} s"
    table = Rows.of(headings, rows, numbers=(2, 3, 4, 6))
    return Report(Section("", size, table, *log.notes))


def log_figure(log: LogEdits, measured: Mapping[str, np.ndarray]) -> Figure:
    """The inputs of a log on top, measured channels below, in the units in which it was written."""
    display, panels = ShownUnits([log.written]), []
    for channel, values in {**log.inputs, **measured}.items():
        driving = channel in log.inputs
        unit = display.unit(channel, log.units[channel])
        converted = display.values(channel, values, log.units[channel])
        steps = driving and log.hold.get(channel) == "zero"
        panels.append(Panel(channel, unit, log.time, converted, driving, steps))
    return panels_figure(panels, log.name)


def panels_figure(
    panels: Sequence[Panel], title: str, along: str = "time from the first sample [s]"
) -> Figure:
    """Panels below each other, on one time axis that is labelled ``along``; inputs come first."""
    from matplotlib.figure import Figure

    count = max(1, len(panels))
    tall = 1.7 if count < 6 else 1.25
    figure = Figure(figsize=(9.0, 0.8 + tall * count), layout="constrained")
    grid = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    start = min((float(panel.time[0]) for panel in panels if panel.time.size), default=0.0)
    shaded = False
    for axes, panel in zip(grid, panels, strict=False):
        shaded |= _draw(axes, replace(panel, time=panel.time - start))
    grid[-1].set_xlabel(along + "; shaded: no samples" * shaded, fontsize=9)
    figure.suptitle(literal(title), x=0.01, ha="left", fontsize=11, fontweight="bold")
    return figure


def _draw(axes: Axes, panel: Panel) -> bool:
    """One panel; whether there is a gap in it."""
    unit = f" [{panel.unit}]" if panel.unit else ""
    styled(axes, literal(f"{panel.label}{unit}"), "", "")
    finite = np.isfinite(panel.values)
    gaps = _gaps(panel.time)
    for k in gaps:
        axes.axvspan(
            float(panel.time[k]), float(panel.time[k + 1]), color=_SHADE, alpha=0.25, linewidth=0
        )
    if not finite.any():
        return bool(gaps.size)
    time, values = panel.time, panel.values
    sparse = is_sparse(panel.values)
    if sparse:  # its points are connected
        time, values = time[finite], values[finite]
    elif not panel.steps:
        # A NaN after the last sample before a gap interrupts the line across it.
        time, values = np.insert(time, gaps + 1, time[gaps]), np.insert(values, gaps + 1, np.nan)
    dotted = sparse or finite.sum() <= _FEW
    style: dict[str, Any] = {"marker": "o", "markersize": 2.5} if dotted else {}
    t, y = thinned(time, values)
    # Thinned points are the extremes of stretches, and steps between those would show false levels.
    style["drawstyle"] = "steps-post" if panel.steps and t.size == time.size else "default"
    axes.plot(t, y, color="0.2" if panel.driving else BLUE, linewidth=1.0, **style)
    if np.ptp(values[np.isfinite(values)]) == 0:
        # The axis of a constant would magnify its rounding errors.
        axes.margins(y=0.3)
    return bool(gaps.size)


def _gaps(time: np.ndarray) -> np.ndarray:
    """The samples before steps many times the median one."""
    steps = np.diff(time)
    if steps.size < 3:
        return np.zeros(0, int)
    return np.flatnonzero(steps > _GAP * np.median(steps))[:_MOST]
