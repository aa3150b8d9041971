"""A fleet: what all fits of its vehicles say together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.figures import showing
from diffthrust._support.progress import ProgressOption, progressing, teller
from diffthrust._support.report import Report
from diffthrust._support.results import Result
from diffthrust.logs._log import Log
from diffthrust.many._fleet.axis import Axis, axes_of
from diffthrust.many._fleet.entries import ERROR, Entry, Labels, entries_of
from diffthrust.many._fleet.times import times_of

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from diffthrust.many._fleet.pooled import Pooled

_FALSE_ALARMS = 0.05
"""Probability that a fleet in which nothing drifts, or no vehicle differs, raises any alarm."""


@dataclass(frozen=True, eq=False, repr=False)
class Fleet(Result):
    """All fits of a fleet; made by `fleet`.

    Parameters are compared in the coordinate of a fit: by their logarithm where they are positive
    by nature, else by their value. Of a vehicle with several fits, the mean weighted by their
    errors stands for it; where they scatter by more than their errors, its error grows by as much.

    Args:
        entries: one for each fit, those of failed fits included.
        axes: the coordinate of each parameter that some fit estimated.
        time_unit: of the time stamps; "day" where they were dates.
        notes: what the user should know besides.

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

    entries: tuple[Entry, ...] = field(repr=False)
    axes: Mapping[str, Axis] = field(repr=False)
    time_unit: str
    notes: tuple[str, ...]

    @property
    def vehicles(self) -> tuple[str, ...]:
        """Names of the vehicles, in the order in which they came."""
        return tuple(dict.fromkeys(entry.vehicle for entry in self.entries))

    @cached_property
    def times(self) -> np.ndarray:
        """When each fit was made, ``(n,)``: dates as days since the first; NaN where not known."""
        return times_of([entry.time for entry in self.entries])[0]

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

    def series(self, vehicle: str, parameter: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times, coordinates and their standard errors of one parameter over a vehicle's fits."""
        axis, points = self.axes[parameter], []
        for entry, time in zip(self.entries, self.times, strict=True):
            value, error = entry.estimates.get(parameter, (np.nan, None))
            if entry.vehicle != vehicle or not entry.usable or error is None:
                continue
            at = float(axis.coordinate(value))
            if np.isfinite(at):
                points.append((time, at, error / float(axis.slope(value))))
        times, values, errors = np.array(points, float).reshape(-1, 3).T
        return times, values, errors

    def spread(self) -> pd.DataFrame:
        """How far each parameter differs between vehicles.

        Returns:
            A row for each parameter that two vehicles have: ``median`` and ``robust_sd`` (1.4826
            median absolute deviations) of the vehicles' estimates; ``between_sd``, what is left of
            their spread beyond the errors of the fits (Paule & Mandel 1982); ``share``, the share
            of the spread beyond those errors, I^2 (Higgins & Thompson 2002); Cochran's ``q`` with
            its ``dof`` and ``p_value``, by which the vehicles are alike but for those errors.
        """
        from diffthrust.many._fleet.views import spread_table

        return spread_table(self)

    def drift(self, *, false_alarms: float = _FALSE_ALARMS) -> pd.DataFrame:
        """How parameters change over time within a vehicle.

        Args:
            false_alarms: probability that any of these trends is told where there is none (Holm
                1979, over all rows).

        Returns:
            A row for each vehicle and parameter with fits at two times or more: the ``slope`` in
            ``unit`` with its standard error, ``relative`` to the parameter's mean; ``dispersion``,
            by how much the fits scatter about the line beyond their errors (the slope's error has
            grown by it); ``p_value``, and whether it ``drifts``.

        Raises:
            InputError: no times were given.

        Example:
            >>> drift = fleet.drift(false_alarms=0.05)
            >>> figure = fleet.plot_drift()
        """
        from diffthrust.many._fleet.views import drift_table

        if np.isnan(self.times).any():
            raise InputError(
                "The fits have no times, without which nothing drifts.",
                "Give dft.many.fleet(..., time=[...]), or a table with a column 'time'.",
            )
        return drift_table(self, _share("false_alarms", false_alarms))

    def effects(self) -> pd.DataFrame:
        """Which effects were found where.

        Returns:
            A row for each vehicle: how many ``fits`` it has, and for each effect the share of them
            that have it.

        Example:
            >>> fleet.effects()
                     fits
            vehicle
            auv0        2
            auv1        2
            auv2        2
        """
        from diffthrust.many._fleet.views import effects_table

        return effects_table(self)

    def outliers(self, *, false_alarms: float = _FALSE_ALARMS) -> pd.DataFrame:
        """Which vehicles are far from all others.

        The distance of a vehicle from the mean of the others, over the standard deviation that it
        should have: its own error, the others' spread, and the error of their mean. Under a
        Gaussian fleet it follows Student's law with two degrees of freedom fewer than vehicles
        (Higgins, Thompson & Spiegelhalter 2009). Two outliers on one side hide each other in part.

        Args:
            false_alarms: probability that any vehicle is told in a fleet without outliers (Holm
                1979, over all rows).

        Returns:
            A row for each vehicle and parameter that four vehicles have, farthest first.

        Example:
            >>> fleet.outliers(false_alarms=0.05).shape[0]
            0
        """
        from diffthrust.many._fleet.views import outlier_table

        return outlier_table(self, _share("false_alarms", false_alarms))

    @progressing
    def pool(
        self,
        parameters: Sequence[str] | None = None,
        *,
        logs: Mapping[str, Log | Sequence[Log]] | None = None,
        correlated: bool = False,
        draws: int = 1000,
        warmup: int = 1000,
        chains: int = 4,
        seed: int = 0,
        level: float = 0.95,
        progress: ProgressOption = None,
    ) -> Pooled:
        """Estimate all vehicles at once: one with little data borrows from the others.

        Each vehicle's parameters are drawn from a Gaussian law of the fleet in the fit's
        coordinates, whose mean and standard deviations are estimated with them. The prior of the
        mean is flat. That of each standard deviation is half a Student-t law of 4 degrees of
        freedom (Gelman 2006), with a scale of 0.5 in a logarithm (vehicles that differ by a factor
        of 1.6), else of half the parameter's size. Sampled along the gradient (NUTS), in
        coordinates that are centred for vehicles with much data and not for those with little
        (Betancourt & Girolami 2013; Papaspiliopoulos, Roberts & Sköld 2007).

        A vehicle enters by estimate and covariance of its fit, or, named in ``logs``, by its exact
        likelihood, with its own initial states and noise: better where a fit is far from
        Gaussian, and the only way where parameters cannot be told apart (status
        ``not_identifiable``, where the covariance says nothing of them).

        Args:
            parameters: which to pool; by default all that three vehicles have.
            logs: the training logs of vehicles, by name, that enter by their exact likelihood;
                their fits need not have converged.
            correlated: parameters may vary together from vehicle to vehicle (prior: Lewandowski,
                Kurowicka & Joe 2009, shape 2); else they vary each by itself.
            draws: of each chain, after the warmup.
            warmup: steps before.
            chains: of NUTS.
            seed: equal seeds give equal draws.
            level: probability of the intervals.
            progress: True for a bar, or a function of a message and the share done.

        Returns:
            A `Pooled`: ``.table``, ``.population``, ``.predict_new()``, ``.convergence``.

        Raises:
            InputError: fewer than three vehicles, a parameter that too few have, logs of another
                fit, a parameter with a prior of its own, or arguments out of range.

        Example:
            >>> pooled = fleet.pool(["ct"])
            >>> pooled.table.shape[0]
            3
        """
        from diffthrust.many._fleet.pool import pool_vehicles  # slow to import

        return pool_vehicles(
            self,
            parameters,
            dict(logs or {}),
            correlated=correlated,
            draws=draws,
            warmup=warmup,
            chains=chains,
            seed=seed,
            level=_share("level", level),
            progress=teller(progress),
        )

    @showing
    def plot_spread(self) -> Figure:
        """Each parameter of each vehicle with its 95 % interval, and the fleet behind."""
        from diffthrust.many._fleet.figures import spread_figure

        return spread_figure(self, self.outliers())

    @showing
    def plot_drift(self) -> Figure:
        """Each parameter over time, a line for each vehicle; those that drift stand out."""
        from diffthrust.many._fleet.figures import drift_figure

        return drift_figure(self, self.drift())

    @showing
    def plot_effects(self) -> Figure:
        """Which effects were found where.

        Example:
            >>> fleet.effects().shape
            (3, 1)
        """
        from diffthrust.many._fleet.figures import effects_figure

        return effects_figure(self.effects())

    def _line(self) -> str:
        return f"{len(self.entries)} fits of {len(self.vehicles)} vehicles"

    def _report(self) -> Report:
        from diffthrust.many._fleet.tables import fleet_report

        drift = None if np.isnan(self.times).any() else self.drift()
        return fleet_report(self, self.spread(), self.outliers(), drift, self.effects(), self.notes)


def fleet(source: Any, *, vehicle: Labels = None, time: Labels = None) -> Fleet:
    """All fits of a fleet together.

    Args:
        source: what holds the fits: `many.Many`; a dictionary from vehicle to its fit or fits; a
            list of fits; a table with ``name``, and for each parameter a column and one with
            ``_std_error`` behind its name; a `Campaign`, its folder or its ``campaign.parquet``.
        vehicle: whose each fit is: a list, a dictionary by the names of fits, or a function of
            the name. By default a table's column ``vehicle``, the first folder of a campaign's
            spec, the name of a member.
        time: when each was made: a list, dictionary or function of numbers or dates (ISO 8601). By
            default a table's column ``time``, where there is one.

    Returns:
        A `Fleet`.

    Raises:
        InputError: no fits, a file that cannot be read, fits of several models, or names and times
            that do not match the fits.

    Example:
        >>> fleet = dft.many.fleet(
        ...     fits, vehicle=lambda name: name.split("/")[0], time=[0.0, 1.0] * 3
        ... )
        >>> fleet.vehicles
        ('auv0', 'auv1', 'auv2')
    """
    entries, notes = entries_of(source, vehicle, time)
    left = [entry.name for entry in entries if not entry.usable]
    if left:
        notes.append(f"Not converged, and left out of all but the table: {', '.join(left)}.")
    unit = times_of([entry.time for entry in entries])[1]
    return Fleet(tuple(entries), axes_of(entries), unit, tuple(notes))


def _share(what: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, float) or not 0 < value < 1:
        raise InputError(f"{what}: expected a number in (0, 1), found {value!r}.", "Correct it.")
    return value
