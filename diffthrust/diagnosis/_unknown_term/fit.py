"""Terms fitted to whole runs as curves.

Terms are compared by quick fits, from one start and with as few integrator steps as the candidates
of the search have. The one that is reported is fitted again where it needs more steps.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from diffthrust.diagnosis._explained_share import Worth, worth_of
from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit
from diffthrust.diagnosis._learned import LearnedLaw
from diffthrust.diagnosis._residual_structure import place_of
from diffthrust.diagnosis._search_start import few_substeps
from diffthrust.diagnosis._search_state import SearchContext
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._stage_fit import errors_between
from diffthrust.diagnosis._unknown_term.closed_forms import as_estimated
from diffthrust.diagnosis._unknown_term.evidence import LikelyCurve
from diffthrust.diagnosis._unknown_term.terms import (
    NUMBER,
    Term,
    channel_of,
    regressors_of,
    term_along,
    unit_at,
    unit_of,
    units_at,
)
from diffthrust.effects._curve import Curve
from diffthrust.estimation._result import Fit
from diffthrust.models._base.made_effect import ARRIVING
from diffthrust.models._base.model import Model
from diffthrust.simulation._runs import Run, runs_over
from diffthrust.simulation._step_size import fewest_steps

_RANGE_EXCEEDED, _RANGE_UNUSED = 0.05, 0.4
"""Numerics: a curve is moved to the range of its signal if this exceeds the curve's by more than 5
% of it, or leaves 40 % of it unused: beyond its grid a curve goes back to zero, and unused pieces
cost evidence."""
_GRID_POINTS = 241
"""Numerics: values of the signal at which a curve is transferred to another grid."""
_SEGMENTS = (64, 16, 4)
"""Numerics: the longest log is divided into so many segments in turn. An arm out of balance, fitted
to whole runs at once, ended a turn off, at 30 times the error of its true structure."""


def quick_fit(context: SearchContext, baseline: Fit, model: Model, segments: bool = False) -> Fit:
    """A model fitted from its present values, with the fewest integrator steps that serve another.

    That of the ``baseline``. With ``segments`` it is fitted to such first.
    """
    substeps = few_substeps(baseline, context.records)
    horizons = _horizons(context) if segments and model.horizon is None else None
    refit = partial(context.refit, model, starts=1, segments=segments, horizons=horizons)
    fit = refit(like=None if segments else baseline, substeps=substeps).fit
    if math.isfinite(fit.train.nrmse):
        return fit
    return refit().fit  # a stiff curve overflows with few


def _horizons(context: SearchContext) -> tuple[float | None, ...]:
    """Segments through which a model without a horizon of its own comes to whole runs."""
    longest = max(record.duration for record in context.records)
    return (*(longest / parts for parts in _SEGMENTS), None)


def worth_between_fits(context: SearchContext, baseline: Fit, updated: Fit) -> Worth:
    """The share of a fit's whole-run error that another removes."""
    trained, unseen = (
        errors_between(*(_runs_of(context, fit, part) for fit in (baseline, updated)))
        for part in (True, False)
    )
    return worth_of(trained, unseen)


def surely_better(context: SearchContext, fit: Fit, rival: Fit) -> bool:
    """Whether whole runs, training and unseen together, are surely better than a rival's."""
    return worth_between_fits(context, rival, fit).of_all.low > 0


def _runs_of(context: SearchContext, fit: Fit, trained: bool) -> tuple[Run, ...]:
    """The whole runs of a fit over the training logs, or over the unseen ones, if any."""
    over = partial(runs_over, fit.model, substeps=fit.substeps)
    if trained:
        return over(context.records, initial=fit.initial)
    return over(context.unseen, noise=fit.noise_of_runs) if context.unseen else ()


def error_within(fit: Fit, reference: Fit, factor: float) -> bool:
    """Whether the errors over whole runs, training and unseen, are within a factor of another's."""
    trained = fit.train.nrmse <= factor * reference.train.nrmse
    return trained and holdout_error_within(fit, reference, factor)


def holdout_error_within(fit: Fit, reference: Fit, factor: float) -> bool:
    """The same for unseen logs alone; for training logs if there are no others."""
    if reference.holdout is None:
        return fit.train.nrmse <= factor * reference.train.nrmse
    return fit.holdout is not None and fit.holdout.nrmse <= factor * reference.holdout.nrmse


def reaches_noise_floor(context: SearchContext, trial: TrialFit, fit: Fit) -> bool:
    """Whether whole runs err as little as the one-step predictions of a trial."""
    most = SETTINGS.unknown_term.noise_floor
    sizes = context.fitter.sizes(trial)
    return all(fit.train.channels[n].rmse <= most * size for n, size in sizes.items())


def fit_curve(
    context: SearchContext,
    baseline: Fit,
    trial: TrialFit,
    likely: LikelyCurve,
    rival: LearnedLaw | None = None,
) -> LearnedLaw | None:
    """A term fitted to whole runs as a curve; ``None`` if training runs are no better with it.

    Args:
        context: what the search works with.
        baseline: the fit beside which it is fitted.
        trial: the trial beside which it is likely.
        likely: the term, and its curve by one-step errors.
        rival: a law that was fitted before: a term far behind it is not fitted further.
    """
    term = likely.term
    unit = unit_at(context.fitter, term.port, term.times)
    arguments = {**likely.curve.arguments, "unit": unit, "name": _free_name(baseline.model)}
    fit, curve = _with_curve(context, baseline, Curve(**arguments))
    if curve.given:  # with another time constant its signal has another range
        term = term_of(context, trial, curve)
        if (ends := _moved_range(term, curve)) and not _is_hopeless(fit, rival):
            fit, curve = _with_curve(context, baseline, _on_grid(curve, low=ends[0], high=ends[1]))
            term = term_of(context, trial, curve)
    if not fit.train.nrmse < baseline.train.nrmse:
        return None
    units = units_at(context.fitter, curve.port)
    return LearnedLaw(
        curve=curve,
        fit=fit,
        worth=worth_between_fits(context, baseline, fit),
        evidence=likely.evidence,
        samples=term.pooled,
        factors=None if term.factor is None else np.concatenate(term.factor.current),
        signal_unit=unit_of(curve.signal, units),
        channel=channel_of(curve.signal, baseline.model),
        port_unit=units[ARRIVING],
        driven=_driven_channel(context.fitter, curve.port),
    )


def _driven_channel(fitter: CandidateFitter, port: str) -> str:
    """The measured channel that a port drives, or whose rate; "" if that is not measured."""
    place = place_of(fitter, port)
    return place.target if place and place.target in fitter.channels else ""


def term_of(context: SearchContext, trial: TrialFit, curve: Curve) -> Term:
    """The term of a curve along a trial, at the values of the curve's parameters."""
    regressors = regressors_of(context.fitter, trial)
    return term_along(regressors, curve.port, curve.signal, curve.times, _parameters(curve))


def refined(context: SearchContext, baseline: Fit, law: LearnedLaw) -> LearnedLaw:
    """A law as it is reported: of more pieces and finer steps, where these are needed."""
    return _with_steps(context, baseline, _with_pieces(context, baseline, law))


def _with_pieces(context: SearchContext, baseline: Fit, law: LearnedLaw) -> LearnedLaw:
    """A law without a name by a curve of twice the pieces, if that surely removes a tenth.

    The friction of a linear drive turns within 0.03 m/s about rest, one piece of eight: of its
    unseen run the finer curve leaves half of the squared error (EMPS); four times the pieces leave
    as much.
    """
    if law.form:
        return law
    finer = _on_grid(law.curve, pieces=2 * law.curve.pieces)
    fit, curve = _with_curve(context, baseline, finer)
    worth = worth_between_fits(context, law.fit, fit)
    if not (worth.sure and worth.share > SETTINGS.whole_runs.one_channel_share):
        return law
    return replace(law, curve=curve, fit=fit, worth=worth_between_fits(context, baseline, fit))


def _with_steps(context: SearchContext, baseline: Fit, law: LearnedLaw) -> LearnedLaw:
    """A law fitted again if the model that is reported needs more integrator steps."""
    fit, records = law.reported, context.records
    k = max(range(len(records)), key=lambda k: (records[k].log.step, len(records[k].log)))
    needed = fewest_steps(fit.model, records[k], fit.initial[k]).substeps
    if needed <= fit.substeps:
        return law
    fit = context.refit(fit.model, starts=1).fit
    if not math.isfinite(fit.train.nrmse):
        return law
    effect = fit.model.effects[-1]
    if law.form:
        first = replace(law.form, formula=as_estimated(effect), fit=fit)  # pyright: ignore[reportArgumentType]
        law = replace(law, forms=(first, *law.forms[1:]))
    else:
        law = replace(law, curve=effect, fit=fit)
    return replace(law, worth=worth_between_fits(context, baseline, fit))


def _is_hopeless(fit: Fit, rival: LearnedLaw | None) -> bool:
    if rival is None or not rival.helps:
        return False
    return fit.train.nrmse > SETTINGS.whole_runs.equivalent_error * rival.fit.train.nrmse


def _parameters(curve: Curve) -> dict[str, dict[str, Any]]:
    """The parameters of a curve's signal at their present values."""
    return {n: {**curve.given[n], "value": getattr(curve, n)} for n in curve.given}


def _with_curve(context: SearchContext, baseline: Fit, curve: Curve) -> tuple[Fit, Curve]:
    """A model with a curve fitted to whole runs, and the curve as estimated."""
    # segments first along a wave: the error of whole runs has a false minimum at each other wave
    fit = quick_fit(context, baseline, baseline.model + curve, segments=NUMBER in curve.given)
    return fit, fit.model.effects[-1]  # pyright: ignore[reportReturnType]


def _moved_range(term: Term, curve: Curve) -> tuple[float, float] | None:
    """The range of a term's signal, if it differs from that of its curve."""
    low, high = float(term.pooled.min()), float(term.pooled.max())
    beyond, span = max(curve.low - low, high - curve.high), curve.high - curve.low
    moved = beyond > _RANGE_EXCEEDED * span or high - low < (1.0 - _RANGE_UNUSED) * span
    return (low, high) if moved and low < high else None


def _on_grid(curve: Curve, **grid: float) -> Curve:
    """The same curve on another range or with other pieces, by least squares."""
    target = Curve(**{**curve.arguments, **grid, **_parameters(curve)})
    x = np.linspace(target.low, target.high, _GRID_POINTS)
    shape = np.linalg.lstsq(target.basis(x).T, np.asarray(curve.at_signal(x)), rcond=None)[0]
    return Curve(**{**target.arguments, "shape": tuple(map(float, shape))})


def _free_name(model: Model) -> str:
    taken = {effect.name for effect in model.effects}
    names = ("curve", *(f"curve{k}" for k in range(2, 2 * len(taken) + 3)))
    return next(name for name in names if not {name, f"{name}_form"} & taken)
