"""Fits to whole runs by which laws are compared, and what a law is worth there.

Learned laws fitted to whole runs, as curves and in the form in which they are told.

The name of a learned law: the closed form that does as well as its curve.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from diffthrust.diagnosis._admission import errors_between
from diffthrust.diagnosis._explained_share import Worth, explained_share
from diffthrust.diagnosis._findings import Stage
from diffthrust.diagnosis._innovations_fit import TrialFit
from diffthrust.diagnosis._learned import FORMS_APART, LearnedLaw, TriedForm
from diffthrust.diagnosis._residual_structure import downstream_ports
from diffthrust.diagnosis._search_state import SearchContext, few_substeps
from diffthrust.diagnosis._unknown_term.closed_forms import (
    FORMS,
    Match,
    as_estimated,
    as_formula,
    best_match,
    ranked_matches,
)
from diffthrust.diagnosis._unknown_term.evidence import (
    LikelyCurve,
    LinearizedEvidence,
    evidence_of_fit,
    linearized_evidence,
    model_beside,
)
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
from diffthrust.simulation._step_size import choose_substeps

_NOISE_FLOOR = 1.25
"""Whole runs err as one-step predictions do where by no more than so many times these' size, which
is that of a t-distribution: of Gaussian errors 0.87 of the standard deviation."""


def quick_fit(tools: SearchContext, baseline: Fit, model: Model, segments: bool = False) -> Fit:
    """A model fitted from its values on, with the fewest integrator steps that do for another."""
    few = few_substeps(baseline, tools.fitter.logs)
    fit = tools.refit(model, starts=1, segments=segments, substeps=few)
    if math.isfinite(fit.train.nrmse):
        return fit
    return tools.refit(model, starts=1, segments=segments)


def worth_between_fits(tools: SearchContext, baseline: Fit, updated: Fit) -> Worth:
    """What one fit removes of the whole-run errors of another, on unseen logs if there are any."""
    logs, trained = (tools.unseen, False) if tools.unseen else (tools.fitter.logs, True)
    return explained_share(
        errors_between(Stage((), baseline), Stage((), updated), logs, trained=trained)
    )


def surely_better(tools: SearchContext, fit: Fit, rival: Fit) -> bool:
    """Whether whole runs of training and unseen logs together are surely better with a fit."""
    stages = Stage((), rival), Stage((), fit)
    trained = errors_between(*stages, tools.fitter.logs, trained=True)
    return explained_share([*trained, *errors_between(*stages, tools.unseen)]).low > 0


def error_within(fit: Fit, reference: Fit, times: float) -> bool:
    """Whether whole runs err by no more than so many times as much, on unseen logs as well."""
    return fit.train.nrmse <= times * reference.train.nrmse and holdout_error_within(
        fit, reference, times
    )


def holdout_error_within(fit: Fit, reference: Fit, times: float) -> bool:
    """The same of unseen logs alone; of training logs, where none is unseen."""
    errors, allowed = (
        (fit.holdout, reference.holdout) if reference.holdout else (fit.train, reference.train)
    )
    return errors is not None and errors.nrmse <= times * allowed.nrmse


def reaches_noise_floor(tools: SearchContext, trial: TrialFit, fit: Fit) -> bool:
    """Whether whole runs err as the one-step predictions of a trial do: none can do better."""
    sizes = dict(zip(tools.fitter.channels, trial.quadratic.sigma, strict=True))
    return all(fit.train.channels[n].rmse <= _NOISE_FLOOR * size for n, size in sizes.items())


_RANGE_EXCEEDED, _RANGE_UNUSED = 0.05, 0.4
"""A curve is laid anew where its signal leaves its range by more than such a share of it, or leaves
so much of it empty."""
_HOPELESS_ERROR = 1.1
"""Whole runs err by more than so many times as much with a law that is far behind another."""
_LAID_POINTS = 241


def fit_curve(
    tools: SearchContext,
    baseline: Fit,
    trial: TrialFit,
    likely: LikelyCurve,
    rival: LearnedLaw | None = None,
) -> LearnedLaw | None:
    """A law fitted to whole runs beside a model; ``None`` where these are no better.

    One that is far behind ``rival`` is fitted once.
    """
    law = likely.law
    unit = unit_at(tools.fitter, law.port, law.times)
    arguments = {**likely.curve.arguments, "unit": unit, "name": _free_name(baseline.model)}
    fit, curve = _fitted_curve(tools, baseline, Curve(**arguments))
    if curve.given:  # what it remembers may have another range than at the first guess
        law = term_of(tools, trial, curve)
        if (ends := _moved_range(law, curve)) and not _is_hopeless(fit, rival):
            fit, curve = _fitted_curve(tools, baseline, _laid_over(curve, *ends))
            law = term_of(tools, trial, curve)
    if not fit.train.nrmse < baseline.train.nrmse:
        return None
    units = units_at(tools.fitter, curve.port)
    return LearnedLaw(
        curve=curve,
        fit=fit,
        worth=worth_between_fits(tools, baseline, fit),
        evidence=likely.evidence,
        samples=np.concatenate(law.over),
        factors=None if law.factor is None else np.concatenate(law.factor),
        signal_unit=unit_of(curve.signal, units),
        channel=channel_of(curve.signal, baseline.model),
        port_unit=units[ARRIVING],
    )


def _is_hopeless(fit: Fit, rival: LearnedLaw | None) -> bool:
    """Whether a fit is far behind another law that is worth something surely."""
    return bool(
        rival and rival.worth.sure and fit.train.nrmse > _HOPELESS_ERROR * rival.fit.train.nrmse
    )


def term_of(tools: SearchContext, trial: TrialFit, curve: Curve) -> Term:
    """The law of a curve along the path of a trial, what it remembers being as in the curve."""
    regressors = regressors_of(tools.fitter, trial)
    return term_along(regressors, curve.port, curve.signal, curve.times, _parameters(curve))


def _parameters(curve: Curve) -> dict[str, dict[str, Any]]:
    """The parameters of a curve's signal, as they are now."""
    return {n: {**curve.given[n], "value": getattr(curve, n)} for n in curve.given}


def _fitted_curve(tools: SearchContext, baseline: Fit, curve: Curve) -> tuple[Fit, Curve]:
    """A fitted model with a curve, fitted to whole runs, and the curve as it is then."""
    # whole runs have many false minima along a wave
    fit = quick_fit(tools, baseline, baseline.model + curve, segments=NUMBER in curve.given)
    return fit, fit.model.effects[-1]  # pyright: ignore[reportReturnType]


def refine_steps(tools: SearchContext, baseline: Fit, law: LearnedLaw) -> LearnedLaw:
    """A law with the model that is told fitted with as many integrator steps as that needs."""
    reported, logs = law.told, tools.fitter.logs
    k = max(range(len(logs)), key=lambda k: (logs[k].step, len(logs[k])))
    if (
        choose_substeps(reported.model, logs[k], initial=reported.initial[k], warn=False)
        <= reported.substeps
    ):
        return law
    fit = tools.refit(reported.model, starts=1)
    if not math.isfinite(fit.train.nrmse):
        return law
    effect = fit.model.effects[-1]
    if law.form:
        first = replace(law.form, formula=as_estimated(effect), fit=fit)  # pyright: ignore[reportArgumentType]
        law = replace(law, forms=(first, *law.forms[1:]))
    else:
        law = replace(law, curve=effect, fit=fit)
    return replace(law, worth=worth_between_fits(tools, baseline, fit))


def _moved_range(law: Term, curve: Curve) -> tuple[float, float] | None:
    """The range of a law's signal, where it is another one than that of its curve."""
    low, high = float(min(map(np.min, law.over))), float(max(map(np.max, law.over)))
    beyond, span = max(curve.low - low, high - curve.high), curve.high - curve.low
    moved = beyond > _RANGE_EXCEEDED * span or high - low < (1.0 - _RANGE_UNUSED) * span
    return (low, high) if moved and low < high else None


def _laid_over(curve: Curve, low: float, high: float) -> Curve:
    """The same curve on another range."""
    target = Curve(**{**curve.arguments, "low": low, "high": high, **_parameters(curve)})
    x = np.linspace(low, high, _LAID_POINTS)
    shape = np.linalg.lstsq(target.basis(x).T, np.asarray(curve.at_signal(x)), rcond=None)[0]
    return Curve(**{**target.arguments, "shape": tuple(map(float, shape))})


def _free_name(model: Model) -> str:
    taken = {effect.name for effect in model.effects}
    names = ("curve", *(f"curve{k}" for k in range(2, 2 * len(taken) + 3)))
    return next(name for name in names if not {name, f"{name}_form"} & taken)


_GAIN_OF_CURVE = 0.7
"""A closed form that promises no less than this of what the curve does may be its law (effects
beside it that only imitated the law have bent the curve),"""
_GAIN_OF_BEST = 0.5
"""and so much of what the likeliest form does,"""
_MOST_FORMS = 3
"""and so many are fitted in its place, with the plain forms that they come near to."""
_TIED_CRITERION = 0.2
"""Criteria no further apart are the same: of a signal of one sign two forms are one."""
_EQUAL_ERROR = 1.002
"""Where whole runs err by no more than so many times as much with a form as with the curve, and it
is surely worth something, one of more parameters is tried only if one-step errors rather ask for
it."""
_GAIN_NEAR_CURVE = 0.95
"""A form that can be so much of what the curve is, is fitted from there first."""
_NAMED_ERROR = 1.1
"""A form is a law's name where whole unseen runs (training runs, where no log is unseen) err by no
more than so many times as much with it: a curve may bend as noise does."""


def try_closed_forms(
    tools: SearchContext, baseline: Fit, trial: TrialFit, law: LearnedLaw
) -> LearnedLaw:
    """A learned law with the closed forms that were tried in its place.

    Args:
        tools: what the search worked with.
        baseline: the fit without the law.
        trial: the trial beside which it was learned.
        law: the law.
    """
    tried = sorted(_fitted_forms(tools, baseline, trial, law), key=lambda form: form.bic)
    if tried:
        first = _plainest(
            _equivalent_forms(tools, tried, law), _usually_adds(tools, law.curve.port)
        )
        tried.sort(key=lambda form: form is not first)
    law = replace(law, forms=tuple(tried), named=False)
    if not tried or not holdout_error_within(tried[0].fit, law.fit, _NAMED_ERROR):
        return law
    worth = worth_between_fits(tools, baseline, tried[0].fit)
    return replace(law, named=True, worth=worth) if worth.sure else law


def _fitted_forms(
    tools: SearchContext, baseline: Fit, trial: TrialFit, law: LearnedLaw
) -> Iterator[TriedForm]:
    """Closed forms fitted in the place of a curve, the plain ones first."""
    curve, price = law.curve, math.log(tools.fitter.samples)
    grounds = _evidence_by_factor(tools, trial, curve)
    enough, least_criterion = math.inf, math.inf
    for match in sorted(_promising_matches(tools, grounds, curve), key=_parameter_count):
        criterion = price * _parameter_count(match) - match.gain
        if _parameter_count(match) > enough and criterion > least_criterion:
            continue
        fit = _fit_form(tools, baseline, law, match)
        if not math.isfinite(fit.train.nrmse):
            continue
        effect = as_estimated(fit.model.effects[-1])  # pyright: ignore[reportArgumentType]
        gain = 2.0 * (fit.log_likelihood - baseline.log_likelihood)
        bic = price * len(effect.declared) - gain
        yield TriedForm(match.form.name, effect, fit, bic, criterion, match.times, match.reference)
        measured = error_within(
            law.fit, fit, _EQUAL_ERROR
        )  # a curve that errs more is no measure of it
        if (
            measured
            and (error_within(fit, law.fit, _EQUAL_ERROR) or not surely_better(tools, law.fit, fit))
            and worth_between_fits(tools, baseline, fit).sure
        ):
            enough, least_criterion = (
                min(enough, _parameter_count(match)),
                min(least_criterion, criterion),
            )


def _fit_form(tools: SearchContext, baseline: Fit, law: LearnedLaw, match: Match) -> Fit:
    """A closed form in the place of a law's curve, fitted from where it is like this or matches."""
    curve, fits = law.curve, []
    unit = unit_at(tools.fitter, curve.port, match.times)
    for start, model in _starts(law, match):
        formula = as_formula(start, curve, unit, law.signal_unit, law.channel)
        fits.append(quick_fit(tools, baseline, model + formula, segments=NUMBER in curve.given))
        if error_within(fits[-1], law.fit, _EQUAL_ERROR):
            break
    return min(fits, key=lambda fit: fit.train.nrmse)


def _starts(law: LearnedLaw, match: Match) -> Iterator[tuple[Match, Model]]:
    """A form where it is most like the curve, if it can be, and as it matches; each with a model.

    Whole runs may know better of it than one-step errors, and know what is best beside it.
    """
    if match.times == law.curve.times and np.all(np.isfinite(law.coefficients()[1])):
        ground = evidence_of_fit(law)
        near = best_match(match.form, ground)._replace(times=match.times)
        most, _ = ground.gain(np.asarray(law.curve.at_signal(ground.x)))
        if near.gain > _GAIN_NEAR_CURVE * most:
            shape = near.form.over(ground.x, {**near.values, "r": near.reference})
            yield near, model_beside(law, ground.onto @ shape)
    yield match, law.fit.model - law.curve.name


def _equivalent_forms(
    tools: SearchContext, tried: Sequence[TriedForm], law: LearnedLaw
) -> list[TriedForm]:
    """The likeliest form, and those that neither whole runs nor one-step errors surely set apart.

    Errors that last make the criterion of whole runs surer than it should be. Those that may be the
    law's name, if there are any.
    """
    best, *rivals = tried
    near = (form for form in rivals if form.one_step <= best.one_step + FORMS_APART)
    equivalent = [best, *(form for form in near if not surely_better(tools, best.fit, form.fit))]
    return [
        form for form in equivalent if holdout_error_within(form.fit, law.fit, _NAMED_ERROR)
    ] or equivalent


def _plainest(tied: Sequence[TriedForm], adds: bool) -> TriedForm:
    """Of forms of the fewest parameters the likeliest, or the most usual of those near to it.

    Args:
        tied: the forms.
        adds: whether laws at their port usually add.
    """
    fewest = min(len(tried.formula.declared) for tried in tied)
    plain = [tried for tried in tied if len(tried.formula.declared) == fewest]
    best, names = min(tried.bic for tried in plain), [form.name for form in FORMS]
    near = [tried for tried in plain if tried.bic <= best + FORMS_APART]

    def unusual(tried: TriedForm) -> tuple[bool, float, int]:
        scales = tried.times == ARRIVING
        return scales == adds, (tried.bic - best) // _TIED_CRITERION, names.index(tried.name)

    return min(near, key=unusual)


def _usually_adds(tools: SearchContext, port: str) -> bool:
    """Whether laws at a port usually add, as forces and torques do: where it drives a state.

    Of what is only measured a share is lost.
    """
    trials = tools.fitter
    driving = (place for place in trials.places if place.state)
    return any(port in (place.port, *downstream_ports(trials, place)) for place in driving)


def _evidence_by_factor(
    tools: SearchContext, trial: TrialFit, curve: Curve
) -> dict[str, LinearizedEvidence]:
    """What one-step errors say of a curve's shapes, by what these are multiplied by."""
    regressors = regressors_of(tools.fitter, trial)
    parameters = {n: {"value": getattr(curve, n)} for n in curve.given}
    return {
        times: linearized_evidence(
            tools.fitter, trial, term_along(regressors, curve.port, curve.signal, times, parameters)
        )
        for times in dict.fromkeys((curve.times, "", ARRIVING))
        if times != ARRIVING or curve.signal != ARRIVING
    }


def _promising_matches(
    tools: SearchContext, grounds: Mapping[str, LinearizedEvidence], curve: Curve
) -> list[Match]:
    """The closed forms that one-step errors ask for as they ask for a curve."""
    ground, price = grounds[curve.times], math.log(tools.fitter.samples)
    likely = ranked_matches(grounds)
    if NUMBER in curve.given:  # a wave has its form already
        likely = [
            match for match in likely if (match.form.name, match.times) == ("linear", curve.times)
        ]
    least = _GAIN_OF_CURVE * ground.gain(np.asarray(curve.at_signal(ground.x)))[0]
    least = max(least, _GAIN_OF_BEST * likely[0].gain, 0.0)
    near = [match for match in likely if match.gain > least]
    near.sort(key=lambda match: price * _parameter_count(match) - match.gain)
    first, remaining = near[:_MOST_FORMS], near[_MOST_FORMS:]
    plain = {(match.form.plain, match.times) for match in first}
    return [*first, *(match for match in remaining if (match.form.name, match.times) in plain)]


def _parameter_count(match: Match) -> int:
    return len(match.form.parameters)
