"""Compare all intervals of a fit: which to use, and why they differ."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from diffthrust._support.errors import InputError
from diffthrust._support.progress import ProgressOption, progressing, reporter
from diffthrust.estimation._arguments import LIKELIHOODS, NOISE_MODELS
from diffthrust.estimation._estimate import Estimate
from diffthrust.estimation._problem import Problem
from diffthrust.estimation._rebuild import check_mark, problem_of
from diffthrust.estimation._result import Fit
from diffthrust.logs._log import Log
from diffthrust.uncertainty._directions import directions_of
from diffthrust.uncertainty._prediction.draws import check_level
from diffthrust.uncertainty._profile import degrees_of, profiles_of, threshold_of
from diffthrust.uncertainty._results import Intervals, Profiles
from diffthrust.uncertainty._sandwich import (
    Sandwich,
    converged,
    quantile,
    sample_scores,
    sandwich_of,
)
from diffthrust.uncertainty._values import Interval, Profile, Row

_WHITE = 0.1
"""Residuals with a lag-one correlation below this count as white: standard errors are then too
short by at most a tenth."""
_WIDER = 1.25
"""The sandwich is preferred if it is wider than the covariance by this factor and beyond chance."""


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
        >>> found = dft.intervals(fit, log)
        >>> found["alpha"].best.low < fit.parameters["alpha"].value < found["alpha"].best.high
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
    told: Any = {"sentences": tuple(sentences(evidence)), "bounds": profile.bounds}
    return _row_of(name, estimate, by_method, recommended, **told)


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


_APART = 0.2
"""Two intervals disagree where an end differs by this share of the arm it belongs to."""
_CLEARLY = 1.25
"""A sandwich and a covariance disagree where one is wider by this factor."""


@dataclass(frozen=True)
class Evidence:
    """What is known of one parameter's intervals.

    The sandwich is ``inflation`` times as wide as the covariance, within ``chance``; the
    ``correlation`` is that of residuals taken as white; ``met`` are other parameters whose bounds
    are within their own intervals.
    """

    fit: Fit
    profile: Profile
    intervals: Mapping[str, Interval]
    inflation: float | None
    chance: float
    correlation: float
    prior: bool
    recommended: str
    met: tuple[str, ...] = ()


def heading(fit: Fit, lag: float, correlated: bool, sandwich: bool) -> str:
    """The recommendation, with its reason."""
    lasting = NOISE_MODELS[fit.noise_model].lasts
    if correlated:
        kind = "What is new in the noise is" if lasting else "Residuals are"
        mend = "something is missing from the model" if lasting else _mend(fit)
        return (
            f"{kind} correlated from sample to sample ({lag:.2f}) where the fit takes them as "
            f"white: covariance, profile and posterior are too narrow, take the sandwich. To "
            f"narrow it down: {mend}."
        )
    if sandwich:
        return (
            "Residuals are white, but not of one size or law: take the sandwich where it is "
            "marked, else the profile."
        )
    what = "What is new in the noise at each sample is" if lasting else "Residuals are"
    return f"{what} white, as the fit takes them: take the profile."


def _mend(fit: Fit) -> str:
    if LIKELIHOODS[fit.likelihood].corrects or not fit.model.states:
        return "look for what the model lacks (diagnose)"
    return (
        'look for what the model lacks (diagnose), or fit with noise_model="ar1" or '
        'likelihood="innovations"'
    )


def sentences(e: Evidence) -> Iterator[str]:
    """A sentence for each disagreement."""
    name = e.profile.name
    estimate = e.fit.parameters[name]
    if estimate.at_bound:
        yield (
            f"{name} lies at its bound: it has no standard error there, only the profile says how "
            "far it may be from it."
        )
    elif estimate.std_error is None:
        yield (
            f"{name} has no standard error: these logs cannot tell it from others; the profile "
            "says what is known of it alone."
        )
    whys = ("downwards", e.profile.open_low), ("upwards", e.profile.open_high)
    for (side, why), bound in zip(whys, e.profile.bounds, strict=True):
        if why and not (estimate.at_bound and bound is not None):
            it = "it " if bound is not None else ""
            yield f"{name}: {side} the profile is open; {it}{why}."
    yield from _lopsided(e, name)
    yield from _inflated(e, name)
    yield from _posterior_apart(e, name)


def _lopsided(e: Evidence, name: str) -> Iterator[str]:
    if not e.profile.longer_arm:
        return
    met = f", for {' and '.join(e.met)} may meet a bound" if e.met else ""
    expect = ": expect the same of the truth, within the width of the sandwich"
    yield (
        f"{name}: the profile reaches {e.profile.longer_arm}. The likelihood is not quadratic "
        f"there{met}, and covariance and sandwich are symmetric by construction"
        f"{expect if e.recommended == 'sandwich' else ''}."
    )


def _inflated(e: Evidence, name: str) -> Iterator[str]:
    if e.inflation is None or 1 / _CLEARLY < e.inflation < _CLEARLY:
        return
    words = f"{name}: the sandwich is {e.inflation:.2g} times as wide as the covariance: "
    if e.correlation:
        yield f"{words}residuals are correlated from sample to sample ({e.correlation:.2f})."
    elif abs(e.inflation - 1) < e.chance:
        yield f"{words}no more than chance gives on so few samples."
    elif e.inflation < 1:
        yield f"{words}residuals are small where this parameter acts most, or alternate in sign."
    else:
        yield f"{words}residuals are large, or last long, where this parameter acts most."


def _posterior_apart(e: Evidence, name: str) -> Iterator[str]:
    drawn, profile = e.intervals.get("posterior"), e.intervals["profile"]
    if drawn is None or drawn.low is None or drawn.high is None:
        return
    ends = (("lower", drawn.low, profile.low), ("upper", drawn.high, profile.high))
    apart = [
        side
        for side, here, end in ends
        if end is not None and abs(here - end) > _APART * max(abs(end - e.profile.value), 1e-300)
    ]
    if not apart:
        return
    where = f"the {apart[0]} end" if len(apart) == 1 else "both ends"
    if e.profile.lopsided is None or e.profile.longer_arm:
        why = (
            "the likelihood is not quadratic, and a posterior averages over the other parameters "
            "where a profile takes their best"
        )
    elif e.prior:
        why = "the draws follow the density of the prior, which weighs values once more"
    else:
        why = (
            "a bound or the prior cuts the posterior off, other parameters are far from quadratic, "
            "or the chains have not converged"
        )
    yield f"{name}: posterior and profile differ at {where}: {why}."
