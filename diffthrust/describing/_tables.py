"""The reports of describing functions, as data."""

from __future__ import annotations

import numpy as np

from diffthrust._support.report import Report, Rows, Section, Styled, notes
from diffthrust._support.words import number, percent
from diffthrust.describing._values import BandValues, DescribingValues
from diffthrust.uncertainty._tables import evenly, interval_text

_ROWS = 8
"""Most amplitudes, and most frequencies, of a table."""


def describing_report(result: DescribingValues) -> Report:
    """Method, how many points settled, and a row for some of the amplitudes."""
    result = result.shown
    count, size = int(result.settled.sum()), result.reason.size
    method = result.method.replace("_", " ")
    if result.harmonics is not None:
        method += f" with {result.harmonics} harmonics"
    about = f" about {result.bias:g} {result.input_unit}" if result.bias else ""
    w = result.frequencies
    middle = w.size // 2
    headings = (
        f"Amplitude [{result.input_unit}]",
        f"Static gain [{result.gain_unit}]",
        "Bandwidth [rad/s]",
        f"Gain at {w[middle]:.3g} rad/s",
        "Phase [deg]",
        "Break [rad/s]",
        "Distortion at most",
    )
    static, width = result.static_gain, result.bandwidth
    gain, phase, lag = result.gain, result.phase, result.break_frequency
    rows = []
    for i in evenly(result.amplitudes.size, _ROWS):
        worst = "-"
        if result.distortion is not None and result.settled[i].any():
            worst = f"{100 * np.nanmax(result.distortion[i]):.1f} %"
        rows.append(
            (
                f"{result.amplitudes[i]:.4g}",
                number(float(static[i])),
                number(float(width[i]), 3),
                number(float(gain[i, middle])),
                "-" if np.isnan(phase[i, middle]) else f"{phase[i, middle]:.2f}",
                number(float(lag[i, middle]), 3),
                worst,
            )
        )
    return Report(
        Section(
            "",
            Styled(str(result.model), "strong"),
            f"From {result.input} to {result.output}{about}, by {method}: {size} points, {count} "
            "of them settled.",
            "Break frequency: that of the first-order lag of the same phase, "
            f"at {w[middle]:.3g} rad/s. "
            "Bandwidth: where the gain has fallen to 1/sqrt(2) of the static gain.",
        ),
        Section("", Rows.of(headings, rows, numbers=range(7)), *notes(result.notes)),
    )


def band_report(result: BandValues) -> Report:
    """Gain and phase with their intervals, at some of the points."""
    result = result.shown
    share = percent(result.level)
    headings = (
        f"Amplitude [{result.input_unit}]",
        "Frequency [rad/s]",
        f"Gain [{result.gain_unit}]",
        f"{share} from",
        "to",
        "Phase [deg]",
        f"{share} from",
        "to",
    )
    rows = []
    for i in evenly(result.amplitudes.size, _ROWS)[:: 2 if result.amplitudes.size > 4 else 1]:
        for j in evenly(result.frequencies.size, _ROWS)[:: 2 if result.frequencies.size > 4 else 1]:
            gain = interval_text(*(float(v) for v in result.gain[:, i, j]))
            phase = interval_text(*(float(v) for v in result.phase[:, i, j]))
            point = f"{result.amplitudes[i]:.4g}", f"{result.frequencies[j]:.4g}"
            rows.append((*point, *gain, *phase))
    head = (
        f"From {result.input} to {result.output}, by {result.method.replace('_', ' ')}: "
        f"{result.draws.shape[0]} draws from the {result.kind}."
    )
    return Report(
        Section("", Styled(result.model, "strong"), head),
        Section("", Rows.of(headings, rows, numbers=range(8)), *notes(result.notes)),
    )
