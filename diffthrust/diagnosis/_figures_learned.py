"""The figure of a learned law: its curve with a band, forms beside it, samples below."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from diffthrust._support.figures import BLUE, GREY
from diffthrust.diagnosis._figures import BAND, COLOURS, plainly
from diffthrust.diagnosis._learned_words import manner_words
from diffthrust.effects._grammar import expression_of
from diffthrust.models._base.made_effect import ARRIVING

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from diffthrust.diagnosis._findings import Findings
    from diffthrust.diagnosis._learned import LearnedLaw, TriedForm

_BINS = 40


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
    panel.axhline(0.0, color="0.4", linewidth=0.8)
    panel.fill_between(
        x, mean - BAND * error, mean + BAND * error, color=BLUE, alpha=0.22, linewidth=0,
        label=f"±{BAND:g} standard errors",
    )  # fmt: skip
    panel.plot(x, mean, color=BLUE, linewidth=1.8, label="learned curve")
    for colour, tried in zip(COLOURS[1:], law.forms, strict=False):
        seen = _formed(law, tried, x)
        if seen is not None:
            panel.plot(x, seen, color=colour, linewidth=1.2, linestyle="--", label=tried.name)
    panel.legend(fontsize=8, framealpha=0.9)
    unit = law.port_unit if not law.curve.times else ""
    panel.set_ylabel(f"curve [{unit}]" if unit else "curve [-]", fontsize=9)
    panel.set_title(f"at '{law.curve.port}' {manner_words(law)}", loc="left", fontsize=10)
    plainly(panel)


def _formed(law: LearnedLaw, tried: TriedForm, x: np.ndarray) -> np.ndarray | None:
    """A form over the signal, as what the curve is; ``None`` where it is of the product."""
    formula, curve = tried.formula, law.curve
    scales = ARRIVING in expression_of(formula.expression).places
    if scales != (curve.times == ARRIVING) or curve.times not in ("", ARRIVING):
        return None

    def named(name: str) -> object:
        if name == curve.signal:
            return x
        return np.ones_like(x) if name == ARRIVING else getattr(formula, name)

    found = np.broadcast_to(
        np.asarray(expression_of(formula.expression)(named, np), float), x.shape
    )
    return found - 1.0 if scales else found


def _density(panel: Axes, law: LearnedLaw) -> None:
    panel.hist(law.samples, bins=_BINS, color=GREY)
    panel.set_ylabel("samples", fontsize=9)
    unit = f" [{law.signal_unit}]" if law.signal_unit else ""
    past = f", over the last {law.curve.time_constant:.2g} s" if law.curve.past else ""
    panel.set_xlabel(f"{law.curve.signal}{past}{unit}", fontsize=9)
    plainly(panel)
