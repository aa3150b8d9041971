"""A figure of residuals: where they are large, and whether they are noise."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from diffthrust._support.figures import BLUE, GREY, VERMILLION, is_sparse, literal, styled, thinned
from diffthrust.comparison._derived_signals import derived_of
from diffthrust.comparison._regimes import Regime
from diffthrust.comparison._residual_tests import ResidualTests
from diffthrust.models._base.model import Model
from diffthrust.simulation._record import are_tables
from diffthrust.simulation._runs import Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
    from matplotlib.figure import Figure

    tabular = are_tables(run.record for run in runs)
    derived = [(run, derived_of(model, run, tabular=tabular)) for run in runs]
    across = 2 if tabular else 4
    figure = Figure(figsize=(4.4 * across, 0.9 + 3.5 * len(channels)), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.08, h_pad=0.08)  # pyright: ignore
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
        _shade(axes, run.time, regime.holds(derived))
    residual = run.shown_channels[name].residual
    style = "." if is_sparse(residual) else "-"
    axes.plot(*thinned(run.time, residual), style, color=BLUE, linewidth=0.9)
    which = f"{literal(run.name)}{', the worst run' if len(measured) > 1 else ''}"
    label = "sample" if tabular else "time [s]"
    styled(axes, f"{name}\n{which}", label, _labelled("residual", run.shown_channels[name].unit))


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
        low, high = (
            float(np.clip(end, across.min(), across.max())) for end in (regime.low, regime.high)
        )
        axes.axvspan(low, high, color=_SHADE, alpha=0.45, linewidth=0, zorder=0)
        title = textwrap.fill(regime.sentence, 46)
    kept = np.isfinite(residual)
    axes.plot(across[kept][::stride], residual[kept][::stride], ".", color=BLUE, markersize=2.5)
    label = _labelled("residual", having[0][0].shown_channels[name].unit)
    styled(axes, title, _labelled(signal, unit), label)


def _autocorrelation(axes: Axes, tests: ResidualTests) -> None:
    all_lags = np.arange(tests.autocorrelation.size) * tests.step
    shown = max(20, int(np.ceil(4 * tests.correlation_time / tests.step)))
    lags, values = all_lags[: shown + 1], tests.autocorrelation[: shown + 1]
    band = 1.96 / np.sqrt(tests.samples)
    axes.axhspan(-band, band, color="0.85", linewidth=0, label="95 % of white noise")
    axes.axhline(0.0, color="0.4", linewidth=0.8)
    axes.plot(lags, values, color=BLUE, linewidth=1.2)
    axes.legend(fontsize=8, frameon=False, loc="upper right")
    axes.set_ylim(min(-0.3, 1.1 * float(values.min())), 1.08)
    title = f"correlated over {tests.correlation_time:.2g} s" if not tests.white else "white"
    styled(axes, f"Autocorrelation: {title}", "lag [s]", "correlation")


def _cross_correlation(axes: Axes, tests: ResidualTests) -> None:
    if not tests.signals:
        axes.set_axis_off()
        return
    most = max(tests.signals.values(), key=lambda s: abs(s.peak) / s.band)
    axes.axhspan(-most.band, most.band, color="0.85", linewidth=0, label="95 % where unrelated")
    axes.axhline(0.0, color="0.4", linewidth=0.8)
    axes.axvline(0.0, color=GREY, linewidth=0.8)
    axes.plot(most.lags, most.values, color=VERMILLION, linewidth=1.2)
    axes.legend(fontsize=8, frameon=False, loc="upper right")
    reach = 1.25 * max(abs(most.peak), most.band)
    axes.set_ylim(-reach, 1.2 * reach)
    title = "related" if most.related else "no signal is related"
    label = f"lag of the residual behind {most.signal} [s]"
    styled(axes, f"Correlation with {most.signal}:\n{title}", label, "correlation")


def _shade(axes: Axes, time: np.ndarray, inside: np.ndarray) -> None:
    """Shade each stretch of time in which the regime holds."""
    steps = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(int), [0]])))
    after = np.append(time[1:], time[-1])
    for begin, end in zip(steps[::2], steps[1::2], strict=True):
        span = (float(time[begin]), float(after[end - 1]))
        axes.axvspan(*span, color=_SHADE, alpha=0.45, linewidth=0, zorder=0)


def _labelled(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name
