"""The numbers of describing functions, over amplitude and frequency; with intervals, too."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from diffthrust._support.results import Brief
from diffthrust.describing._periodic.respond import Reason
from diffthrust.logs._written import ShownUnits, Written
from diffthrust.models._base.model import Model

ROWS = 8
"""Most amplitudes, and most frequencies, of a table."""
_SMALL_PHASE = 30.0
"""Largest phase at the lowest frequency where its gain is taken as the static one [deg]."""


@dataclass(frozen=True, kw_only=True, repr=False)
class _DescribedPath(Brief, ABC):
    """What a describing function and its intervals have in common.

    Args:
        method: see `describing_function`.
        input: the channel that is a sinusoid.
        output: whose first harmonic it is.
        input_unit: of the amplitudes.
        output_unit: of the output.
        amplitudes: of the input, ``(A,)``.
        frequencies: [rad/s], ``(F,)``.
        notes: what the user should know besides.
        written: how the logs of the fit wrote each channel: figures and tables use those units.
    """

    method: str
    input: str
    output: str
    input_unit: str
    output_unit: str
    amplitudes: np.ndarray
    frequencies: np.ndarray
    notes: tuple[str, ...] = ()
    written: Mapping[str, Written] = field(default_factory=dict, repr=False)

    @property
    def gain_unit(self) -> str:
        """The unit of the gain."""
        return ratio_unit(self.input_unit, self.output_unit)

    @property
    def shown(self) -> Self:
        """The same in the units for people."""
        units = ShownUnits((self.written,))
        swing, unit = units.size(self.input, 1.0, self.input_unit)
        size, output_unit = units.size(self.output, 1.0, self.output_unit)
        return replace(
            self,
            input_unit=unit,
            output_unit=output_unit,
            amplitudes=swing * self.amplitudes,
            written={},
            **self._shown(units, size / swing),
        )

    @abstractmethod
    def _shown(self, units: ShownUnits, per: float) -> dict[str, Any]:
        """The other fields with units; gains are to be multiplied by ``per``."""


@dataclass(frozen=True, kw_only=True, repr=False)
class DescribingValues(_DescribedPath):
    """Gain and phase over amplitude and frequency, as `_DescribedPath`.

    Args:
        model: the model that was looked at.
        bias: what the input swings about.
        complex: first harmonic of the output over that of the input, ``(A, F)``; NaN where there
            is no answer.
        reason: why there is none, ``(A, F)``, as numbers of `Reason`; 0 where settled.
        distortion: root sum square of the output's higher harmonics over its first, ``(A, F)``;
            ``None`` where the method does not give it.
        mean: of the output, in its unit, ``(A, F)``; or ``None``.
        samples: steps to the period that were needed, ``(A, F)``; or ``None``.
        harmonics: of the states, for a harmonic balance.
        left_out: error of the first harmonic, relative to it, that more harmonics show, complex
            ``(A, F)``: its real part is that of the gain, its imaginary one that of the phase
            [rad]. NaN where the balance has no answer; ``None`` for other methods.
    """

    model: Model = field(repr=False)
    bias: float
    complex: np.ndarray = field(repr=False)
    reason: np.ndarray = field(repr=False)
    distortion: np.ndarray | None = field(default=None, repr=False)
    mean: np.ndarray | None = field(default=None, repr=False)
    samples: np.ndarray | None = field(default=None, repr=False)
    harmonics: int | None = None
    left_out: np.ndarray | None = field(default=None, repr=False)

    def _shown(self, units: ShownUnits, per: float) -> dict[str, Any]:
        mean = self.mean
        return {
            "bias": float(units.values(self.input, self.bias, self.input_unit)),
            "complex": per * self.complex,
            "mean": None if mean is None else units.values(self.output, mean, self.output_unit),
        }

    @property
    def settled(self) -> np.ndarray:
        """Whether a point has an answer, ``(A, F)``."""
        return self.reason == Reason.SETTLED

    @property
    def gain(self) -> np.ndarray:
        """Amplitude of the output's first harmonic over that of the input, ``(A, F)``."""
        return np.abs(self.complex)

    @property
    def phase(self) -> np.ndarray:
        """Phase of the output ahead of the input [deg], ``(A, F)``.

        Followed along the frequency, so that a delay goes on below -180 degrees. NaN where there
        is no answer, and where the output does not move.
        """
        return followed_phase(self.complex)

    @property
    def break_frequency(self) -> np.ndarray:
        """Break frequency of the first-order lag of the same phase [rad/s], ``(A, F)``.

        The paper's lambda: ``w / tan(-phase)``. NaN where the phase is not between 0 and -90
        degrees, which no such lag has.
        """
        phase = self.phase
        with np.errstate(invalid="ignore", divide="ignore"):
            lags = (phase < 0) & (phase > -90)
            return np.where(lags, self.frequencies / np.tan(np.radians(-phase)), np.nan)

    @property
    def static_gain(self) -> np.ndarray:
        """The gain towards zero frequency at each amplitude, ``(A,)``.

        It is the gain at the lowest frequency over the cosine of the phase there, as for a
        first-order lag. NaN where that phase is beyond 30 degrees.
        """
        gain, phase = self.gain[:, 0], self.phase[:, 0]
        with np.errstate(invalid="ignore"):
            near = np.abs(phase) <= _SMALL_PHASE
            return np.where(near, gain / np.cos(np.radians(phase)), np.nan)

    @property
    def bandwidth(self) -> np.ndarray:
        """The frequency [rad/s] where the gain falls to 1/sqrt(2) of the static one, ``(A,)``.

        Interpolated in the logarithms of both. NaN where the map does not go so high, or not low
        enough for a static gain.
        """
        widths = np.full(self.amplitudes.size, np.nan)
        for i, static in enumerate(self.static_gain):
            row = self.gain[i] * np.sqrt(2.0)
            if not static > 0:
                continue
            below = np.flatnonzero(row <= static)
            k = int(below[0]) if below.size else 0
            if k > 0 and row[k - 1] > static and row[k] > 0:
                share = np.log(row[k - 1] / static) / np.log(row[k - 1] / row[k])
                w = self.frequencies
                widths[i] = w[k - 1] * (w[k] / w[k - 1]) ** share
        return widths


@dataclass(frozen=True, kw_only=True, repr=False)
class BandValues(_DescribedPath):
    """Gain and phase of a describing function with intervals, point by point, as `_DescribedPath`.

    Args:
        model: words for the model.
        gain: median, lower and upper end, ``(3, A, F)``; NaN where fewer than half of the draws
            have an answer.
        phase: the same of the phase [deg].
        settled: share of the draws that have an answer, ``(A, F)``.
        level: probability of the intervals, with equal tails.
        kind: "posterior" or "covariance": where the draws are from.
        draws: the describing function by draw, complex, ``(n, A, F)``.
    """

    model: str
    gain: np.ndarray = field(repr=False)
    phase: np.ndarray = field(repr=False)
    settled: np.ndarray = field(repr=False)
    level: float
    kind: str
    draws: np.ndarray = field(repr=False)

    def _shown(self, units: ShownUnits, per: float) -> dict[str, Any]:
        return {"gain": per * self.gain, "draws": per * self.draws}


def ratio_unit(below: str, above: str) -> str:
    """The unit of an output over an input, such as ``(rad/s)/V``."""
    if not below:
        return above
    if any(mark in below for mark in " /"):
        below = f"({below})"
    return (
        f"({above})/{below}" if any(mark in above for mark in " /") else f"{above or '1'}/{below}"
    )


def followed_phase(values: np.ndarray) -> np.ndarray:
    """The phase [deg] of complex values ``(A, F)``, followed along the second axis; NaN at 0."""
    phase = np.full(values.shape, np.nan)
    for row, values_of_row in zip(phase, values, strict=True):
        moves = np.isfinite(values_of_row) & (np.abs(np.nan_to_num(values_of_row)) > 0)
        row[moves] = np.degrees(np.unwrap(np.angle(values_of_row[moves])))
    return phase
