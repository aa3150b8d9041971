"""How well the logs determine a describing function: its interval over draws of the parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

from diffthrust._support.figures import Figure, showing
from diffthrust._support.files import plain
from diffthrust._support.report import Report, Rows, Section, Styled, notes
from diffthrust._support.results import Result
from diffthrust._support.words import percent
from diffthrust.describing._describe import notes_of, values_of
from diffthrust.describing._periodic.respond import Reason
from diffthrust.describing._request import request
from diffthrust.describing._values import ROWS, BandValues, followed_phase
from diffthrust.uncertainty._prediction.draws import draws_of
from diffthrust.uncertainty._tables import evenly, interval_text


class DescribingBand(Result, BandValues):
    """Gain and phase of a describing function with intervals, as words, figure and plain data.

    Example:
        >>> band = dft.describing.uncertainty(
        ...     fit, amplitudes=[0.5, 2.0], frequencies=[1.0], method="harmonic_balance", draws=8
        ... )
        >>> band.gain.shape, band.level, list(band.to_json())[:3]  # low, middle, high of each point
        ((3, 2, 1), 0.95, ['schema', 'model', 'method'])
        >>> figure = band.plot()
    """

    @showing
    def plot(self) -> Figure:
        """Gain and phase over frequency with their bands, for some of the amplitudes."""
        from diffthrust.describing._figures import band_figure

        return band_figure(self)

    def _line(self) -> str:
        size = f"{self.amplitudes.size} amplitudes, {self.frequencies.size} frequencies"
        return f"{self.model}, {self.input} to {self.output}: {size}, {self.draws.shape[0]} draws"

    def _report(self) -> Report:
        """Gain and phase with their intervals, at some of the points."""
        result = self.shown
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
        shown = (evenly(n, ROWS)[:: 2 if n > 4 else 1] for n in result.settled.shape)
        for i, j in product(*shown):
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

    def to_json(self) -> dict[str, Any]:
        """The intervals as plain data, ``null`` where there is none."""
        parts, shown = ("median", "low", "high"), self.shown
        return plain(
            {
                "schema": 1,
                "model": self.model,
                "method": self.method,
                "input": {"name": self.input, "unit": self.input_unit},
                "output": {"name": self.output, "unit": self.output_unit},
                "amplitudes": self.amplitudes,
                "frequencies": self.frequencies,
                "gain": dict(zip(parts, self.gain, strict=True)) | {"unit": self.gain_unit},
                "phase": dict(zip(parts, self.phase, strict=True)) | {"unit": "deg"},
                "settled": self.settled,
                "level": self.level,
                "draws_from": self.kind,
                "draws": self.draws.shape[0],
                "notes": self.notes,
                "written": {
                    "input": {"unit": shown.input_unit},
                    "output": {"unit": shown.output_unit},
                    "amplitudes": shown.amplitudes,
                    "gain": dict(zip(parts, shown.gain, strict=True)) | {"unit": shown.gain_unit},
                },
            }
        )


def uncertainty(
    source: Any,
    model: Any = None,
    *,
    amplitudes: Sequence[float] | np.ndarray,
    frequencies: Sequence[float] | np.ndarray,
    input: str = "command",
    output: str = "thrust",
    method: str = "simulation",
    harmonics: int = 15,
    samples: int | None = None,
    bias: float = 0.0,
    others: Mapping[str, float] | None = None,
    sensors: bool = False,
    draws: int = 100,
    level: float = 0.95,
    seed: int = 0,
) -> DescribingBand:
    """The describing function with intervals, by draws of the parameters.

    Args:
        source: a posterior that `sample` gives, or a `Fit`, whose covariance is drawn from.
        model: the model or the fit that was sampled; not needed where the source is a fit.
        amplitudes: of the input, in its unit, ``(A,)``.
        frequencies: [rad/s], ``(F,)``.
        input: as for `describing_function`, and so are all up to ``sensors``.
        output: see there.
        method: see there.
        harmonics: see there.
        samples: see there.
        bias: see there.
        others: see there.
        sensors: see there.
        draws: number of draws; with 100 the ends of a 95 % interval lie at 2.5 % +- 1.6 %.
        level: probability of the intervals.
        seed: of the draws.

    Returns:
        A `DescribingBand`.

    Raises:
        InputError: an argument that cannot be meant, an empty posterior or a failed fit.

    Example:
        >>> band = dft.describing.uncertainty(
        ...     fit, amplitudes=[0.5, 2.0], frequencies=[1.0], method="harmonic_balance", draws=8
        ... )
        >>> bool((band.gain[0] < band.gain[2]).all())
        True
    """
    drawn = draws_of(source, model, count=draws, seed=seed, level=level)
    asked = request(
        drawn.model, amplitudes, frequencies, input=input, output=output, method=method,
        harmonics=harmonics, samples=samples, bias=bias, others=others, sensors=sensors,
    )  # fmt: skip
    draws_by_name = {name: np.asarray(drawn.values[name]) for name in asked.model.parameters}
    result = values_of(asked, draws_by_name)
    values, reason = result["complex"], result["reason"]
    notes = (*drawn.notes, *notes_of(asked, drawn.fit or drawn.model, reason))
    # the phase is unwrapped draw by draw before quantiles: across -180 degrees they would mean
    # nothing
    phase = np.stack([followed_phase(v) for v in values])
    ends = [0.5, 0.5 * (1 - level), 0.5 * (1 + level)]
    return DescribingBand(
        model=str(asked.model),
        **asked.path,
        gain=_quantiles(np.abs(values), ends),
        phase=_quantiles(phase, ends),
        settled=np.mean(reason == Reason.SETTLED, axis=0),
        level=level,
        kind=drawn.kind,
        draws=values,
        notes=notes,
        written=drawn.fit.written if drawn.fit else {},
    )


def _quantiles(values: np.ndarray, ends: list[float]) -> np.ndarray:
    """Over the draws that have an answer, where these are at least half."""
    finite = np.isfinite(values)
    enough = finite.mean(axis=0) >= 0.5
    # zeros where no draw may count: numpy warns of columns of NaN only
    quantiles = np.nanquantile(np.where(enough, values, 0.0), ends, axis=0)
    return np.where(enough, quantiles, np.nan)
