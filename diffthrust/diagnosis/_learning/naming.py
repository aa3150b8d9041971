"""The name of a learned law: the closed form that does as well as its curve."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from diffthrust.diagnosis._innovations_fit import TrialFit
from diffthrust.diagnosis._learned import FORMS_APART, LearnedLaw, TriedForm
from diffthrust.diagnosis._learning.closed_forms import FORMS
from diffthrust.diagnosis._learning.fits import (
    as_good,
    as_good_unseen,
    roughly,
    surely_better,
    worth_between_fits,
)
from diffthrust.diagnosis._learning.forms import (
    Match,
    as_estimated,
    formula_of,
    likeliest_match,
    matches,
)
from diffthrust.diagnosis._learning.ground import Ground, ground_of, ground_of_fit, model_beside
from diffthrust.diagnosis._learning.hypotheses import NUMBER, hypothesis, unit_at
from diffthrust.diagnosis._learning.sight import sight
from diffthrust.diagnosis._search_state import SearchContext
from diffthrust.diagnosis._structure import behind
from diffthrust.effects._curve import Curve
from diffthrust.estimation._result import Fit
from diffthrust.models._base.made_effect import ARRIVING
from diffthrust.models._base.model import Model

_NEAR = 0.7
"""A closed form that promises no less than this of what the curve does may be its law (effects
beside it that only imitated the law have bent the curve),"""
_HALF = 0.5
"""and so much of what the likeliest form does,"""
_FORMS = 3
"""and so many are fitted in its place, with the plain forms that they come near to."""
_SAME = 0.2
"""Criteria no further apart are the same: of a signal of one sign two forms are one."""
_EQUAL = 1.002
"""Where whole runs err by no more than so many times as much with a form as with the curve, and it
is surely worth something, one of more parameters is tried only if one-step errors rather ask for
it."""
_LIKE = 0.95
"""A form that can be so much of what the curve is, is fitted from there first."""
_AS_GOOD = 1.1
"""A form is a law's name where whole unseen runs (training runs, where no log is unseen) err by no
more than so many times as much with it: a curve may bend as noise does."""


def named(tools: SearchContext, baseline: Fit, trial: TrialFit, law: LearnedLaw) -> LearnedLaw:
    """A learned law with the closed forms that were tried in its place.

    Args:
        tools: what the search worked with.
        baseline: the fit without the law.
        trial: the trial beside which it was learned.
        law: the law.
    """
    tried = sorted(_tried(tools, baseline, trial, law), key=lambda form: form.bic)
    if tried:
        first = _plainest(_alike(tools, tried, law), _adds(tools, law.curve.port))
        tried.sort(key=lambda form: form is not first)
    law = replace(law, forms=tuple(tried), named=False)
    if not tried or not as_good_unseen(tried[0].fit, law.fit, _AS_GOOD):
        return law
    worth = worth_between_fits(tools, baseline, tried[0].fit)
    return replace(law, named=True, worth=worth) if worth.sure else law


def _tried(
    tools: SearchContext, baseline: Fit, trial: TrialFit, law: LearnedLaw
) -> Iterator[TriedForm]:
    """Closed forms fitted in the place of a curve, the plain ones first."""
    curve, price = law.curve, math.log(tools.fitter.samples)
    grounds = _grounds(tools, trial, curve)
    enough, least_criterion = math.inf, math.inf
    for match in sorted(_close(tools, grounds, curve), key=_parameters):
        criterion = price * _parameters(match) - match.gain
        if _parameters(match) > enough and criterion > least_criterion:
            continue
        fit = _in_place(tools, baseline, law, match)
        if not math.isfinite(fit.train.nrmse):
            continue
        effect = as_estimated(fit.model.effects[-1])  # pyright: ignore[reportArgumentType]
        gain = 2.0 * (fit.log_likelihood - baseline.log_likelihood)
        bic = price * len(effect.declared) - gain
        yield TriedForm(match.form.name, effect, fit, bic, criterion, match.times, match.reference)
        measured = as_good(law.fit, fit, _EQUAL)  # a curve that errs more is no measure of it
        if (
            measured
            and (as_good(fit, law.fit, _EQUAL) or not surely_better(tools, law.fit, fit))
            and worth_between_fits(tools, baseline, fit).sure
        ):
            enough, least_criterion = (
                min(enough, _parameters(match)),
                min(least_criterion, criterion),
            )


def _in_place(tools: SearchContext, baseline: Fit, law: LearnedLaw, match: Match) -> Fit:
    """A closed form in the place of a law's curve, fitted from where it is like this or matches."""
    curve, fits = law.curve, []
    unit = unit_at(tools.fitter, curve.port, match.times)
    for start, model in _starts(law, match):
        formula = formula_of(start, curve, unit, law.signal_unit, law.channel)
        fits.append(roughly(tools, baseline, model + formula, segments=NUMBER in curve.given))
        if as_good(fits[-1], law.fit, _EQUAL):
            break
    return min(fits, key=lambda fit: fit.train.nrmse)


def _starts(law: LearnedLaw, match: Match) -> Iterator[tuple[Match, Model]]:
    """A form where it is most like the curve, if it can be, and as it matches; each with a model.

    Whole runs may know better of it than one-step errors, and know what is best beside it.
    """
    if match.times == law.curve.times and np.all(np.isfinite(law.coefficients()[1])):
        ground = ground_of_fit(law)
        near = likeliest_match(match.form, ground)._replace(times=match.times)
        most, _ = ground.gain(np.asarray(law.curve.at_signal(ground.x)))
        if near.gain > _LIKE * most:
            shape = near.form.over(ground.x, {**near.values, "r": near.reference})
            yield near, model_beside(law, ground.onto @ shape)
    yield match, law.fit.model - law.curve.name


def _alike(tools: SearchContext, tried: Sequence[TriedForm], law: LearnedLaw) -> list[TriedForm]:
    """The likeliest form, and those that neither whole runs nor one-step errors surely set apart.

    Errors that last make the criterion of whole runs surer than it should be. Those that may be the
    law's name, if there are any.
    """
    best, *rivals = tried
    near = (form for form in rivals if form.one_step <= best.one_step + FORMS_APART)
    equivalent = [best, *(form for form in near if not surely_better(tools, best.fit, form.fit))]
    return [
        form for form in equivalent if as_good_unseen(form.fit, law.fit, _AS_GOOD)
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
        return scales == adds, (tried.bic - best) // _SAME, names.index(tried.name)

    return min(near, key=unusual)


def _adds(tools: SearchContext, port: str) -> bool:
    """Whether laws at a port usually add, as forces and torques do: where it drives a state.

    Of what is only measured a share is lost.
    """
    trials = tools.fitter
    driving = (place for place in trials.places if place.state)
    return any(port in (place.port, *behind(trials, place)) for place in driving)


def _grounds(tools: SearchContext, trial: TrialFit, curve: Curve) -> dict[str, Ground]:
    """What one-step errors say of a curve's shapes, by what these are multiplied by."""
    regressors = sight(tools.fitter, trial)
    parameters = {n: {"value": getattr(curve, n)} for n in curve.given}
    return {
        times: ground_of(
            tools.fitter, trial, hypothesis(regressors, curve.port, curve.signal, times, parameters)
        )
        for times in dict.fromkeys((curve.times, "", ARRIVING))
        if times != ARRIVING or curve.signal != ARRIVING
    }


def _close(tools: SearchContext, grounds: Mapping[str, Ground], curve: Curve) -> list[Match]:
    """The closed forms that one-step errors ask for as they ask for a curve."""
    ground, price = grounds[curve.times], math.log(tools.fitter.samples)
    likely = matches(grounds)
    if NUMBER in curve.given:  # a wave has its form already
        likely = [
            match for match in likely if (match.form.name, match.times) == ("linear", curve.times)
        ]
    least = _NEAR * ground.gain(np.asarray(curve.at_signal(ground.x)))[0]
    least = max(least, _HALF * likely[0].gain, 0.0)
    near = [match for match in likely if match.gain > least]
    near.sort(key=lambda match: price * _parameters(match) - match.gain)
    first, remaining = near[:_FORMS], near[_FORMS:]
    plain = {(match.form.plain, match.times) for match in first}
    return [*first, *(match for match in remaining if (match.form.name, match.times) in plain)]


def _parameters(match: Match) -> int:
    return len(match.form.parameters)
