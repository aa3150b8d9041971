"""Describing functions as text for people and as plain data."""

from __future__ import annotations

import numpy as np
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.text import Text

from diffthrust._support.tables import number, plain_table
from diffthrust._support.words import percent
from diffthrust.describing._values import BandValues, DescribingValues
from diffthrust.uncertainty._prediction.tables import interval_text

_ROWS = 8
"""A table shows at most so many amplitudes."""


def describing_table(found: DescribingValues) -> RenderableType:
    """Method, how many points settled, and a row for some of the amplitudes."""
    count, size = int(found.settled.sum()), found.reason.size
    how = found.method.replace("_", " ")
    if found.harmonics is not None:
        how += f" with {found.harmonics} harmonics"
    about = f" about {found.bias:g} {found.input_unit}" if found.bias else ""
    w = found.frequencies
    lines = [
        f"From {found.input} to {found.output}{about}, by {how}: {size} points, {count} of them "
        f"settled.",
        f"Break frequency: that of the first-order lag of the same phase, at {_some_words(found)}. "
        "Bandwidth: where the gain has fallen to 1/sqrt(2) of the static gain.",
    ]
    middle = w.size // 2
    table = plain_table(
        f"Amplitude [{escape(found.input_unit)}]",
        f"Static gain [{escape(found.gain_unit)}]",
        "Bandwidth [rad/s]",
        f"Gain at {w[middle]:.3g} rad/s",
        "Phase [deg]",
        "Break [rad/s]",
        "Distortion at most",
        numbers=range(7),
    )
    static, width = found.static_gain, found.bandwidth
    gain, phase, lag = found.gain, found.phase, found.break_frequency
    for i in _picked(found.amplitudes.size):
        worst = "-"
        if found.distortion is not None and found.settled[i].any():
            worst = f"{100 * np.nanmax(found.distortion[i]):.1f} %"
        table.add_row(
            f"{found.amplitudes[i]:.4g}",
            number(float(static[i])),
            number(float(width[i]), 3),
            number(float(gain[i, middle])),
            "-" if np.isnan(phase[i, middle]) else f"{phase[i, middle]:.2f}",
            number(float(lag[i, middle]), 3),
            worst,
        )
    notes = [Text(f"Note: {note}") for note in found.notes]
    texts = [Text(line) for line in lines]
    return Group(Text(str(found.model), style="bold"), *texts, Text(), table, *notes)


def band_table(found: BandValues) -> RenderableType:
    """Gain and phase with their intervals, at some of the points."""
    share = percent(found.level)
    table = plain_table(
        f"Amplitude [{escape(found.input_unit)}]",
        "Frequency [rad/s]",
        f"Gain [{escape(found.gain_unit)}]",
        f"{share} from",
        "to",
        "Phase [deg]",
        f"{share} from",
        "to",
        numbers=range(8),
    )
    for i in _picked(found.amplitudes.size)[:: 2 if found.amplitudes.size > 4 else 1]:
        for j in _picked(found.frequencies.size)[:: 2 if found.frequencies.size > 4 else 1]:
            gain = interval_text(*(float(v) for v in found.gain[:, i, j]))
            phase = interval_text(*(float(v) for v in found.phase[:, i, j]))
            place = f"{found.amplitudes[i]:.4g}", f"{found.frequencies[j]:.4g}"
            table.add_row(*place, *gain, *phase)
    head = (
        f"From {found.input} to {found.output}, by {found.method.replace('_', ' ')}: "
        f"{found.draws.shape[0]} draws from the {found.kind}."
    )
    notes = [Text(f"Note: {note}") for note in found.notes]
    return Group(Text(found.model, style="bold"), Text(head), Text(), table, *notes)


def _some_words(found: DescribingValues) -> str:
    return f"{found.frequencies[found.frequencies.size // 2]:.3g} rad/s"


def _picked(size: int) -> list[int]:
    return np.unique(np.linspace(0, size - 1, min(size, _ROWS)).round().astype(int)).tolist()
