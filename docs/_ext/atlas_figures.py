"""The figures of the atlas: what an effect does to a record, and which effects look alike."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from atlas_logs import Bench, signals_of, simulated
from matplotlib.figure import Figure

import diffthrust as dft

BLUE, VERMILLION, GREY = "#0072B2", "#D55E00", "0.55"
"""Okabe & Ito 2008: distinct with every kind of colour vision."""
_BINS = 16


@dataclass(frozen=True)
class Shown:
    """A record with an effect, and the model without it at its best.

    Args:
        record: with the measured channels.
        channel: the one on which the effect shows most.
        modelled: what the fitted model gives for it.
        signal: name of the signal that explains most of the residual.
        values: its course.
        share: how much of the residual it explains, 0 to 1.
    """

    record: dft.Log
    channel: str
    modelled: np.ndarray
    signal: str
    values: np.ndarray
    share: float

    @property
    def residual(self) -> np.ndarray:
        """Measured minus modelled."""
        return self.record.measured[self.channel] - self.modelled


def shown(bench: Bench, effect: dft.Effect, name: str) -> Shown:
    """Simulate a record with an effect, add noise, and fit the model that does not know of it."""
    inputs = bench.records[name]
    run = simulated(bench.model + effect, inputs)
    rng = np.random.default_rng(17)
    noise = {c: s * rng.standard_normal(inputs.time.size) for c, s in bench.noise.items()}
    measured = {c: run[c] + noise[c] for c in bench.noise}
    record = dft.Log(inputs.time, dict(inputs.inputs), measured, name=name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fit = dft.fit(bench.model, record, starts=6, horizon=None, substeps=2)
    best = dft.simulate(fit.model, record, initial=fit.initial[0], substeps=2)
    left = {c: np.mean((measured[c] - best[c]) ** 2) / s**2 for c, s in bench.noise.items()}
    channel = max(left, key=lambda c: left[c])
    residual = measured[channel] - best[channel]
    known = signals_of(Bench("", "", fit.model, {name: inputs}, bench.noise), inputs)
    rates = {
        f"rate of {n}": np.gradient(known[n], inputs.time)
        for n in (*bench.model.inputs, *bench.noise)
    }
    shares = {n: _explained(np.asarray(v), residual) for n, v in {**known, **rates}.items()}
    # a step of the command is a stretch of time: time explains only what changes for good
    shares["time"] = _explained(np.floor(4.0 * np.linspace(0, 0.999, residual.size)), residual)
    signal = max(shares, key=lambda n: shares[n])
    values = np.asarray({**known, **rates}[signal])
    return Shown(record, channel, best[channel], signal, values, shares[signal])


def _bins(values: np.ndarray) -> np.ndarray:
    """The bin of each sample: as many samples in each, where values do not repeat."""
    edges = np.unique(np.quantile(values, np.linspace(0, 1, _BINS + 1)))
    return np.digitize(values, edges[1:-1])


def _explained(values: np.ndarray, residual: np.ndarray) -> float:
    """The share of the residual that its mean over bins of a signal explains, beyond chance."""
    if not np.ptp(values) > 1e-9 * (1.0 + np.abs(values).max()):
        return 0.0
    place = _bins(values)
    count = np.bincount(place)
    mean = np.bincount(place, residual) / np.maximum(count, 1)
    total = np.sum((residual - residual.mean()) ** 2)
    between = np.sum(count * (mean - residual.mean()) ** 2)
    used = np.count_nonzero(count)
    return float(1 - (1 - between / total) * (residual.size - 1) / (residual.size - used))


def effect_figure(one: Shown, units: dict[str, str], title: str) -> Figure:
    """Measured and modelled, the residual in time, and against the signal that explains most."""
    figure = Figure(figsize=(9.6, 4.4), layout="constrained")
    axes = figure.subplot_mosaic(
        [["run", "against"], ["left", "against"]], width_ratios=[1.9, 1], height_ratios=[1.5, 1]
    )
    time, unit = one.record.time, units.get(one.channel, "")
    run, left, against = axes["run"], axes["left"], axes["against"]
    run.plot(time, one.record.measured[one.channel], ".", ms=3, color=GREY, label="measured")
    run.plot(time, one.modelled, color=BLUE, lw=1.6, label="modelled without it, at its best")
    run.set_ylabel(_label(one.channel, unit))
    run.set_title(title, fontsize=10, loc="left")
    low, high = run.get_ylim()
    run.set_ylim(low, high + 0.22 * (high - low))
    run.legend(loc="upper right", ncols=2, fontsize=8, frameon=False)
    run.tick_params(labelbottom=False)
    left.axhline(0.0, color="0.3", lw=0.8)
    left.plot(time, one.residual, color=VERMILLION, lw=1.0)
    left.set_ylabel(_label("residual", unit))
    left.set_xlabel("time [s]")
    left.sharex(run)
    against.axhline(0.0, color="0.3", lw=0.8)
    against.plot(one.values, one.residual, ".", ms=3, color=VERMILLION, alpha=0.5, label="residual")
    place = _bins(one.values)
    count = np.maximum(np.bincount(place), 1)
    x, y = np.bincount(place, one.values) / count, np.bincount(place, one.residual) / count
    kept = np.bincount(place) > 0
    against.plot(x[kept], y[kept], "o-", color="black", ms=4, lw=1.2, label="its mean")
    against.set_xlabel(_label(one.signal, units.get(one.signal, "")))
    against.set_ylabel(_label(f"residual of {one.channel}", unit))
    against.set_title(f"{one.signal.replace('_', ' ')} explains {one.share:.0%} of it", fontsize=10)
    against.legend(fontsize=8, frameon=False)
    for axis in axes.values():
        axis.spines[["top", "right"]].set_visible(False)
    return figure


def _label(name: str, unit: str) -> str:
    shown_name = name.replace("_", " ")
    return f"{shown_name} [{unit}]" if unit else shown_name


def likeness_figure(names: list[str], table: np.ndarray, title: str) -> Figure:
    """A map of how alike each pair of effects is on the standard record."""
    size = 2.6 + 0.27 * len(names)
    figure = Figure(figsize=(size + 1.2, size), layout="constrained")
    axis = figure.subplots()
    image = axis.imshow(table, cmap="cividis", vmin=0, vmax=1)
    shown_names = [name.replace("_", " ") for name in names]
    axis.set_xticks(range(len(names)), shown_names, rotation=90, fontsize=8)
    axis.set_yticks(range(len(names)), shown_names, fontsize=8)
    axis.set_title(title, fontsize=10, loc="left")
    for i, j in np.argwhere(table > 0.795):
        if i != j:
            axis.text(j, i, f"{table[i, j]:.2f}".lstrip("0"), ha="center", va="center", fontsize=6)
    figure.colorbar(image, ax=axis, label="likeness, 0 to 1", shrink=0.8)
    return figure
