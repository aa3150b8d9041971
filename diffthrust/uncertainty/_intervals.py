"""Compare all intervals of a fit: which to use, and why they differ."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.figures import showing
from diffthrust._support.progress import ProgressOption, progressing, reporter
from diffthrust._support.report import Report
from diffthrust._support.results import Result, report_of
from diffthrust.estimation._estimate import Estimate
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._rebuild import check_mark, problem_of
from diffthrust.estimation._result import Fit
from diffthrust.logs._log import Log
from diffthrust.uncertainty._directions import Directions, directions_of
from diffthrust.uncertainty._prediction.draws import check_level
from diffthrust.uncertainty._profile import Profiles, degrees_of, profiles_of, threshold_of
from diffthrust.uncertainty._sandwich import (
    Sandwich,
    converged,
    quantile,
    sample_scores,
    sandwich_of,
)
from diffthrust.uncertainty._tables import Evidence, heading, intervals_report, sentences
from diffthrust.uncertainty._values import Interval, Row

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WHITE = 0.1
"""Residuals with a lag-one correlation below this count as white: standard errors are then too
short by at most a tenth."""
_WIDER = 1.25
"""The sandwich is preferred if it is wider than the covariance by this factor and beyond chance."""


_METHODS = ("covariance", "sandwich", "profile", "posterior")


@dataclass(frozen=True, eq=False, repr=False)
class Intervals(Result):
    """Intervals of all free parameters of a fit: ``intervals["alpha"].best``.

    Args:
        rows: by parameter.
        level: of all intervals.
        correlation: lag-one correlation of the residuals assumed white; zero if within chance.
        notes: remarks on all intervals, the recommendation first.
        directions: combinations of parameters, by how well the logs determine them.
        profiles: the profiles behind the intervals.

    Example:
        >>> result = dft.intervals(fit, log)
        >>> result.methods, result.level, len(result.sentences)
        (('covariance', 'sandwich', 'profile'), 0.95, 1)
        >>> list(result.to_json())
        ['schema', 'level', 'correlation', 'notes', 'parameters', 'directions']
        >>> figure = result.plot()
    """

    rows: Mapping[str, Row]
    level: float
    correlation: float
    notes: tuple[str, ...]
    directions: Directions
    profiles: Profiles = field(repr=False)

    def __getitem__(self, name: str) -> Row:
        return self.rows[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.rows)

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def methods(self) -> tuple[str, ...]:
        """The methods for which any parameter has an interval."""
        return tuple(m for m in _METHODS if any(m in row.intervals for row in self.rows.values()))

    @property
    def sentences(self) -> list[str]:
        """Why methods disagree, over all parameters."""
        return [s for row in self.rows.values() for s in row.sentences]

    def _line(self) -> str:
        each = ", ".join(f"{row.name} by {row.recommended}" for row in self.rows.values())
        return f"{100 * self.level:g} %: {each}"

    def _report(self) -> Report:
        rows = [row.shown for row in self.rows.values()]
        directions = report_of(self.directions)
        return intervals_report(rows, self.methods, self.level, self.notes, directions)

    def to_json(self) -> dict[str, Any]:
        """Plain data; ``None`` for an open end."""
        return {
            "schema": 1,
            "level": self.level,
            "correlation": self.correlation,
            "notes": list(self.notes),
            "parameters": {name: row.to_json() for name, row in self.rows.items()},
            "directions": self.directions.to_json(),
        }

    @showing
    def plot(self) -> Figure:
        """Plot the intervals as stacked bars, one panel for each parameter."""
        from diffthrust.uncertainty._figures import intervals_figure

        return intervals_figure([row.shown for row in self.rows.values()], self.methods, self.level)


@progressing
def intervals(
    fit: Fit,
    logs: Log | Sequence[Log],
    posterior: Any = None,
    *,
    level: float = 0.95,
    progress: ProgressOption = None,
) -> Intervals:
    """Covariance, sandwich, profile and posterior intervals of every parameter, side by side.

    One of them is recommended for each parameter: the profile if the residuals are white, as the
    fit's likelihood assumes (under ``noise_model="ar1"``, the residuals of the autoregression), or
    else the sandwich. If two disagree, a sentence says why.

    Args:
        fit: a converged fit with any likelihood, loss and noise model.
        logs: its training logs, in order.
        posterior: draws of the same fit, as returned by `sample` (an ArviZ object with a group
            ``posterior``); its intervals have equal tails.
        level: confidence level of all intervals.
        progress: True for a bar, or a function of a message and the share done.

    Returns:
        `Intervals`, by parameter, with the directions of the information.

    Raises:
        InputError: the fit failed or did not converge, the logs are not its own, the posterior
            lacks a parameter, or the level is outside (0, 1).

    Example:
        >>> result = dft.intervals(fit, log)
        >>> result["alpha"].best.low < fit.parameters["alpha"].value < result["alpha"].best.high
        True
    """
    converged(fit, "intervals")
    check_level(level, "intervals, level")
    if posterior is not None and hasattr(posterior, "posterior"):
        check_mark(posterior, fit, "intervals")
    drawn = {} if posterior is None else {n: _drawn(posterior, n, level) for n in fit.free}
    problem, z = problem_of(fit, logs)
    measured = sample_scores(problem, z)
    robust = sandwich_of(fit, problem, z, measured)
    profiles = profiles_of(fit, problem, z, problem.own, None, {}, level, reporter(progress))
    lag = measured.lag_one()
    reach = _reach(problem, z, level)
    rows = [
        _row(fit, problem, name, profiles, robust, drawn.get(name), lag, reach, level)
        for name in problem.own
    ]
    rows += _rows_by_log(fit, reach)
    notes = [heading(fit, lag, lag > _WHITE, any(r.recommended == "sandwich" for r in rows))]
    if fit.per_log:
        narrow = ", and too narrow here, as residuals are correlated" if lag > _WHITE else ""
        notes.append(f"Values by log have intervals by the covariance alone{narrow}.")
    if profiles.better is not None:
        notes.append(profiles.sentences[-1])
    if posterior is not None:
        notes += _judged(posterior)
    return Intervals(
        rows={row.name: row for row in rows},
        level=level,
        correlation=lag,
        notes=tuple(notes),
        directions=directions_of(problem, z),
        profiles=profiles,
    )


def _rows_by_log(fit: Fit, reach: float) -> list[Row]:
    """The values by log, whose intervals are those of the covariance at the width of the fit."""
    return [
        _row_of(f"{name} in {log}", e, _of_covariance(e, reach), "covariance")
        for name, by_log in fit.per_log.items()
        for log, e in by_log.values.items()
        if e.std_error is not None
    ]


def _row_of(
    name: str, e: Estimate, intervals: Mapping[str, Interval], recommended: str, **more: Any
) -> Row:
    shown: Any = {"per": e.per, "shown_unit": e.shown_unit}
    return Row(name, e.unit, e.value, intervals, recommended, **shown, **more)


def _of_covariance(e: Estimate, reach: float) -> dict[str, Interval]:
    if e.std_error is None:
        return {}
    arm = reach * e.std_error
    return {"covariance": Interval(e.value - arm, e.value + arm)}


def _reach(problem: Problem, z: np.ndarray, level: float) -> float:
    """Half-width of the covariance's interval in standard errors."""
    # the same quantile as the profile's, or intervals would differ where the likelihood is
    # quadratic
    if problem.layout.likelihood.noise.lasts:
        return math.sqrt(threshold_of(problem, z, level))
    return quantile(level, degrees_of(problem, z))


def _row(
    fit: Fit,
    problem: Problem,
    name: str,
    profiles: Profiles,
    robust: Sandwich,
    drawn: Interval | None,
    lag: float,
    reach: float,
    level: float,
) -> Row:
    estimate, profile = fit.parameters[name], profiles[name]
    by_method = _of_covariance(estimate, reach)
    wide = robust.interval(name, level)
    if wide is not None:
        by_method["sandwich"] = Interval(*wide)
    by_method["profile"] = Interval(profile.low, profile.high)
    if drawn is not None:
        by_method["posterior"] = drawn
    unwhite = lag > _WHITE or _wider(robust, name)
    # white residuals: the profile, which is exact to a transform and knows bounds; else the
    # sandwich, the only one of the four that does not take the residuals as white
    recommended = "sandwich" if unwhite and wide is not None else "profile"
    evidence = Evidence(
        fit=fit,
        profile=profile,
        intervals=by_method,
        inflation=robust.inflation[name],
        chance=_chance(robust, name),
        correlation=lag if lag > _WHITE else 0.0,
        prior=problem.named[name].prior is not None,
        recommended=recommended,
        met=tuple(n for n in profiles if n != name and profiles[n].bounds != (None, None)),
    )
    words: Any = {"sentences": tuple(sentences(evidence)), "bounds": profile.bounds}
    return _row_of(name, estimate, by_method, recommended, **words)


def _wider(robust: Sandwich, name: str) -> bool:
    ratio = robust.inflation[name]
    return ratio is not None and ratio > _WIDER + _chance(robust, name)


def _chance(robust: Sandwich, name: str) -> float:
    """How far the inflation may differ from one by chance: three relative standard deviations."""
    return 3 / math.sqrt(2 * robust.degrees[name]) if name in robust.degrees else 0.0


def _drawn(posterior: Any, name: str, level: float) -> Interval:
    try:
        values = np.asarray(posterior.posterior[name].values, float).ravel()
    except (AttributeError, KeyError, TypeError) as error:
        raise InputError(
            f"intervals, posterior: expected an ArviZ object with '{name}' in its group "
            f"'posterior', found {type(posterior).__name__} without it.",
            "Give what dft.sample returns for this fit.",
        ) from error
    if not (values.size and np.isfinite(values).all()):
        raise InputError(
            f"intervals, posterior: the draws of '{name}' are empty or not all finite.",
            "Sample again, and look at the status of the chains.",
        )
    low, high = np.quantile(values, [0.5 - 0.5 * level, 0.5 + 0.5 * level])
    return Interval(float(low), float(high))


def _judged(posterior: Any) -> list[str]:
    """The convergence message of the posterior, unless it converged."""
    attrs = getattr(posterior, "attrs", None) or {}
    if attrs.get("status", "converged") == "converged":
        return []
    return [f"Posterior: {attrs.get('message', attrs['status'])}"]
