"""The predictive band of one channel, from predictions by draws of the parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace
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

_HALVINGS = 32
"""The ends of a band with noise are found by bisection, to this many binary digits."""


@dataclass(frozen=True, repr=False)
class Band(Brief):
    """The predictive band of one channel, ``(T,)`` each, in ``unit``.

    Args:
        measured: the samples; NaN if missing. Angles are shifted to the turn of the band.
        median: of the predictions by the draws, without noise.
        low: lower end for the prediction without noise.
        high: upper end.
        noisy_low: lower end for the sensor's reading.
        noisy_high: upper end.
        coverage: share of the samples inside the band with noise (without, where ``noise=False``).
        samples: number of measured samples.
        unit: of all but the coverage.
        per: number of ``shown_unit`` per ``unit``.
        shown_unit: display unit, in which the log was written.
    """

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

    @property
    def shown(self) -> Band:
        """The same in the display unit."""
        names = ("measured", "median", "low", "high", "noisy_low", "noisy_high")
        series = {name: self.per * getattr(self, name) for name in names}
        return replace(self, **series, unit=self.shown_unit or self.unit, per=1.0, shown_unit="")


def band_of(
    drawn: Draws,
    record: Record,
    channel: str,
    mean: np.ndarray,
    shown: np.ndarray | None,
    level: float,
    noise: bool,
) -> Band:
    """The band of one channel, and its coverage of the measurements.

    ``mean`` are predictions by draw without noise, ``shown`` with random forces and noise, ``(n,
    T)`` each; if ``None``, noise is added to ``mean`` in closed form. ``noise`` says whether the
    coverage refers to the band with it.
    """
    unit = drawn.model.outputs[channel]
    # the sensor gives the size: bands of the signed output would reach below zero
    if channel in record.unsigned:
        mean = np.abs(mean)
        shown = None if shown is None else np.abs(shown)
    fine = np.all(np.isfinite(mean), axis=1)
    fine_shown = fine if shown is None else np.all(np.isfinite(shown), axis=1)
    if not (fine.any() and fine_shown.any()):
        raise InputError(
            f"{record.name}: no draw of the parameters gives a finite {channel}.",
            "Look at the posterior; raise substeps.",
        )
    tails = [0.5 * (1 - level), 0.5, 0.5 * (1 + level)]
    # draws at which the simulation fails are left out; one of two hundred must not end the
    # prediction
    low, median, high = np.quantile(mean[fine], tails, axis=0)
    sigma = drawn.noise.get(channel)
    noisy_low, noisy_high = low, high
    if shown is not None:
        noisy_low, noisy_high = np.quantile(shown[fine_shown], [tails[0], tails[2]], axis=0)
    elif sigma is not None:
        law = LOSSES[drawn.loss]
        ends = [mixed_quantile(law, mean[fine], sigma[fine], p) for p in (tails[0], tails[2])]
        noisy_low, noisy_high = (np.asarray(end) for end in ends)
    measured = record.observed[channel]
    if channel in drawn.model.angles:
        # an angle may be logged a turn away from the simulated one
        turns = np.round((measured - median) / (2 * np.pi))
        measured = measured - 2 * np.pi * turns
    valid = np.isfinite(measured)
    inside = (measured >= noisy_low) & (measured <= noisy_high)
    if not noise:
        inside = (measured >= low) & (measured <= high)
    share = float(np.mean(inside[valid])) if valid.any() else float("nan")
    ends = (low, high, noisy_low, noisy_high)
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
