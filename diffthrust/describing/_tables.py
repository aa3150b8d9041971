"""Describing functions as text for people and as plain data."""

from __future__ import annotations

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from diffthrust._support.tables import number, plain_table
from diffthrust._support.words import percent
from diffthrust.describing._values import BandValues, DescribingValues
from diffthrust.uncertainty._prediction.tables import interval_text

_ROWS = 8
"""A table shows at most so many amplitudes."""


def describing_table(result: DescribingValues) -> RenderableType:
    """Method, how many points settled, and a row for some of the amplitudes."""
    result = result.shown
    count, size = int(result.settled.sum()), result.reason.size
    how = result.method.replace("_", " ")
    if result.harmonics is not None:
        how += f" with {result.harmonics} harmonics"
    about = f" about {result.bias:g} {result.input_unit}" if result.bias else ""
    w = result.frequencies
    middle = w.size // 2
    lines = [
        f"From {result.input} to {result.output}{about}, by {how}: {size} points, {count} of them "
        f"settled.",
        "Break frequency: that of the first-order lag of the same phase, "
        f"at {w[middle]:.3g} rad/s. "
        "Bandwidth: where the gain has fallen to 1/sqrt(2) of the static gain.",
    ]
    table = plain_table(
        f"Amplitude [{result.input_unit}]",
        f"Static gain [{result.gain_unit}]",
        "Bandwidth [rad/s]",
        f"Gain at {w[middle]:.3g} rad/s",
        "Phase [deg]",
        "Break [rad/s]",
        "Distortion at most",
        numbers=range(7),
    )
    static, width = result.static_gain, result.bandwidth
    gain, phase, lag = result.gain, result.phase, result.break_frequency
    for i in _picked(result.amplitudes.size):
        worst = "-"
        if result.distortion is not None and result.settled[i].any():
            worst = f"{100 * np.nanmax(result.distortion[i]):.1f} %"
        table.add_row(
            f"{result.amplitudes[i]:.4g}",
            number(float(static[i])),
            number(float(width[i]), 3),
            number(float(gain[i, middle])),
            "-" if np.isnan(phase[i, middle]) else f"{phase[i, middle]:.2f}",
            number(float(lag[i, middle]), 3),
            worst,
        )
    notes = [Text(f"Note: {note}") for note in result.notes]
    texts = [Text(line) for line in lines]
    return Group(Text(str(result.model), style="bold"), *texts, Text(), table, *notes)


def band_table(result: BandValues) -> RenderableType:
    """Gain and phase with their intervals, at some of the points."""
    result = result.shown
    share = percent(result.level)
    table = plain_table(
        f"Amplitude [{result.input_unit}]",
        "Frequency [rad/s]",
        f"Gain [{result.gain_unit}]",
        f"{share} from",
        "to",
        "Phase [deg]",
        f"{share} from",
        "to",
        numbers=range(8),
    )
    for i in _picked(result.amplitudes.size)[:: 2 if result.amplitudes.size > 4 else 1]:
        for j in _picked(result.frequencies.size)[:: 2 if result.frequencies.size > 4 else 1]:
            gain = interval_text(*(float(v) for v in result.gain[:, i, j]))
            phase = interval_text(*(float(v) for v in result.phase[:, i, j]))
            place = f"{result.amplitudes[i]:.4g}", f"{result.frequencies[j]:.4g}"
            table.add_row(*place, *gain, *phase)
    head = (
        f"From {result.input} to {result.output}, by {result.method.replace('_', ' ')}: "
        f"{result.draws.shape[0]} draws from the {result.kind}."
    )
    notes = [Text(f"Note: {note}") for note in result.notes]
    return Group(Text(result.model, style="bold"), Text(head), Text(), table, *notes)


def _picked(size: int) -> list[int]:
    return np.unique(np.linspace(0, size - 1, min(size, _ROWS)).round().astype(int)).tolist()
