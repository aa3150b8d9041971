"""The figure of a learned law: its curve with a band, forms beside it, samples below."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from diffthrust._support.figures import BLUE, GREY
from diffthrust.diagnosis._figures import BAND, COLOURS, plainly
from diffthrust.diagnosis._learned_words import manner_words, signal_words
from diffthrust.diagnosis._unknown_term.closed_forms import FORMS, form_values
from diffthrust.models._base.made_effect import ARRIVING

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from diffthrust.diagnosis._findings import Findings
    from diffthrust.diagnosis._learned import LearnedLaw, TriedForm

_BINS = 60
_WIDE = 85
"""Letters in a line of a title."""
_FOLLOWS = 0.01
"""A factor follows from the signal where this share of its variance is left over the signal."""
_WORSE = 2.0
"""A form with which whole runs err by more than so many times as much is not drawn."""
_LEAST = 0.05
"""A form of the whole law is drawn over its factor where this is no less than so much of it."""


def learned_figure(diag: Findings) -> Figure:
    """A column for each learned law: the curve above, below it how often the logs were there."""
    from matplotlib.figure import Figure

    count = len(diag.laws)
    figure = Figure(figsize=(7.5 * count, 5.2), layout="constrained")
    axes = figure.subplots(2, count, squeeze=False, sharex="col", height_ratios=[3.2, 1])
    for k, law in enumerate(diag.laws):
        _curve(axes[0, k], law)
        _density(axes[1, k], law)
    return figure


def _curve(panel: Axes, law: LearnedLaw) -> None:
    x, mean, error = law.drawn()
    over = law.shown.value * x
    panel.axhline(0.0, color="0.4", linewidth=0.8)
    panel.fill_between(
        over, mean - BAND * error, mean + BAND * error, color=BLUE, alpha=0.22, linewidth=0,
        label=f"±{BAND:g} standard errors",
    )  # fmt: skip
    panel.plot(over, mean, color=BLUE, linewidth=1.8, label="learned curve")
    most = _WORSE * min(fit.train.nrmse for fit in (law.fit, law.told))
    near = (tried for tried in law.forms if tried.fit.train.nrmse <= most)
    for colour, tried in zip(COLOURS[1:], near, strict=False):
        seen = _formed(law, tried, x)
        if seen is not None:
            chosen = tried is law.form
            panel.plot(
                over, seen, color=colour, linewidth=1.8 if chosen else 1.0, linestyle="--",
                label=f"{tried.name}{' (its name)' if chosen else ''}",
            )  # fmt: skip
    panel.legend(fontsize=8, framealpha=0.9)
    unit = law.curve.unit
    panel.set_ylabel(f"curve [{unit}]" if unit else "curve [-]", fontsize=9)
    title = fill(f"at '{law.curve.port}' {manner_words(law)}", _WIDE)
    panel.set_title(title, loc="left", fontsize=10)
    plainly(panel)


def _formed(law: LearnedLaw, tried: TriedForm, x: np.ndarray) -> np.ndarray | None:
    """A form over the signal, as what the curve is; ``None`` where it is that of no one curve."""
    form = next(one for one in FORMS if one.name == tried.name)
    found = form.over(x, {**form_values(form, tried.formula), "r": tried.reference})
    if tried.times != law.curve.times:
        if tried.times or law.factors is None:
            return None
        factor = _following(x, law.samples, law.factors)
        if factor is None:
            return None
        seen = np.abs(factor) > _LEAST * np.abs(factor).max()
        found = np.where(seen, found / np.where(seen, factor, 1.0), np.nan)
    return _beside(law, x, found)


def _beside(law: LearnedLaw, x: np.ndarray, found: np.ndarray) -> np.ndarray:
    """A form with as much of what the model's own parameters do as brings it near the curve.

    The two fits have their own values of these: a thrust coefficient makes up for a factor.
    """
    curve = np.asarray(law.curve.at_signal(x))
    counts, edges = np.histogram(law.samples, 40)
    often = np.interp(x, 0.5 * (edges[1:] + edges[:-1]), counts) * np.isfinite(found)
    if law.curve.times == ARRIVING:
        ours, theirs = 1.0 + np.nan_to_num(found), 1.0 + curve
        return (1.0 + found) * (often @ (ours * theirs) / (often @ ours**2)) - 1.0
    held = [i for i, name in enumerate(law.curve.coefficients) if name in law.curve.held]
    rows = law.curve.basis(x)[held]
    root = np.sqrt(often)
    weights = np.linalg.lstsq((rows * root).T, root * (curve - np.nan_to_num(found)), rcond=None)[0]
    return found + weights @ rows


def _following(x: np.ndarray, samples: np.ndarray, factors: np.ndarray) -> np.ndarray | None:
    """What a factor is as a function of the signal; ``None`` where it is none."""
    order = np.argsort(samples)
    over, along = samples[order], factors[order]
    width = max(1, over.size // _BINS)
    starts = np.arange(0, over.size, width)
    sizes = np.diff(np.append(starts, over.size))
    centres, means = (np.add.reduceat(series, starts) / sizes for series in (over, along))
    rest = along - np.interp(over, centres, means)
    return np.interp(x, centres, means) if np.var(rest) < _FOLLOWS * np.var(along) else None


def _density(panel: Axes, law: LearnedLaw) -> None:
    panel.hist(law.shown.value * law.samples, bins=_BINS, color=GREY)
    panel.set_ylabel("samples", fontsize=9)
    unit = f" [{law.place_unit}]" if law.place_unit else ""
    panel.set_xlabel(f"{signal_words(law)}{unit}", fontsize=9)
    plainly(panel)
