"""The result of a describing function."""

from __future__ import annotations

from typing import Any

import numpy as np

from diffthrust._support.figures import Figure, showing
from diffthrust._support.files import plain
from diffthrust._support.report import Report, Rows, Section, Styled, notes
from diffthrust._support.results import Result
from diffthrust._support.words import number
from diffthrust.describing._periodic.respond import Reason
from diffthrust.describing._values import ROWS, DescribingValues
from diffthrust.uncertainty._tables import evenly


class DescribingMap(Result, DescribingValues):
    """Gain and phase over amplitude and frequency, as numbers, words, figures and plain data.

    Example:
        >>> result = dft.describing_function(fit, [0.5, 2.0], [0.5, 2.0], method="harmonic_balance")
        >>> result.complex.shape, result.output_unit
        ((2, 2), 'N')
        >>> list(result.to_json())[:3]
        ['schema', 'model', 'effects']
        >>> figure = result.plot()
    """

    def _line(self) -> str:
        size = f"{self.amplitudes.size} amplitudes, {self.frequencies.size} frequencies"
        settled = f"{int(self.settled.sum())} of {self.reason.size} points settled"
        return f"{self.model}, {self.input} to {self.output}: {size}, {settled}"

    def _report(self) -> Report:
        """Method, how many points settled, and a row for some of the amplitudes."""
        result = self.shown
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
        for i in evenly(result.amplitudes.size, ROWS):
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
                f"From {result.input} to {result.output}{about}, by {method}: {size} points, "
                f"{count} of them settled.",
                "Break frequency: that of the first-order lag of the same phase, "
                f"at {w[middle]:.3g} rad/s. "
                "Bandwidth: where the gain has fallen to 1/sqrt(2) of the static gain.",
            ),
            Section("", Rows.of(headings, rows, numbers=range(7)), *notes(result.notes)),
        )

    def to_json(self) -> dict[str, Any]:
        """The map as plain data, ``null`` where there is no answer."""
        shown = self.shown
        reasons = {str(int(kind)): kind.words for kind in Reason if np.any(self.reason == kind)}
        return plain(
            {
                "schema": 1,
                "model": self.model.name,
                "effects": [effect.name for effect in self.model.effects],
                "parameters": {n: p.value for n, p in self.model.parameters.items()},
                "method": self.method,
                "harmonics": self.harmonics,
                "left_out": _errors(self.left_out),
                "input": {"name": self.input, "unit": self.input_unit, "bias": self.bias},
                "output": {"name": self.output, "unit": self.output_unit},
                "amplitudes": self.amplitudes,
                "frequencies": self.frequencies,
                "gain": self.gain,
                "gain_unit": self.gain_unit,
                "phase": self.phase,
                "break_frequency": self.break_frequency,
                "static_gain": self.static_gain,
                "bandwidth": self.bandwidth,
                "distortion": self.distortion,
                "mean": self.mean,
                "samples": self.samples,
                "settled": self.settled,
                "reason": self.reason,
                "reasons": reasons,
                "notes": self.notes,
                "written": {
                    "input": {"unit": shown.input_unit, "bias": shown.bias},
                    "output": {"unit": shown.output_unit},
                    "amplitudes": shown.amplitudes,
                    "gain": shown.gain,
                    "gain_unit": shown.gain_unit,
                    "static_gain": shown.static_gain,
                    "mean": shown.mean,
                },
            }
        )

    @showing
    def plot(self) -> Figure:
        """Gain and phase over frequency and amplitude; points without an answer are hatched."""
        from diffthrust.describing._figures import map_figure

        return map_figure(self)

    @showing
    def plot_break(self) -> Figure:
        """The break frequency over amplitude and frequency, as in figure 12 of Yoerger et al.

        Example:
            >>> result = dft.describing_function(
            ...     fit, [0.5, 2.0], [0.5, 2.0], method="harmonic_balance"
            ... )
            >>> figure = result.plot_break()
        """
        from diffthrust.describing._figures import break_figure

        return break_figure(self)


def _errors(left_out: np.ndarray | None) -> dict[str, np.ndarray] | None:
    if left_out is None:
        return None
    return {"gain": np.abs(np.real(left_out)), "phase": np.degrees(np.abs(np.imag(left_out)))}
