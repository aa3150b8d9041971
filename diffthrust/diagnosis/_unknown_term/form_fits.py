"""Closed forms fitted to whole runs in the place of a curve, and which of them names the law."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from diffthrust.diagnosis._explained_share import matters
from diffthrust.diagnosis._innovations_fit import TrialFit
from diffthrust.diagnosis._learned import LearnedLaw, TriedForm
from diffthrust.diagnosis._residual_structure import place_of
from diffthrust.diagnosis._search_state import SearchContext
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._unknown_term.closed_forms import (
    FORMS,
    Match,
    as_estimated,
    as_formula,
    best_match,
    form_of,
    ranked_matches,
    with_companion,
)
from diffthrust.diagnosis._unknown_term.evidence import (
    LinearizedEvidence,
    evidence_of_fit,
    linearized_evidence,
    model_beside,
)
from diffthrust.diagnosis._unknown_term.fit import (
    error_within,
    holdout_error_within,
    quick_fit,
    surely_better,
    worth_between_fits,
)
from diffthrust.diagnosis._unknown_term.terms import NUMBER, regressors_of, term_along, unit_at
from diffthrust.effects._curve import Curve
from diffthrust.estimation._result import Fit
from diffthrust.models._base.made_effect import ARRIVING
from diffthrust.models._base.model import Model

_COMPANION = -1
"""Numerics: index of its companion's amplitude among the parameters of a form's formula."""
_TIED_BIC = 0.2
"""Numerics: criteria this close are ties: of a signal of one sign, two forms are the same
function."""
_SIMILAR_GAIN = 0.95
"""Numerics: a form that gains this share of what the fitted curve gains is first fitted from where
it is most like the curve; whole runs know the curve better than one-step errors do."""


def try_closed_forms(
    context: SearchContext, baseline: Fit, trial: TrialFit, law: LearnedLaw
) -> LearnedLaw:
    """A law with the closed forms that were fitted in its curve's place, and its name if one fits.

    A form names the law if whole unseen runs err as little with it, but for a tenth (a curve bends
    as noise does), and if whole runs surely err less with it (`matters`).
    """
    tried = sorted(_fitted_forms(context, baseline, trial, law), key=lambda form: form.bic)
    if tried:
        leader = _leading_form(context, tried)
        tried.sort(key=lambda form: form is not leader)
        equivalent = _equivalent_forms(context, tried, law)
        first = _plainest(equivalent, _usually_adds(context, law.curve.port))
        tried.sort(key=lambda form: form is not first)
    law = replace(law, forms=tuple(tried), named=False)
    if not tried or not _errs_as_little(tried[0], law):
        return law
    named = replace(law, named=True, worth=worth_between_fits(context, baseline, tried[0].fit))
    return named if named.helps else law


def _leading_form(context: SearchContext, tried: Sequence[TriedForm]) -> TriedForm:
    """The likeliest form, or one of no more parameters that errs less on unseen runs by a tenth.

    Dry friction of EMPS as a dead zone beside a steep slope errs by half of what its tanh with an
    offset errs in training (NRMSE 0.022, 0.040), and by a quarter more on unseen runs. Where it
    errs as little it is dry friction all the same: 20.7 N were told as -18.9 kN s/m beyond 1 mm/s.
    """
    leader = tried[0]
    for form in tried[1:] if context.unseen else ():
        plain = len(form.formula.declared) <= len(leader.formula.declared)
        dry = (leader.name, form.name) == ("dead zone", "dry") and _errs_as_little(form, leader)
        if dry or (plain and not _errs_as_little(leader, form)):
            leader = form
    return leader


def _errs_as_little(form: TriedForm, rival: TriedForm | LearnedLaw) -> bool:
    return holdout_error_within(form.fit, rival.fit, SETTINGS.whole_runs.equivalent_error)


def _fitted_forms(
    context: SearchContext, baseline: Fit, trial: TrialFit, law: LearnedLaw
) -> Iterator[TriedForm]:
    """Closed forms fitted in the place of a curve, those of fewest parameters first.

    Once one does as well as the curve, one of more parameters is fitted only if one-step errors ask
    for it.
    """
    price = math.log(context.fitter.samples)
    enough, least_criterion = math.inf, math.inf
    for match in sorted(_promising_matches(context, trial, law), key=_parameter_count):
        criterion = price * _parameter_count(match) - match.gain
        if _parameter_count(match) > enough and criterion > least_criterion:
            continue
        match, fit = _fit_form(context, baseline, law, match)
        if not math.isfinite(fit.train.nrmse):
            continue
        effect = as_estimated(fit.model.effects[-1])  # pyright: ignore[reportArgumentType]
        gain = 2.0 * (fit.log_likelihood - baseline.log_likelihood)
        bic = price * len(effect.declared) - gain
        yield TriedForm(
            match.form.name, effect, fit, bic, criterion, match.times, match.reference,
            match.form.companion,
        )  # fmt: skip
        worth = worth_between_fits(context, baseline, fit)
        if _does_as_well(context, fit, law) and matters(worth, law.driven):
            enough = min(enough, _parameter_count(match))
            least_criterion = min(least_criterion, criterion)


def _does_as_well(context: SearchContext, fit: Fit, law: LearnedLaw) -> bool:
    if not error_within(law.fit, fit, SETTINGS.closed_form.equal_error):
        return False  # the curve itself errs more: it has not converged, and measures nothing
    as_small = error_within(fit, law.fit, SETTINGS.closed_form.equal_error)
    return as_small or not surely_better(context, law.fit, fit)


def _fit_form(
    context: SearchContext, baseline: Fit, law: LearnedLaw, match: Match
) -> tuple[Match, Fit]:
    """A closed form in the place of a law's curve, from the first start that does as well.

    Its companion is dropped if whole runs do not pay its price.
    """
    curve, fits = law.curve, []
    unit = unit_at(context.fitter, curve.port, match.times)
    for start, model in _starts(law, match):
        formula = as_formula(start, curve, unit, law.signal_unit, law.channel)
        fits.append(quick_fit(context, baseline, model + formula, segments=NUMBER in curve.given))
        if error_within(fits[-1], law.fit, SETTINGS.closed_form.equal_error):
            break
    best = min(fits, key=lambda fit: fit.train.nrmse)
    if match.form.companion:
        effect = best.model.effects[-1]
        amplitude = best.parameters[f"{effect.name}.{list(effect.declared)[_COMPANION]}"]
        ratio = amplitude.value / (amplitude.std_error or math.inf)
        if ratio**2 < math.log(context.fitter.samples):
            alone = match._replace(form=form_of(match.form.name))
            return _fit_form(context, baseline, law, alone)
    return match, best


def _starts(law: LearnedLaw, match: Match) -> Iterator[tuple[Match, Model]]:
    """Starts of a form with a model: most like the fitted curve if it can be, and as it matches.

    In the first the model's other parameters are where they are best beside the form, and not where
    the curve, which may do a part of their work, has left them.
    """
    evidence = _whole_run_evidence(law)
    if evidence and match.times == law.curve.times:
        near = best_match(match.form, evidence)._replace(times=match.times)
        curve_gain, _ = evidence.gain(np.asarray(law.curve.at_signal(evidence.x)))
        if near.gain > _SIMILAR_GAIN * curve_gain:
            shape = near.form.over(evidence.x, {**near.values, "r": near.reference})
            yield near, model_beside(law, evidence.projection @ shape)
    yield match, law.fit.model - law.curve.name


def _equivalent_forms(
    context: SearchContext, tried: Sequence[TriedForm], law: LearnedLaw
) -> list[TriedForm]:
    """The likeliest form, and those that neither whole runs nor one-step errors set apart from it.

    Whole runs must be surely better with one to set them apart: their criterion takes errors that
    last for independent, and is surer than it should be. Those that may name the law come alone.
    """
    best, *rivals = tried
    near = (f for f in rivals if f.one_step <= best.one_step + SETTINGS.closed_form.most_bic_apart)
    if context.unseen:  # a form that errs a tenth more there has lost already
        near = (f for f in near if _errs_as_little(f, best))
    equivalent = [best, *(f for f in near if not surely_better(context, best.fit, f.fit))]
    return [form for form in equivalent if _errs_as_little(form, law)] or equivalent


def _plainest(forms: Sequence[TriedForm], adds: bool) -> TriedForm:
    """The likeliest of the forms of fewest parameters, or the most usual of those near to it.

    ``adds``: whether laws at their port usually add.
    """
    fewest = min(len(form.formula.declared) for form in forms)
    plain = [form for form in forms if len(form.formula.declared) == fewest]
    best, names = min(form.bic for form in plain), [form.name for form in FORMS]
    near = [form for form in plain if form.bic <= best + SETTINGS.closed_form.most_bic_apart]

    def unusual(form: TriedForm) -> tuple[bool, float, int]:
        scales = form.times == ARRIVING
        return scales == adds, (form.bic - best) // _TIED_BIC, names.index(form.name)

    return min(near, key=unusual)


def _usually_adds(context: SearchContext, port: str) -> bool:
    """Whether laws at a port usually add: forces and torques do, which drive a state.

    What is only measured, as a propeller's thrust, usually loses a share.
    """
    place = place_of(context.fitter, port)
    return place is not None and place.state is not None


def _whole_run_evidence(law: LearnedLaw) -> LinearizedEvidence | None:
    """What whole runs say of the shapes of a law; ``None`` if its fit tells no covariance."""
    return evidence_of_fit(law) if np.all(np.isfinite(law.coefficients()[1])) else None


def _promising_matches(context: SearchContext, trial: TrialFit, law: LearnedLaw) -> list[Match]:
    """The few closed forms that gain nearly what the curve gains in one-step errors.

    With the plain forms that they come near to: a dead zone of no width is a line. And dry friction
    with a dead zone, which is that beside a steep slope of the model's own: of EMPS's velocity the
    splines of one-step errors, eight times as wide, gain nothing by it.
    """
    curve = law.curve
    evidence, whole_runs = _evidence_by_factor(context, trial, curve), _whole_run_evidence(law)
    price = math.log(context.fitter.samples)
    likely = [
        with_companion(m, evidence[m.times], whole_runs if m.times == curve.times else None, price)
        for m in ranked_matches(evidence)
    ]
    likely.sort(key=lambda match: -match.gain)
    if NUMBER in curve.given:  # a wave has its form already
        likely = [m for m in likely if (m.form.name, m.times) == ("linear", curve.times)]
    of_curve = evidence[curve.times]
    curve_gain, _ = of_curve.gain(np.asarray(curve.at_signal(of_curve.x)))
    least = max(
        SETTINGS.closed_form.least_share_of_curve * curve_gain,
        SETTINGS.closed_form.least_share_of_likeliest * likely[0].gain,
        0.0,
    )
    near = [match for match in likely if match.gain > least]
    near.sort(key=lambda match: price * _parameter_count(match) - match.gain)
    first = near[: SETTINGS.closed_form.most_fitted]
    plain = {(name, match.times) for match in first for name in match.form.plain}
    dry = {("dry", match.times) for match in first if match.form.name == "dead zone"}

    def added(match: Match) -> bool:
        kind = match.form.name, match.times
        return kind in dry or (kind in plain and match.gain > least)

    return [*first, *(match for match in likely if match not in first and added(match))]


def _evidence_by_factor(
    context: SearchContext, trial: TrialFit, curve: Curve
) -> Mapping[str, LinearizedEvidence]:
    """What one-step errors say of a curve's shapes, with its own factor, none, and what arrives."""
    regressors = regressors_of(context.fitter, trial)
    parameters = {n: {"value": getattr(curve, n)} for n in curve.given}
    factors = dict.fromkeys((curve.times, "", ARRIVING))
    if curve.signal == ARRIVING:
        del factors[ARRIVING]
    terms = [term_along(regressors, curve.port, curve.signal, f, parameters) for f in factors]
    return {term.times: linearized_evidence(trial, term) for term in terms}


def _parameter_count(match: Match) -> int:
    return len(match.form.parameters) + len(match.form.amplitudes) - 1
