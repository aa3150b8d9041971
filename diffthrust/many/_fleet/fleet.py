"""A fleet: all fits of its vehicles, analysed together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.figures import showing
from diffthrust._support.progress import ProgressOption, progressing, reporter
from diffthrust._support.report import Report
from diffthrust._support.results import Result
from diffthrust._support.validation import finite
from diffthrust.logs._log import Log
from diffthrust.many._fleet.entries import ERROR, Labels, axes_of, entries_of, times_of
from diffthrust.many._fleet.figures import drift_figure, effects_figure, spread_figure
from diffthrust.many._fleet.statistics import (
    Estimates,
    between,
    holm,
    trend,
    vehicle_means,
    weighted_mean,
)
from diffthrust.many._fleet.tables import fleet_report

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from diffthrust.many._fleet.pooled import Pooled


_FALSE_ALARMS = 0.05
"""Probability that a fleet in which nothing drifts, or no vehicle differs, raises any alarm."""
_MAD = 1.4826
"""Standard deviations in a median absolute deviation of a Gaussian."""


@dataclass(frozen=True, eq=False, repr=False)
class Fleet(Estimates, Result):
    """All fits of a fleet; made by `fleet`.

    Parameters are compared in the coordinate of a fit: by their logarithm if they are positive by
    nature, else by their value. A vehicle with several fits is represented by their weighted mean;
    if they scatter beyond their errors, its error grows accordingly.

    Args:
        entries: one for each fit, including failed fits.
        axes: the coordinate of each estimated parameter.
        times: time of each fit, ``(n,)``: dates as days since the first; NaN if unknown.
        time_unit: unit of the times; "day" for dates.
        notes: remarks for the user.

    Example:
        >>> fleet.vehicles, fleet.times
        (('auv0', 'auv1', 'auv2'), array([0., 1., 0., 1., 0., 1.]))
        >>> fleet.table.shape[0], len(fleet.series("auv0", "ct"))
        (6, 3)
        >>> fleet.spread().shape[0], list(fleet.spread())[:1]
        (3, ['parameter'])
        >>> figure = fleet.plot_spread()
        >>> figure = fleet.plot_drift()
    """

    notes: tuple[str, ...]

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row for each fit: name, vehicle, time, status, errors, parameters."""
        import pandas as pd

        rows = []
        for entry in self.entries:
            row = {"name": entry.name, "vehicle": entry.vehicle, "time": entry.time}
            row |= {"model": entry.model, "effects": ", ".join(entry.effects), **entry.columns}
            for name, (value, error) in entry.estimates.items():
                row |= {name: value, f"{name}{ERROR}": error}
            rows.append(row)
        return pd.DataFrame(rows)

    def spread(self) -> pd.DataFrame:
        """Spread of each parameter between vehicles.

        Returns:
            A row for each parameter that two vehicles have: ``median`` and ``robust_sd`` (1.4826
            median absolute deviations) of the vehicles' estimates; ``between_sd``, their
            spread beyond the errors of the fits (Paule & Mandel 1982); ``share``, the share of the
            spread beyond those errors, I^2 (Higgins & Thompson 2002); Cochran's ``q`` with its
            ``dof`` and ``p_value`` for vehicles that differ only by those errors.
        """
        import pandas as pd
        from scipy.stats import chi2

        rows = []
        for name, axis in self.axes.items():
            means = vehicle_means(self, name)
            if len(means.vehicles) < 2:
                continue
            mean = weighted_mean(means.values, means.errors)
            values = axis.value(means.values)
            median = float(np.median(values))
            robust = _MAD * float(np.median(np.abs(values - median)))
            sd = between(means.values, means.errors) * float(axis.slope(np.asarray(median)))
            share = max(0.0, 1.0 - mean.dof / mean.q) if mean.q > 0 else 0.0
            test = (mean.q, mean.dof, float(chi2.sf(mean.q, mean.dof)))
            rows.append((name, axis.unit, len(means.vehicles), median, robust, sd, share, *test))
        columns = ["parameter", "unit", "vehicles", "median", "robust_sd", "between_sd", "share"]
        return pd.DataFrame(rows, columns=[*columns, "q", "dof", "p_value"])

    def drift(self, *, false_alarms: float = _FALSE_ALARMS) -> pd.DataFrame:
        """How parameters change over time within a vehicle.

        Args:
            false_alarms: probability of reporting any trend if there is none (Holm 1979, over all
                rows).

        Returns:
            A row for each vehicle and parameter with fits at two times or more: the ``slope`` in
            ``unit`` with its standard error, ``relative`` to the parameter's mean; ``dispersion``,
            factor by which scatter about the line exceeds the errors (the slope's error includes
            it); ``p_value``, and whether it ``drifts``.

        Raises:
            InputError: no times were given.

        Example:
            >>> drift = fleet.drift(false_alarms=0.05)
            >>> figure = fleet.plot_drift()
        """
        import pandas as pd

        if np.isnan(self.times).any():
            raise InputError(
                "The fits have no times, which a drift needs.",
                "Give dft.many.fleet(..., time=[...]), or a table with a column 'time'.",
            )
        level = _share("false_alarms", false_alarms)
        rows = []
        for vehicle in self.vehicles:
            for name, axis in self.axes.items():
                line = trend(*self.series(vehicle, name))
                if line is None:
                    continue
                value = axis.value(line.level)
                per = float(axis.slope(value))
                slope = line.slope * per
                unit = f"{axis.unit or '1'} per {self.time_unit}"
                size = (line.fits, slope, line.error * per, slope / abs(float(value)))
                rows.append((vehicle, name, unit, *size, line.dispersion, line.p_value))
        columns = ["vehicle", "parameter", "unit", "fits", "slope", "slope_std_error", "relative"]
        table = pd.DataFrame(rows, columns=[*columns, "dispersion", "p_value"])
        table["drifts"] = holm(table["p_value"].to_numpy(float), level)
        return table

    def effects(self) -> pd.DataFrame:
        """Effects found on each vehicle.

        Returns:
            A row for each vehicle: its number of ``fits``, and for each effect the share of fits
            that have it.

        Example:
            >>> fleet.effects()
                     fits
            vehicle
            auv0        2
            auv1        2
            auv2        2
        """
        import pandas as pd

        names = list(dict.fromkeys(e for entry in self.entries for e in entry.effects))
        rows = {}
        for vehicle in self.vehicles:
            fits = [entry for entry in self.entries if entry.vehicle == vehicle]
            shares = (sum(e in entry.effects for entry in fits) / len(fits) for e in names)
            rows[vehicle] = [len(fits), *shares]
        table = pd.DataFrame.from_dict(rows, orient="index", columns=["fits", *names])
        return table.rename_axis("vehicle")

    def outliers(self, *, false_alarms: float = _FALSE_ALARMS) -> pd.DataFrame:
        """Vehicles that differ from all others.

        The distance of a vehicle from the mean of the others is divided by its expected standard
        deviation: its error, the others' spread, and the error of their mean. In a Gaussian fleet
        the ratio follows Student's t with two degrees of freedom fewer than vehicles (Higgins,
        Thompson & Spiegelhalter 2009). Two outliers on the same side partly mask each other.

        Args:
            false_alarms: probability of reporting any vehicle in a fleet without outliers (Holm
                1979, over all rows).

        Returns:
            A row for each vehicle and parameter that four vehicles have, farthest first.

        Example:
            >>> fleet.outliers(false_alarms=0.05).shape[0]
            0
        """
        import pandas as pd
        from scipy.stats import t as student

        level = _share("false_alarms", false_alarms)
        rows = []
        for name, axis in self.axes.items():
            means = vehicle_means(self, name)
            for i, vehicle in enumerate(means.vehicles):
                # Student's t of the test has two degrees of freedom fewer than vehicles: with three
                # vehicles, one, whose tails let nothing be significant.
                if len(means.vehicles) < 4:
                    break
                values, errors = np.delete(means.values, i), np.delete(means.errors, i)
                sd = between(values, errors)
                peers = weighted_mean(values, np.hypot(errors, sd))
                away = float(np.sqrt(means.errors[i] ** 2 + sd**2 + peers.error**2))
                distance = float((means.values[i] - peers.value) / away)
                values_at = [float(axis.value(x)) for x in (means.values[i], peers.value)]
                p_value = 2.0 * float(student.sf(abs(distance), peers.dof))
                rows.append((vehicle, name, axis.unit, *values_at, distance, p_value))
        columns = ["vehicle", "parameter", "unit", "value", "others", "distance", "p_value"]
        table = pd.DataFrame(rows, columns=columns)
        table["outlier"] = holm(table["p_value"].to_numpy(float), level)
        return table.sort_values("p_value", ignore_index=True)

    @progressing
    def pool(
        self,
        parameters: Sequence[str] | None = None,
        *,
        logs: Mapping[str, Log | Sequence[Log]] | None = None,
        draws: int = 1000,
        warmup: int = 1000,
        chains: int = 4,
        seed: int = 0,
        level: float = 0.95,
        progress: ProgressOption = None,
    ) -> Pooled:
        """Estimate all vehicles jointly: a vehicle with little data borrows from the others.

        Each vehicle's parameters are drawn from a Gaussian law of the fleet in the fit's
        coordinates, whose mean and standard deviations are estimated with them. The prior of the
        mean is flat. That of each standard deviation is half a Student-t law of 4 degrees of
        freedom (Gelman 2006), with a scale of 0.5 in a logarithm (vehicles that differ by a factor
        of 1.6), else of half the parameter's size. Sampled by NUTS, in
        coordinates centred for vehicles with much data and non-centred for those with little
        (Betancourt & Girolami 2013; Papaspiliopoulos, Roberts & Sköld 2007).

        A vehicle enters by estimate and covariance of its fit, or, if named in ``logs``, by its
        exact likelihood with separate initial states and noise: better if the likelihood is far
        from Gaussian, and the only way if parameters are not identifiable (status
        ``not_identifiable``), since the covariance then lacks them.

        Args:
            parameters: parameters to pool; by default all that three vehicles have.
            logs: training logs, by vehicle, of those that enter by their exact likelihood; their
                fits need not have converged.
            draws: per chain, after the warmup.
            warmup: warmup steps per chain.
            chains: number of NUTS chains.
            seed: equal seeds give equal draws.
            level: probability of the intervals.
            progress: True for a bar, or a function of a message and the share done.

        Returns:
            A `Pooled`: ``.table``, ``.population``, ``.predict_new()``, ``.convergence``.

        Raises:
            InputError: there are fewer than three vehicles, too few have a parameter, logs belong
                to another fit, a parameter already has a prior, or an argument is out of range.

        Example:
            >>> pooled = fleet.pool(["ct"])
            >>> pooled.table.shape[0]
            3
        """
        from diffthrust.many._fleet.pooled import pool_vehicles  # slow to import

        sampling = {"draws": draws, "warmup": warmup, "chains": chains, "seed": seed}
        share = _share("level", level)
        return pool_vehicles(
            self, parameters, dict(logs or {}), share, sampling, reporter(progress)
        )

    @showing
    def plot_spread(self) -> Figure:
        """Plot each parameter of each vehicle with its 95 % interval, and the fleet's spread."""
        return spread_figure(self, self.outliers())

    @showing
    def plot_drift(self) -> Figure:
        """Plot each parameter over time, a line for each vehicle; drifting ones are highlighted."""
        return drift_figure(self, self.drift())

    @showing
    def plot_effects(self) -> Figure:
        """Plot the effects found on each vehicle.

        Example:
            >>> fleet.effects().shape
            (3, 1)
        """
        return effects_figure(self.effects())

    def _line(self) -> str:
        return f"{len(self.entries)} fits of {len(self.vehicles)} vehicles"

    def _report(self) -> Report:
        drift = None if np.isnan(self.times).any() else self.drift()
        return fleet_report(self, self.spread(), self.outliers(), drift, self.effects(), self.notes)


def fleet(source: Any, *, vehicle: Labels = None, time: Labels = None) -> Fleet:
    """Collect all fits of a fleet.

    Args:
        source: the fits: a `many.Many`; a dictionary from vehicle to its fit or fits; a list of
            fits; a table with ``name``, and for each parameter a column and one with the suffix
            ``_std_error``; a `Campaign`, its folder or its ``campaign.parquet``.
        vehicle: the vehicle of each fit: a list, a dictionary by the names of fits, or a function
            of the name. By default a table's column ``vehicle``, the first folder of a campaign's
            spec, or the name of a member.
        time: the time of each fit: a list, dictionary or function of numbers or dates (ISO 8601).
            By default a table's column ``time``, if any.

    Returns:
        A `Fleet`.

    Raises:
        InputError: there are no fits, a file cannot be read, fits have different models, or names
            or times do not match the fits.

    Example:
        >>> fleet = dft.many.fleet(
        ...     fits, vehicle=lambda name: name.split("/")[0], time=[0.0, 1.0] * 3
        ... )
        >>> fleet.vehicles
        ('auv0', 'auv1', 'auv2')
    """
    entries, notes = entries_of(source, vehicle, time)
    unusable = [entry.name for entry in entries if not entry.usable]
    if unusable:
        notes.append(f"Not converged, and left out of all but the table: {', '.join(unusable)}.")
    times, unit = times_of([entry.time for entry in entries])
    return Fleet(tuple(entries), axes_of(entries), times, unit, tuple(notes))


def _share(what: str, value: float) -> float:
    return finite(what, value, lambda share: 0 < share < 1, "a number in (0, 1)")
