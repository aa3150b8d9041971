"""The result of a describing function."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from diffthrust._support.errors import InputError
from diffthrust._support.figures import showing
from diffthrust._support.files import plain
from diffthrust._support.report import Report
from diffthrust._support.results import Result
from diffthrust.describing._periodic.respond import Reason
from diffthrust.describing._tables import describing_report
from diffthrust.describing._values import DescribingValues

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class DescribingMap(Result, DescribingValues):
    """Gain and phase over amplitude and frequency, as numbers, words, figures and plain data.

    Example:
        >>> result = dft.describing_function(fit, [0.5, 2.0], [0.5, 2.0], method="harmonic_balance")
        >>> result.complex.shape, result.output_unit
        ((2, 2), 'N')
        >>> abs(result.at(1.0, 1.0)).shape, list(result.to_json())[:3]
        ((), ['schema', 'model', 'effects'])
        >>> figure = result.plot()
    """

    def at(self, amplitude: ArrayLike, frequency: ArrayLike) -> Any:
        """The describing function between the points of the map, complex.

        Real and imaginary part are interpolated in the logarithms of amplitude and frequency: by
        monotone cubics, or linearly where the map is small or has points without an answer.

        Args:
            amplitude: of the input, a number or an array.
            frequency: [rad/s], of a shape that broadcasts with it.

        Raises:
            InputError: a point outside the map.
        """
        from scipy.interpolate import RegularGridInterpolator

        points = np.broadcast_arrays(np.asarray(amplitude, float), np.asarray(frequency, float))
        axes, wanted, values = [], [], self.complex
        kinds = (("amplitude", self.amplitudes, 0), ("frequency", self.frequencies, 1))
        for (name, grid, axis), asked in zip(kinds, points, strict=True):
            slack = 1e-9 * grid[-1]
            if not np.all((asked >= grid[0] - slack) & (asked <= grid[-1] + slack)):
                raise InputError(
                    f"The {name} {float(np.ravel(asked)[0]):g} lies outside the map, which goes "
                    f"from {grid[0]:g} to {grid[-1]:g}.",
                    "Make a map that covers it.",
                )
            if grid.size == 1:
                # the interpolator needs two points on each axis
                values = np.repeat(values, 2, axis)
                grid = grid[0] * np.array([1.0, 2.0])
            axes.append(np.log(grid))
            wanted.append(np.clip(np.log(np.clip(asked, grid[0], grid[-1])), *axes[-1][[0, -1]]))
        # one NaN would spread over every cubic that touches it
        smooth = min(values.shape) >= 4 and bool(np.all(np.isfinite(values)))
        how = "pchip" if smooth else "linear"
        place = np.stack([w.reshape(-1) for w in wanted], axis=1)
        parts = [
            RegularGridInterpolator(axes, v, how)(place) for v in (np.real(values), np.imag(values))
        ]
        between = (parts[0] + 1j * parts[1]).reshape(points[0].shape)
        return between if between.ndim else between[()]

    def _line(self) -> str:
        size = f"{self.amplitudes.size} amplitudes, {self.frequencies.size} frequencies"
        settled = f"{int(self.settled.sum())} of {self.reason.size} points settled"
        return f"{self.model}, {self.input} to {self.output}: {size}, {settled}"

    def _report(self) -> Report:
        return describing_report(self)

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
