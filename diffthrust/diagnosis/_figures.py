"""Figures of a diagnosis: the error falling, the missing signal, the candidates."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np

from diffthrust._support.figures import BLUE, GREY, VERMILLION, literal, thinned
from diffthrust._support.tables import number
from diffthrust._support.words import percent, spelt
from diffthrust.comparison._figures_runs import draw_drive, drives_of
from diffthrust.diagnosis._words import stage_words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    from diffthrust.diagnosis._findings import Findings, Missing, Stage, TriedEffect
    from diffthrust.simulation._runs import Run

COLOURS = (BLUE, VERMILLION, "#009E73", "#CC79A7", "#E69F00", "#56B4E9")  # Okabe & Ito 2008
_PALE = "#B3D5E8"
BAND = 2.0
"""Half width of bands, in standard errors."""
_SHOWN = 8


def stages_figure(diag: Findings) -> Figure:
    """The errors at each stage on the left; on the right the first and the last model on a log.

    With one stage alone there is no error to see falling, and the left side is left out.

    Filled markers and full lines are unseen logs, open markers and broken lines training logs. The
    log is the unseen one that the model as given fits worst (a training log where there is none).
    """
    from matplotlib.figure import Figure

    before, after = _worst(diag)
    names = list(before.channels)
    several = len(diag.stages) > 1
    figure = Figure(figsize=(11.0, 1.2 + 2.6 * max(1, len(names))), layout="constrained")
    whole: Figure | SubFigure = figure
    if several:
        left, whole = figure.subfigures(1, 2, width_ratios=[1, 1.9], squeeze=False)[0]
        _falling(left.subplots(), diag)
    drives = drives_of(diag.model, [before])
    heights = [0.45] * len(drives) + [1.0] * len(names)
    axes = whole.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for panel, inputs in zip(axes, drives, strict=False):
        draw_drive(panel, before, inputs, first=True, static=False)
    for panel, name in zip(axes[len(drives) :], names, strict=True):
        _traces(panel, before, after if several else None, name)
    axes[-1].set_xlabel("time [s]", fontsize=9)
    kind = "unseen log" if diag.stages[0].holdout else "training log"
    axes[0].set_title(f"{kind} {literal(before.name)}", loc="left", fontsize=10)
    whole.legend(
        *axes[-1].get_legend_handles_labels(),
        loc="outside lower right",
        fontsize=8,
        ncols=3,
        frameon=False,
    )
    return figure


def missing_figure(diag: Findings, most: int = 2) -> Figure:
    """The missing signal at the ports that explain most: over time, and over what it depends on.

    Args:
        diag: the diagnosis; at least one signal of ``diag.missing`` shows.
        most: how many ports to show.
    """
    from matplotlib.figure import Figure

    shown = diag.shown([missing for missing in diag.missing if missing.shows][:most])
    figure = Figure(figsize=(11.0, 0.6 + 2.9 * len(shown)), layout="constrained")
    axes = figure.subplots(len(shown), 2, squeeze=False, width_ratios=[1.9, 1])
    for (left, right), missing in zip(axes, shown, strict=True):
        _over_time(left, missing)
        _over_signal(right, missing)
    return figure


def ranking_figure(diag: Findings) -> Figure:
    """Likelihood ratio of the best candidates of each stage; the added one is filled."""
    from matplotlib.figure import Figure

    stages = sorted({c.stage for c in diag.ranking})
    longest = max(sum(c.stage == stage for c in diag.ranking) for stage in stages)
    figure = Figure(figsize=(11.0, 1.1 + 0.28 * min(longest, _SHOWN)), layout="constrained")
    axes = figure.subplots(1, len(stages), squeeze=False)[0]
    for panel, stage in zip(axes, stages, strict=True):
        _bars(panel, [c for c in diag.ranking if c.stage == stage][:_SHOWN], diag)
        panel.set_title(f"tried at stage {stage}", loc="left", fontsize=10)
    return figure


def _worst(diag: Findings) -> tuple[Run, Run]:
    """The run with the largest error of the model as given, by it and by the last stage."""
    pairs = zip(diag.before.runs, diag.after.runs, strict=True)
    return max(
        (pair for pair in pairs if pair[0].channels),
        key=lambda pair: np.nan_to_num(pair[0].errors.nrmse, nan=-1.0),
    )


def _falling(panel: Axes, diag: Findings) -> None:
    where = np.arange(len(diag.stages))
    channels = dict.fromkeys(name for stage in diag.stages for name in stage.train.channels)
    top = 0.0
    for i, name in enumerate(channels):
        colour = COLOURS[i % len(COLOURS)]
        for unseen in (False, True):
            values = np.array([_nrmse(stage, name, unseen) for stage in diag.stages])
            if np.isnan(values).all():
                continue
            top = max(top, float(np.nanmax(np.where(np.isfinite(values), values, np.nan))))
            panel.plot(
                where,
                values,
                color=colour,
                marker="o" if unseen else "s",
                markersize=6,
                markerfacecolor=colour if unseen else "white",
                linestyle="-" if unseen else "--",
                linewidth=1.6 if unseen else 1.1,
                label=f"{spelt(name)}, {'unseen' if unseen else 'training'}",
            )
    panel.set_ylim(0.0, 1.12 * top if top > 0 else 1.0)
    panel.set_xlim(-0.4, len(where) - 0.6)
    many = len(where) > 3  # side by side their names would run into each other
    words = [textwrap.fill(stage_words(diag, int(i)), 24 if many else 16) for i in where]
    slanted = {"rotation": 35, "ha": "right", "rotation_mode": "anchor"} if many else {}
    panel.set_xticks(where, words, **slanted)
    panel.set_title("error by stage", loc="left", fontsize=10)
    panel.set_ylabel("NRMSE [-]", fontsize=9)
    panel.legend(fontsize=8, frameon=True, framealpha=0.9)
    plainly(panel)


def _nrmse(stage: Stage, name: str, unseen: bool) -> float:
    errors = stage.holdout if unseen else stage.train
    return errors.channels[name].nrmse if errors and name in errors.channels else np.nan


def _traces(panel: Axes, before: Run, after: Run | None, name: str) -> None:
    first = before.shown_channels[name]
    panel.plot(*thinned(before.time, first.measured), color=GREY, linewidth=2.6, label="measured")
    panel.plot(
        *thinned(before.time, first.modelled),
        color=VERMILLION,
        linewidth=1.1,
        linestyle="--",
        label="model as given",
    )
    unit = f" {first.unit}" if first.unit else ""
    sizes = [number(run.errors.channels[name].shown.value, 2) for run in (before, after) if run]
    panel.set_title(f"RMSE {', then '.join(sizes)}{unit}", loc="right", fontsize=9)
    if after:
        last = after.shown_channels[name]
        panel.plot(
            *thinned(after.time, last.modelled), color=BLUE, linewidth=1.1, label="last stage"
        )
    panel.set_ylabel(spelt(name) + (f" [{first.unit}]" if first.unit else ""), fontsize=9)
    panel.margins(x=0.01)
    plainly(panel)


def _over_time(panel: Axes, missing: Missing) -> None:
    index = max(range(len(missing.runs)), key=lambda i: np.mean(missing.runs[i][1] ** 2))
    time, signal, error = missing.runs[index]
    name = literal(missing.logs[index]) if missing.logs else f"training log {index + 1}"
    panel.fill_between(
        time,
        signal - BAND * error,
        signal + BAND * error,
        color=BLUE,
        alpha=0.25,
        linewidth=0,
        label=f"±{BAND:g} standard errors",
    )
    panel.plot(*thinned(time, signal), color=BLUE, linewidth=1.1, label="missing signal")
    panel.axhline(0.0, color="0.4", linewidth=0.8)
    panel.set_xlabel("time [s]", fontsize=9)
    panel.set_ylabel(_here(missing), fontsize=9)
    panel.set_title(f"missing at '{missing.port}', {name}", loc="left", fontsize=10)
    panel.legend(loc="upper right", fontsize=8, ncols=2, framealpha=0.9)
    panel.margins(x=0.01, y=0.2)
    plainly(panel)


def _here(missing: Missing) -> str:
    return f"{missing.port} [{missing.unit}]" if missing.unit else missing.port


def _over_signal(panel: Axes, missing: Missing) -> None:
    x, mean, error = missing.curve
    if missing.depends_on is None or x.size == 0:
        panel.set_axis_off()
        text = "no signal of the model explains it"
        panel.text(0.5, 0.5, text, ha="center", fontsize=9, transform=panel.transAxes)
        return
    panel.axhline(0.0, color="0.4", linewidth=0.8)
    panel.fill_between(
        x,
        mean - BAND * error,
        mean + BAND * error,
        color=VERMILLION,
        alpha=0.25,
        linewidth=0,
        label=f"±{BAND:g} standard errors",
    )
    panel.plot(x, mean, color=VERMILLION, linewidth=1.6, label="its mean")
    panel.legend(loc="upper right", fontsize=8, framealpha=0.9)
    panel.margins(y=0.2)
    unit = f" [{missing.dependence_unit}]" if missing.dependence_unit else ""
    panel.set_xlabel(f"{missing.depends_on}{unit}", fontsize=9)
    panel.set_ylabel(_here(missing), fontsize=9)
    panel.set_title(
        f"{missing.depends_on} explains {percent(missing.share)} of it", loc="left", fontsize=10
    )
    plainly(panel)


def _bars(panel: Axes, tried: list[TriedEffect], diag: Findings) -> None:
    later = diag.stages[tried[0].stage + 1 :][:1]
    added = {name for stage in later for name in stage.effects}
    alike = {name for group in diag.groups if added & {*group} for name in group}
    ratios = [max(c.likelihood_ratio, 0.0) for c in tried]
    where = np.arange(len(tried))
    panel.barh(
        where,
        ratios,
        color=[BLUE if c.effect in added else _PALE if c.effect in alike else "1" for c in tried],
        edgecolor=[BLUE if c.effect in added | alike else "0.5" for c in tried],
        height=0.65,
    )
    for y, ratio in zip(where, ratios, strict=True):
        text = f" {ratio:.0f}" if ratio >= 10 else f" {ratio:.1f}"
        panel.annotate(text, (ratio, y), va="center", fontsize=8)
    panel.set_yticks(where, [spelt(c.effect) for c in tried])
    panel.invert_yaxis()
    panel.set_xlim(0.0, 1.2 * max(ratios) or 1.0)
    panel.set_xlabel("likelihood ratio [-]", fontsize=9)
    plainly(panel)


def plainly(panel: Axes) -> None:
    panel.grid(True, color="0.9", linewidth=0.6)
    panel.set_axisbelow(True)
    panel.tick_params(labelsize=8)
    for side in ("top", "right"):
        panel.spines[side].set_visible(False)
