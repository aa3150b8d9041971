"""The name of a learned law: the closed form that does as well as its curve."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from diffthrust.diagnosis._learned import LearnedLaw, TriedForm
from diffthrust.diagnosis._learning.closed_forms import FORMS
from diffthrust.diagnosis._learning.fits import (
    as_good,
    as_good_unseen,
    roughly,
    surely_better,
    worth_between_fits,
)
from diffthrust.diagnosis._learning.forms import Match, as_estimated, formula_of, matches
from diffthrust.diagnosis._learning.ground import ground_of
from diffthrust.diagnosis._learning.hypotheses import NUMBER, hypothesis, unit_at
from diffthrust.diagnosis._search import Tools
from diffthrust.diagnosis._structure import observed
from diffthrust.diagnosis._trials import TrialFit
from diffthrust.effects._curve import Curve
from diffthrust.estimation._result import Fit
from diffthrust.models._base.made_effect import ARRIVING

_NEAR = 0.7
"""A closed form that promises no less than this of what the curve does may be its law (effects
beside it that only imitated the law have bent the curve),"""
_FORMS = 3
"""and so many are fitted in its place, with the plain forms that they come near to."""
_SAME = 0.2
"""Criteria no further apart are the same: of a signal of one sign two forms are one."""
_EQUAL = 1.002
"""Where whole runs err by no more than so many times as much with a form as with the curve, none of
more parameters is tried."""
_AS_GOOD = 1.1
"""A form is a law's name where whole unseen runs (training runs, where no log is unseen) err by no
more than so many times as much with it: a curve may bend as noise does."""


def named(tools: Tools, before: Fit, trial: TrialFit, law: LearnedLaw) -> LearnedLaw:
    """A learned law with the closed forms that were tried in its place.

    Args:
        tools: what the search worked with.
        before: the fit without the law.
        trial: the trial beside which it was learned.
        law: the law.
    """
    curve, price = law.curve, math.log(tools.trials.samples)
    tried: list[TriedForm] = []
    most = math.inf
    for match in sorted(_close(tools, trial, curve), key=_parameters):
        if _parameters(match) > most:
            break
        formula = formula_of(
            match, curve, unit_at(tools.trials, curve.port, match.times), law.signal_unit
        )
        wave = NUMBER in curve.given
        fit = roughly(tools, before, law.fit.model - curve.name + formula, segments=wave)
        if not math.isfinite(fit.train.nrmse):
            continue
        gain = 2.0 * (fit.log_likelihood - before.log_likelihood)
        effect = as_estimated(fit.model.effects[-1])  # pyright: ignore[reportArgumentType]
        bic = price * len(formula.declared) - gain
        told = TriedForm(match.form.name, effect, fit, bic, match.times, match.reference)
        tried.append(told)
        if as_good(fit, law.fit, _EQUAL) or not surely_better(tools, law.fit, fit):
            most = _parameters(match)  # nothing is left for more of them
    tried.sort(key=lambda one: one.bic)
    alike = [one for one in tried if not surely_better(tools, tried[0].fit, one.fit)]
    if alike:  # errors that last make the criterion surer than it should be
        plainest = min(alike, key=lambda one: _plainness(one, tried[0].bic))
        tried.sort(key=lambda one: one is not plainest)
    law = replace(law, forms=tuple(tried), named=False)
    if not tried or not as_good_unseen(tried[0].fit, law.fit, _AS_GOOD):
        return law
    worth = worth_between_fits(tools, before, tried[0].fit)
    return replace(law, named=True, worth=worth) if worth.sure else law


def _plainness(one: TriedForm, best: float) -> tuple[int, float, int]:
    """By its parameters, its criterion, and where that is the same its place among the forms."""
    names = [form.name for form in FORMS]
    return len(one.formula.declared), (one.bic - best) // _SAME, names.index(one.name)


def _close(tools: Tools, trial: TrialFit, curve: Curve) -> list[Match]:
    """The closed forms that one-step errors ask for as they ask for a curve."""
    trials = tools.trials
    own = {n: {"value": getattr(curve, n)} for n in curve.given}
    seen = observed(trials, trial)
    grounds = {
        times: ground_of(trials, trial, hypothesis(seen, curve.port, curve.signal, times, own))
        for times in dict.fromkeys((curve.times, "", ARRIVING))
        if times != ARRIVING or curve.signal != ARRIVING
    }
    ground, price = grounds[curve.times], math.log(trials.samples)
    least = _NEAR * ground.gain(np.asarray(curve.at_signal(ground.x)))[0]
    near = [one for one in matches(grounds) if one.gain > max(least, 0.0)]
    if NUMBER in curve.given:  # a wave has its form already
        near = [one for one in near if (one.form.name, one.times) == ("linear", curve.times)]
    near.sort(key=lambda one: price * _parameters(one) - one.gain)
    first, rest = near[:_FORMS], near[_FORMS:]
    plain = {(one.form.plain, one.times) for one in first}
    return [*first, *(one for one in rest if (one.form.name, one.times) in plain)]


def _parameters(match: Match) -> int:
    return len(match.form.parameters)
