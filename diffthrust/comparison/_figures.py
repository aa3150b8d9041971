"""Figures of a comparison: runs, measured and modelled; and residuals, where they are large."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from diffthrust._support.envelope import stretches
from diffthrust._support.figures import (
    BLUE,
    GREY,
    VERMILLION,
    is_sparse,
    literal,
    styled,
    thinned,
    unboxed,
)
from diffthrust.comparison._derived_signals import derived_of
from diffthrust.comparison._regimes import Regime
from diffthrust.comparison._residual_tests import ResidualTests
from diffthrust.models._base.model import Model
from diffthrust.simulation._record import are_tables
from diffthrust.simulation._runs import Run, Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS = 3
_COLOURS, _STYLES = ("0.15", VERMILLION, BLUE), ("-", "--", ":")
_DRIVES = [(_COLOURS[k % 3], _STYLES[(k + k // 3) % 3]) for k in range(9)]
"""Of inputs in one plot: no two alike among the commands of a craft with eight thrusters."""
_LINES = ("measured", "modelled", "measured - modelled")


def comparison_figure(model: Model, runs: Sequence[Run]) -> Figure:
    """What drove each run on top; below, for each channel, measured, modelled and the residual.

    One column for each run; after three runs a new block of rows begins. Long runs are thinned to
    the extremes of every stretch, so that no spike is lost.
    """
    runs = [run for run in runs if run.channels]
    channels = list(dict.fromkeys(name for run in runs for name in run.channels))
    across = max(1, min(_COLUMNS, len(runs)))
    blocks = max(1, -(-len(runs) // across))
    drives = drives_of(model, runs)
    heights = [1.3] * len(drives) + [3, 1.3] * max(1, len(channels))
    figure = _figure(1.6 + 5.6 * across, 1.0 + 0.72 * blocks * sum(heights), h_pad=0.05)
    grid = figure.add_gridspec(blocks * len(heights), across, height_ratios=heights * blocks)
    limits = {
        name: _common([run.shown_channels[name] for run in runs if name in run.channels])
        for name in channels
    }
    for i, run in enumerate(runs):
        block, column = divmod(i, across)
        rows = [
            grid[row, column] for row in range(block * len(heights), (block + 1) * len(heights))
        ]
        first = column == 0
        static = are_tables([run.record])
        shared = None
        for row, names in zip(rows, drives, strict=False):
            driven = figure.add_subplot(row, sharex=shared)
            draw_drive(driven, run, names, first, static)
            if shared is None:
                driven.set_title(literal(run.name), loc="left", fontsize=9)
            shared = shared or driven
        last = [name for name in channels if name in run.channels][-1]
        pairs = zip(channels, rows[len(drives) :: 2], rows[len(drives) + 1 :: 2], strict=True)
        for name, upper, lower in pairs:
            if name not in run.channels:
                continue
            top = figure.add_subplot(upper, sharex=shared)
            shared = shared or top
            below = figure.add_subplot(lower, sharex=shared)
            _pair(top, below, run, name, static)
            below.set_ylim(-limits[name], limits[name])
            _label(top, below, name, run, first, name == last, static)
            if shared is top:
                words = f"{literal(run.name)}\n{top.get_title('left')}"
                top.set_title(words, loc="left", fontsize=9)
    _legend(figure, model)
    return figure


def _figure(width: float, height: float, h_pad: float) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.08, h_pad=h_pad)  # pyright: ignore
    return figure


def _legend(figure: Figure, model: Model) -> None:
    lines = {str(line.get_label()): line for axes in figure.axes for line in axes.get_lines()}
    if handles := [lines[word] for word in _LINES if word in lines]:
        figure.legend(
            handles=handles,
            title=textwrap.fill(str(model), 60),
            title_fontproperties={"weight": "bold", "size": 13},
            alignment="left",
            loc="outside upper left",
            ncols=3,
            frameon=False,
        )


def drives_of(model: Model, runs: Sequence[Run]) -> list[list[str]]:
    """The inputs that drove the runs, those of one unit together."""
    groups: dict[str, list[str]] = {}
    for name, unit in model.inputs.items():
        shown = [run.shown.unit(name, unit) for run in runs if name in run.log.inputs]
        if shown:
            groups.setdefault(shown[0], []).append(name)
    return list(groups.values())


def draw_drive(axes: Axes, run: Run, names: Sequence[str], first: bool, static: bool) -> None:
    """The inputs of a run, as they were written; a held one is drawn in steps."""
    names = [name for name in names if name in run.log.inputs]
    for name, (colour, style) in zip(names, cycle(_DRIVES), strict=False):
        values = run.shown.values(name, run.signals[name], run.units[name])
        held = run.log.hold[name] == "zero" and not static
        axes.plot(
            *thinned(run.time, values),
            color=colour,
            linestyle="none" if static else style,
            marker="." if static else "",
            linewidth=1.0,
            drawstyle="steps-post" if held else "default",
            label=f"_{name}",
        )
    unit = run.shown.unit(names[0], run.units[names[0]]) if names else ""
    what, labels = _drive_words(names)
    if first:
        axes.set_ylabel(what + (f"\n[{unit}]" if unit else ""), fontsize=8)
    if len(names) > 1:
        place: dict[str, Any] = {"loc": "upper right", "ncols": 3}
        if len(names) > 3:  # above, where it covers no line
            place = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.98), "handlelength": 1.4}
            place["ncols"] = min(len(names), 8)
        axes.legend(axes.get_lines(), labels, fontsize=7, frameon=False, **place)
    unboxed(axes)
    axes.tick_params(labelbottom=False)


def _drive_words(names: Sequence[str]) -> tuple[str, list[str]]:
    """What stands at the axis of some inputs, and each one's name: "command" of t1, t2, ..."""
    parts = {name.rpartition(".")[2] for name in names}
    owners = [name.rpartition(".")[0] for name in names]
    if len(names) > 1 and len(parts) == 1 and all(owners):
        return parts.pop(), owners
    return " / ".join(names), list(names)


def _pair(top: Axes, below: Axes, run: Run, name: str, static: bool) -> None:
    trace = run.shown_channels[name]
    few = static or np.isfinite(trace.measured).sum() <= 150 or is_sparse(trace.measured)
    dots = "o" if few else ""
    below.axhline(0.0, color="0.4", linewidth=0.8)
    for axes, values, label, color, width, marker, size in (
        (top, trace.measured, "measured", GREY, 2.4, dots, 5),
        (top, trace.modelled, "modelled", VERMILLION, 1.1, "x" if static else "", 5),
        (below, trace.residual, "measured - modelled", BLUE, 0.8, dots, 3),
    ):
        style: dict[str, Any] = {"color": color, "linewidth": width, "markersize": size}
        style |= {"marker": marker, "linestyle": "none"} if marker else {}
        axes.plot(*thinned(run.time, values), label=label, **style)


def _label(
    top: Axes, below: Axes, name: str, run: Run, first: bool, last: bool, static: bool
) -> None:
    trace, error = run.shown_channels[name], run.errors.channels.get(name)
    if error is not None:
        size = f"RMSE {error.shown.value:.3g} {error.shown.unit}".rstrip()
        percent = f"{round(error.fit_percent, 1) + 0.0:.1f} %"
        words = f"{name}: {size}, NRMSE {error.nrmse:.3g}, fit {percent}"
        top.set_title(words, loc="left", fontsize=9)
    for axes, label in ((top, name), (below, "residual")):
        if first:
            axes.set_ylabel(labelled(label, trace.unit), fontsize=9)
        unboxed(axes)
    top.tick_params(labelbottom=False)
    if last:
        below.set_xlabel(_horizontal(static), fontsize=9)


def _common(traces: Sequence[Trace]) -> float:
    """One limit for the residuals of a channel, so that runs can be compared by eye."""
    finite = [trace.residual[np.isfinite(trace.residual)] for trace in traces]
    largest = max(float(np.abs(values).max(initial=0.0)) for values in finite)
    return 1.1 * largest if 0 < largest < 1e300 else 1.0


_SHADE = "#F0E442"  # Okabe & Ito's yellow, behind everything
_SHOWN = 4000
_Derived = tuple[Run, Mapping[str, tuple[np.ndarray, str]]]
"""A run with its signals and what follows from them, by name with their units."""


def residual_figure(
    model: Model,
    runs: Sequence[Run],
    channels: Sequence[str],
    regimes: Sequence[Regime],
    tests: Mapping[str, ResidualTests],
) -> Figure:
    """One row for each channel: residual in time, against a signal, and its correlations.

    The worst regime of the channel is shaded. The run in time is the one with the largest error;
    tables of readings have no tests.
    """
    tabular = are_tables(run.record for run in runs)
    derived = [(run, derived_of(model, run, tabular=tabular)) for run in runs]
    across = 2 if tabular else 4
    figure = _figure(4.4 * across, 0.9 + 3.5 * len(channels), h_pad=0.08)
    panels = figure.subplots(len(channels), across, squeeze=False)
    for row, name in zip(panels, channels, strict=True):
        regime = next((r for r in regimes if r.channel == name), None)
        having = [pair for pair in derived if name in pair[0].channels]
        _in_time(row[0], having, name, regime, tabular)
        _against_signal(row[1], having, name, regime)
        for axes, draw in zip(row[2:], (_autocorrelation, _cross_correlation), strict=False):
            if name in tests:
                draw(axes, tests[name])
            else:
                axes.set_axis_off()
    title = textwrap.fill(f"{model}: residuals (measured - modelled)", 100)
    figure.suptitle(title, x=0.01, ha="left", fontsize=12, fontweight="bold")
    return figure


def _in_time(
    axes: Axes, having: Sequence[_Derived], name: str, regime: Regime | None, tabular: bool
) -> None:
    measured = [pair for pair in having if name in pair[0].errors.channels]
    run, derived = max(measured, key=lambda pair: pair[0].errors.channels[name].rmse)
    axes.axhline(0.0, color="0.4", linewidth=0.8)
    if regime is not None:
        after = np.append(run.time[1:], run.time[-1])
        for begin, end in stretches(regime.holds(derived)):
            _shade(axes, float(run.time[begin]), float(after[end - 1]))
    residual = run.shown_channels[name].residual
    style = "." if is_sparse(residual) else "-"
    axes.plot(*thinned(run.time, residual), style, color=BLUE, linewidth=0.9)
    which = f"{literal(run.name)}{', the worst run' if len(measured) > 1 else ''}"
    label = labelled("residual", run.shown_channels[name].unit)
    styled(axes, f"{name}\n{which}", _horizontal(tabular), label)


def _against_signal(
    axes: Axes, having: Sequence[_Derived], name: str, regime: Regime | None
) -> None:
    signal = regime.signal if regime else next(iter(having[0][1]))
    unit = having[-1][1][signal][1]
    across = np.concatenate([derived[signal][0] for _, derived in having])
    residual = np.concatenate([run.shown_channels[name].residual for run, _ in having])
    stride = -(-across.size // _SHOWN)
    axes.axhline(0.0, color="0.4", linewidth=0.8)
    title = "no regime stands out from chance"
    if regime is not None:
        _shade(axes, *np.clip((regime.low, regime.high), across.min(), across.max()))
        title = textwrap.fill(regime.sentence, 46)
    kept = np.isfinite(residual)
    axes.plot(across[kept][::stride], residual[kept][::stride], ".", color=BLUE, markersize=2.5)
    label = labelled("residual", having[0][0].shown_channels[name].unit)
    styled(axes, title, labelled(signal, unit), label)


def _autocorrelation(axes: Axes, tests: ResidualTests) -> None:
    shown = max(20, int(np.ceil(4 * tests.correlation_time / tests.step)))
    values = tests.autocorrelation[: shown + 1]
    lags = np.arange(values.size) * tests.step
    band = 1.96 / np.sqrt(tests.samples)
    _band(axes, band, "95 % of white noise")
    axes.plot(lags, values, color=BLUE, linewidth=1.2)
    axes.set_ylim(min(-0.3, 1.1 * float(values.min())), 1.08)
    title = f"correlated over {tests.correlation_time:.2g} s" if not tests.white else "white"
    styled(axes, f"Autocorrelation: {title}", "lag [s]", "correlation")


def _cross_correlation(axes: Axes, tests: ResidualTests) -> None:
    if not tests.signals:
        axes.set_axis_off()
        return
    most = max(tests.signals.values(), key=lambda s: abs(s.peak) / s.band)
    _band(axes, most.band, "95 % where unrelated")
    axes.axvline(0.0, color=GREY, linewidth=0.8)
    axes.plot(most.lags, most.values, color=VERMILLION, linewidth=1.2)
    reach = 1.25 * max(abs(most.peak), most.band)
    axes.set_ylim(-reach, 1.2 * reach)
    title = "related" if most.related else "no signal is related"
    label = f"lag of the residual behind {most.signal} [s]"
    styled(axes, f"Correlation with {most.signal}:\n{title}", label, "correlation")


def _band(axes: Axes, band: float, words: str) -> None:
    """Where a correlation stays by chance, and zero."""
    shade = axes.axhspan(-band, band, color="0.85", linewidth=0, label=words)
    axes.axhline(0.0, color="0.4", linewidth=0.8)
    axes.legend(handles=[shade], fontsize=8, frameon=False, loc="upper right")


def _shade(axes: Axes, low: float, high: float) -> None:
    axes.axvspan(low, high, color=_SHADE, alpha=0.45, linewidth=0, zorder=0)


def labelled(name: str, unit: str) -> str:
    """A name with its unit, if it has one, as it stands at an axis."""
    return f"{name} [{unit}]" if unit else name


def _horizontal(static: bool) -> str:
    return "sample" if static else "time [s]"
