"""What draws of the parameters say, with intervals: bands of channels, derived quantities."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from diffthrust._support._running.programs import program
from diffthrust._support.errors import InputError
from diffthrust._support.results import Brief
from diffthrust.estimation._arguments import LOSSES
from diffthrust.estimation._laws import Law
from diffthrust.logs._written import ShownUnits
from diffthrust.simulation._record import Record
from diffthrust.uncertainty._prediction.draws import Draws
from diffthrust.uncertainty._values import Shown, central

_HALVINGS = 32
"""The ends of a band with noise are found by bisection, to this many binary digits."""


@dataclass(frozen=True, repr=False)
class Band(Brief, Shown):
    """The predictive band of one channel, ``(T,)`` each, in ``unit``.

    Args:
        measured: the samples; NaN if missing. Angles are shifted to the turn of the band.
        median: of the predictions by the draws, without noise.
        low: lower end for the prediction without noise.
        high: upper end.
        noisy_low: lower end for the sensor's reading.
        noisy_high: upper end.
        coverage: share of the samples inside the band with noise.
        samples: number of measured samples.
        unit: of all but the coverage.
        per: number of ``shown_unit`` per ``unit``.
        shown_unit: display unit, in which the log was written.
    """

    _in_unit = ("measured", "median", "low", "high", "noisy_low", "noisy_high")

    measured: np.ndarray
    median: np.ndarray
    low: np.ndarray
    high: np.ndarray
    noisy_low: np.ndarray
    noisy_high: np.ndarray
    coverage: float
    samples: int
    unit: str
    per: float = 1.0
    shown_unit: str = ""


def band_of(
    drawn: Draws,
    record: Record,
    channel: str,
    mean: np.ndarray,
    noisy: np.ndarray | None,
    level: float,
) -> Band:
    """The band of one channel, and its coverage of the measurements.

    ``mean`` are predictions by draw without noise, ``noisy`` with random forces and noise, ``(n,
    T)`` each; if ``None``, noise is added to ``mean`` in closed form.
    """
    unit = drawn.model.outputs[channel]

    def finite(runs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # draws at which the simulation fails are left out; one of two hundred must not end the
        # prediction
        rows = np.all(np.isfinite(runs), axis=1)
        if not rows.any():
            raise InputError(
                f"{record.name}: no draw of the parameters gives a finite {channel}.",
                "Look at the posterior; raise substeps.",
            )
        # an unsigned sensor gives the size: bands of the signed output would reach below zero
        return rows, np.abs(runs[rows]) if channel in record.unsigned else runs[rows]

    rows, runs = finite(mean)
    low, median, high = central(runs, level, axis=0)
    sigma = drawn.noise.get(channel)
    noisy_low, noisy_high = low, high
    if noisy is not None:
        noisy_low, _, noisy_high = central(finite(noisy)[1], level, axis=0)
    elif sigma is not None:
        tails = 0.5 * (1 - level), 0.5 * (1 + level)
        noisy_low, noisy_high = (
            np.asarray(mixed_quantile(LOSSES[drawn.loss], runs, sigma[rows], p)) for p in tails
        )
    measured = record.observed[channel]
    if channel in drawn.model.angles:
        # an angle may be logged a turn away from the simulated one
        turns = np.round((measured - median) / (2 * np.pi))
        measured = measured - 2 * np.pi * turns
    valid = np.isfinite(measured)
    ends = (low, high, noisy_low, noisy_high)
    inside = (measured >= noisy_low) & (measured <= noisy_high)
    share = float(np.mean(inside[valid])) if valid.any() else float("nan")
    size = ShownUnits((record.log.written,)).size(channel, 1.0, unit)
    return Band(measured, median, *ends, share, int(valid.sum()), unit, *size)


@program(1)
def mixed_quantile(law: Law, centre: Any, scale: Any, probability: Any) -> Any:
    """A quantile of the measurement: the mixture of the noise of all draws.

    Bisection on the mixture's distribution function replaces drawing noise, whose quantiles would
    scatter. Centres are ``(n, T)``, scales ``(n,)``.
    """

    def below(x: Any) -> Any:
        t = (x[None, :] - centre) / scale[:, None]
        return jnp.mean(law.below(t), axis=0)

    # beyond 40 scales even a Student-t law with few degrees holds no tail that a band asks for
    far = 40.0 * jnp.max(scale)

    def halve(_: int, ends: Any) -> Any:
        low, high = ends
        middle = 0.5 * (low + high)
        less = below(middle) < probability
        return jnp.where(less, middle, low), jnp.where(less, high, middle)

    ends = jnp.min(centre, axis=0) - far, jnp.max(centre, axis=0) + far
    low, high = jax.lax.fori_loop(0, _HALVINGS, halve, ends)
    return 0.5 * (low + high)


@dataclass(frozen=True, repr=False)
class DerivedQuantity(Brief, Shown):
    """A number or curve derived from the parameters, with its interval.

    Args:
        name: of the quantity.
        unit: of the values.
        median: a number, or ``(m,)`` for a curve.
        low: lower end of the interval, point by point.
        high: upper end.
        draws: the values by draw, ``(n,)`` or ``(n, m)``.
        grid: abscissa of a curve, ``(m,)``; ``None`` for a number.
        grid_name: name of the abscissa.
        grid_unit: its unit.
        per: number of ``shown_unit`` per ``unit``.
        shown_unit: display unit, in which the logs were written; ``unit`` if empty.
        shown_grid: the abscissa in its display unit, ``(m,)``; ``None`` if the same.
        shown_grid_unit: display unit of the abscissa.
    """

    _in_unit = ("median", "low", "high", "draws")

    name: str
    unit: str
    median: Any
    low: Any
    high: Any
    draws: np.ndarray = field(repr=False)
    grid: np.ndarray | None = None
    grid_name: str = ""
    grid_unit: str = ""
    per: float = 1.0
    shown_unit: str = ""
    shown_grid: np.ndarray | None = None
    shown_grid_unit: str = ""

    @property
    def shown(self) -> DerivedQuantity:
        """The same in the display units."""
        if self.shown_grid is None:
            return super().shown
        grid = {"grid": self.shown_grid, "grid_unit": self.shown_grid_unit}
        return replace(self, **grid, shown_grid=None, shown_grid_unit="").shown

    def to_json(self) -> dict[str, Any]:
        """Median and interval as plain data, infinite times as ``null``; also in display units."""
        return {**self._plain(), "written": self.shown._plain()}

    def _plain(self) -> dict[str, Any]:
        data = {"unit": self.unit, "median": self.median, "low": self.low, "high": self.high}
        if self.grid is not None:
            data["grid"] = {"name": self.grid_name, "unit": self.grid_unit, "values": self.grid}
        return data


def summarised(
    name: str, unit: str, values: np.ndarray, level: float, *grid: Any
) -> DerivedQuantity:
    """Summarise values by draw, ``(n,)``, or ``(n, m)`` over a grid."""
    # a missing response counts as infinitely late, which cannot be interpolated
    method = "linear" if np.all(np.isfinite(values)) else "inverted_cdf"
    low, median, high = central(values, level, axis=0, method=method)
    if values.ndim == 1:
        median, low, high = float(median), float(low), float(high)
    return DerivedQuantity(name, unit, median, low, high, values, *grid)
