"""Figures of a diagnosis: errors by stage, missing signals, candidates, learned laws.

All are made as `Figure` objects, without pyplot: pages are also written where nobody could see a
window, and from threads, and pyplot would keep every figure alive.
"""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

from diffthrust._support.figures import (
    BLUE,
    COLOURS,
    GREY,
    VERMILLION,
    is_sparse,
    literal,
    thinned,
    unboxed,
)
from diffthrust._support.words import humanize, number, percent
from diffthrust.comparison._figures import draw_drive, drives_of, labelled
from diffthrust.diagnosis._findings import Findings, Stage, TriedEffect
from diffthrust.diagnosis._learned import LearnedLaw, TriedForm
from diffthrust.diagnosis._missing import Missing
from diffthrust.diagnosis._report.learned import form_over, manner_words, signal_words
from diffthrust.diagnosis._report.text import stage_words
from diffthrust.models._base.made_effect import ARRIVING
from diffthrust.simulation._runs import Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

_PALE = "#B3D5E8"
_BAND = 2.0
"""Half width of bands, in standard errors."""
_PORTS = 2
"""Ports at which the missing signal is drawn."""
_CANDIDATES = 8
"""Bars of a stage in the ranking."""
_BINS = 60
"""Bins of the histogram below a learned curve."""
_TITLE = 85
"""Characters in a line of a title."""
_FOLLOWS = 0.01
"""A factor is a function of the signal where that leaves less than this share of its variance."""
_WORSE = 2.0
"""Forms whose error over whole runs exceeds this multiple of the best one are not drawn."""
_LEAST_FACTOR = 0.05
"""A form of the whole law is divided by its factor where that exceeds this share of its largest."""


def stages_figure(diag: Findings) -> Figure:
    """The errors at each stage on the left; on the right the first and the last model on a log.

    With one stage alone there is no error to see falling, and the left side is left out.

    Filled markers and full lines are unseen logs, open markers and broken lines training logs. The
    log is the unseen one that the model as given fits worst (a training log where there is none).
    """
    baseline, updated = _worst(diag)
    names = list(baseline.channels)
    several = len(diag.stages) > 1
    figure = _figure(1.2 + 2.6 * max(1, len(names)))
    traces: Figure | SubFigure = figure
    if several:
        falling, traces = figure.subfigures(1, 2, width_ratios=[1, 1.9], squeeze=False)[0]
        _falling(falling.subplots(), diag)
    drives = drives_of(diag.model, [baseline])
    heights = [0.45] * len(drives) + [1.0] * len(names)
    axes = traces.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for panel, inputs in zip(axes, drives, strict=False):
        draw_drive(panel, baseline, inputs, first=True, static=False)
    for panel, name in zip(axes[len(drives) :], names, strict=True):
        _traces(panel, baseline, updated if several else None, name)
    axes[-1].set_xlabel("time [s]", fontsize=9)
    kind = "unseen log" if diag.stages[0].holdout else "training log"
    axes[0].set_title(f"{kind} {literal(baseline.name)}", loc="left", fontsize=10)
    lines = axes[-1].get_legend_handles_labels()
    traces.legend(*lines, loc="outside lower right", fontsize=8, ncols=3, frameon=False)
    return figure


def missing_figure(diag: Findings) -> Figure:
    """The missing signal at the ports that explain most: over time, and over what it depends on.

    At least one signal of ``diag.missing`` shows.
    """
    signals = diag.shown([missing for missing in diag.missing if missing.shows][:_PORTS])
    figure = _figure(0.6 + 2.9 * len(signals))
    axes = figure.subplots(len(signals), 2, squeeze=False, width_ratios=[1.9, 1])
    for (time_panel, signal_panel), missing in zip(axes, signals, strict=True):
        _over_time(time_panel, missing)
        _over_signal(signal_panel, missing)
    return figure


def ranking_figure(diag: Findings) -> Figure:
    """Likelihood ratio of the best candidates of each stage; the added one is filled."""
    stages = sorted({c.stage for c in diag.ranking})
    longest = max(sum(c.stage == stage for c in diag.ranking) for stage in stages)
    figure = _figure(1.1 + 0.28 * min(longest, _CANDIDATES))
    axes = figure.subplots(1, len(stages), squeeze=False)[0]
    for panel, stage in zip(axes, stages, strict=True):
        _bars(panel, [c for c in diag.ranking if c.stage == stage][:_CANDIDATES], diag)
    return figure


def learned_figure(diag: Findings) -> Figure:
    """A column for each learned law: the curve above, below it how often the logs were there."""
    count = len(diag.laws)
    figure = _figure(5.2, width=7.5 * count)
    axes = figure.subplots(2, count, squeeze=False, sharex="col", height_ratios=[3.2, 1])
    for (curve, density), law in zip(axes.T, diag.laws, strict=True):
        _curve(curve, law)
        density.hist(law.shown.value * law.samples, bins=_BINS, color=GREY)
        _dress(density, labelled(signal_words(law), law.place_unit), "samples")
    return figure


def _figure(height: float, width: float = 11.0) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def _dress(panel: Axes, x: str = "", y: str = "", title: str = "") -> None:
    panel.set_xlabel(x, fontsize=9)
    panel.set_ylabel(y, fontsize=9)
    panel.set_title(title, loc="left", fontsize=10)
    unboxed(panel)


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
            style = {"color": colour, "linestyle": "--", "linewidth": 1.1, "marker": "s"}
            if unseen:
                style |= {"linestyle": "-", "linewidth": 1.6, "marker": "o"}
            label = f"{humanize(name)}, {'unseen' if unseen else 'training'}"
            face = colour if unseen else "white"
            panel.plot(where, values, markersize=6, markerfacecolor=face, label=label, **style)
    panel.set_ylim(0.0, 1.12 * top if top > 0 else 1.0)
    panel.set_xlim(-0.4, len(where) - 0.6)
    many = len(where) > 3  # side by side their names would run into each other
    words = [textwrap.fill(stage_words(diag, int(i)), 24 if many else 16) for i in where]
    slanted = {"rotation": 35, "ha": "right", "rotation_mode": "anchor"} if many else {}
    panel.set_xticks(where, words, **slanted)
    panel.legend(fontsize=8, frameon=True, framealpha=0.9)
    _dress(panel, y="NRMSE [-]", title="error by stage")


def _nrmse(stage: Stage, name: str, unseen: bool) -> float:
    errors = stage.holdout if unseen else stage.train
    return errors.channels[name].nrmse if errors and name in errors.channels else np.nan


def _traces(panel: Axes, baseline: Run, updated: Run | None, name: str) -> None:
    first = baseline.shown_channels[name]
    style: dict[str, Any] = {"color": GREY, "linewidth": 2.6, "label": "measured"}
    if is_sparse(first.measured):
        style |= {"marker": "o", "markersize": 4, "linestyle": "none"}
    panel.plot(*thinned(baseline.time, first.measured), **style)
    panel.plot(
        *thinned(baseline.time, first.modelled), color=VERMILLION, linewidth=1.1, linestyle="--",
        label="model as given",
    )  # fmt: skip
    unit = f" {first.unit}" if first.unit else ""
    sizes = [number(run.errors.channels[name].shown.value, 2) for run in (baseline, updated) if run]
    panel.set_title(f"RMSE {', then '.join(sizes)}{unit}", loc="right", fontsize=9)
    if updated:
        last = thinned(updated.time, updated.shown_channels[name].modelled)
        panel.plot(*last, color=BLUE, linewidth=1.1, label="last stage")
    _dress(panel, y=labelled(humanize(name), first.unit))


def _banded(panel: Axes, x: np.ndarray, mean: np.ndarray, error: np.ndarray, colour: str) -> None:
    low, high = mean - _BAND * error, mean + _BAND * error
    label = f"±{_BAND:g} standard errors"
    panel.axhline(0.0, color="0.4", linewidth=0.8)
    panel.fill_between(x, low, high, color=colour, alpha=0.25, linewidth=0, label=label)


def _over_time(panel: Axes, missing: Missing) -> None:
    index = max(range(len(missing.runs)), key=lambda i: np.mean(missing.runs[i][1] ** 2))
    time, signal, error = missing.runs[index]
    name = literal(missing.logs[index]) if missing.logs else f"training log {index + 1}"
    _banded(panel, time, signal, error, BLUE)
    panel.plot(*thinned(time, signal), color=BLUE, linewidth=1.1, label="missing signal")
    panel.legend(loc="upper right", fontsize=8, ncols=2, framealpha=0.9)
    panel.margins(y=0.2)
    title = f"missing at '{missing.port}', {name}"
    _dress(panel, "time [s]", labelled(missing.port, missing.unit), title)


def _over_signal(panel: Axes, missing: Missing) -> None:
    x, mean, error = missing.curve
    if missing.depends_on is None or x.size == 0:
        panel.set_axis_off()
        text = "no signal of the model explains it"
        panel.text(0.5, 0.5, text, ha="center", fontsize=9, transform=panel.transAxes)
        return
    _banded(panel, x, mean, error, VERMILLION)
    panel.plot(x, mean, color=VERMILLION, linewidth=1.6, label="its mean")
    panel.legend(loc="upper right", fontsize=8, framealpha=0.9)
    panel.margins(y=0.2)
    title = f"{missing.depends_on} explains {percent(missing.share)} of it"
    place = labelled(missing.depends_on, missing.dependence_unit)
    _dress(panel, place, labelled(missing.port, missing.unit), title)


def _bars(panel: Axes, tried: list[TriedEffect], diag: Findings) -> None:
    following = diag.stages[tried[0].stage + 1 :][:1]
    added = {name for stage in following for name in stage.effects}
    equivalent = {name for group in diag.groups if added & {*group} for name in group}
    ratios = [max(c.likelihood_ratio, 0.0) for c in tried]
    where = np.arange(len(tried))
    fills = [BLUE if c.effect in added else _PALE if c.effect in equivalent else "1" for c in tried]
    edges = [BLUE if c.effect in added | equivalent else "0.5" for c in tried]
    panel.barh(where, ratios, color=fills, edgecolor=edges, height=0.65)
    for y, ratio in zip(where, ratios, strict=True):
        text = f" {ratio:.0f}" if ratio >= 10 else f" {ratio:.1f}"
        panel.annotate(text, (ratio, y), va="center", fontsize=8)
    panel.set_yticks(where, [humanize(c.effect) for c in tried])
    panel.invert_yaxis()
    panel.set_xlim(0.0, 1.2 * max(ratios) or 1.0)
    _dress(panel, "likelihood ratio [-]", title=f"tried at stage {tried[0].stage}")


def _curve(panel: Axes, law: LearnedLaw) -> None:
    x, mean, error = law.drawn()
    position = law.shown.value * x
    title = f"at '{law.curve.port}' {manner_words(law, law.curve.times)}"
    y, per, middle = f"curve [{law.curve.unit or '-'}]", 1.0, 0.0
    if law.curve.times == ARRIVING:  # a factor of -0.31 read as if the thrust were reversed
        title, y = f"change of what passes '{law.curve.port}', by {signal_words(law)}", "change [%]"
        # related to its median, as in the words: that is what a parameter of the model has taken up
        usual = float(np.median(law.curve.at_signal(law.samples))) if law.samples.size else 0.0
        middle = usual if usual > -1.0 else 0.0
        per = 100.0 / (1.0 + middle)
    _banded(panel, position, per * (mean - middle), per * error, BLUE)
    panel.plot(position, per * (mean - middle), color=BLUE, linewidth=1.8, label="learned curve")
    worst = _WORSE * min(fit.train.nrmse for fit in (law.fit, law.reported))
    drawn = (tried for tried in law.forms if tried.fit.train.nrmse <= worst)
    for colour, tried in zip(COLOURS[1:], drawn, strict=False):
        values = _form_over(law, tried, x)
        if values is not None:
            width, note = (1.8, "chosen:") if tried is law.form else (1.0, "tried:")
            style = {"color": colour, "linewidth": width, "linestyle": "--"}
            panel.plot(position, per * (values - middle), label=f"{note} {tried.title}", **style)
    panel.legend(fontsize=8, framealpha=0.9)
    _dress(panel, y=y, title=textwrap.fill(title, _TITLE))


def _form_over(law: LearnedLaw, tried: TriedForm, x: np.ndarray) -> np.ndarray | None:
    """A form over the signal, as what the curve is; ``None`` where it is that of no one curve."""
    values = form_over(tried, x)
    if tried.times != law.curve.times:
        if tried.times or law.factors is None:
            return None
        factor = _factor_over(x, law.samples, law.factors)
        if factor is None:
            return None
        acting = np.abs(factor) > _LEAST_FACTOR * np.abs(factor).max()
        values = np.where(acting, values / np.where(acting, factor, 1.0), np.nan)
    return _adjusted(law, x, values)


def _adjusted(law: LearnedLaw, x: np.ndarray, form: np.ndarray) -> np.ndarray:
    """A form with as much of what the model's own parameters do as brings it near the curve.

    The two fits have their own values of these: a thrust coefficient makes up for a factor.
    """
    curve = np.asarray(law.curve.at_signal(x))
    counts, edges = np.histogram(law.samples, 40)
    counts_at_x = np.interp(x, 0.5 * (edges[1:] + edges[:-1]), counts) * np.isfinite(form)
    if law.curve.times == ARRIVING:
        formed, learned = 1.0 + np.nan_to_num(form), 1.0 + curve
        return (1.0 + form) * (counts_at_x @ (formed * learned) / (counts_at_x @ formed**2)) - 1.0
    absorbed = [i for i, name in enumerate(law.curve.coefficients) if name in law.curve.held]
    rows = law.curve.basis(x)[absorbed]
    root = np.sqrt(counts_at_x)
    weights = np.linalg.lstsq((rows * root).T, root * (curve - np.nan_to_num(form)), rcond=None)[0]
    return form + weights @ rows


def _factor_over(x: np.ndarray, samples: np.ndarray, factors: np.ndarray) -> np.ndarray | None:
    """What a factor is as a function of the signal; ``None`` where it is none."""
    order = np.argsort(samples)
    signal, factor = samples[order], factors[order]
    width = max(1, signal.size // _BINS)
    starts = np.arange(0, signal.size, width)
    sizes = np.diff(np.append(starts, signal.size))
    centres, means = (np.add.reduceat(series, starts) / sizes for series in (signal, factor))
    residual = factor - np.interp(signal, centres, means)
    return np.interp(x, centres, means) if np.var(residual) < _FOLLOWS * np.var(factor) else None
