"""Learn what no known effect explains: the likeliest law as a curve, and its closed form."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from diffthrust.diagnosis._admit import errors_between, left_of
from diffthrust.diagnosis._findings import Remaining, Stage
from diffthrust.diagnosis._learned import LearnedLaw, TriedForm
from diffthrust.diagnosis._learning.evidence import LikelyCurve, likely_curves
from diffthrust.diagnosis._learning.forms import Match, as_estimated, formula_of, matches
from diffthrust.diagnosis._learning.ground import ground_of
from diffthrust.diagnosis._learning.hypotheses import (
    Hypothesis,
    hypothesis,
    products,
    simple_laws,
    unit_of,
    units_at,
)
from diffthrust.diagnosis._ports import DrivingPort
from diffthrust.diagnosis._search import SearchState, Tools
from diffthrust.diagnosis._structure import behind, observed
from diffthrust.diagnosis._trials import TrialFit
from diffthrust.diagnosis._worth import Worth, worth_of
from diffthrust.effects._curve import Curve
from diffthrust.estimation._result import Fit
from diffthrust.logs._units import product_unit
from diffthrust.models._base.made_effect import ARRIVING
from diffthrust.models._base.model import Model

_LIKELY = 8
"""The signals of so many of the likeliest laws are tried times another."""
_CLOSE = 0.8
"""Another law is fitted to whole runs as well, where its evidence is no less than so much of the
likeliest's."""
_ALIKE = 1.0
"""Of laws whose evidence is no further apart than this the plainer one is taken."""
_CLEAR = 10.0
"""Less evidence than this is not worth a fit."""
_MOVED, _POINTS = 0.05, 241
"""A curve is laid anew where its signal's range is off by more than such a share of it."""
_NEAR = 0.7
"""A closed form that promises no less than this of what the curve does may be its law (effects
beside it that only imitated the law have bent the curve),"""
_FORMS = 3
"""and so many are fitted in its place, with the plain forms that they come near to."""
_ALIKE_RUNS = 1.02
"""Of forms whose whole runs err by no more than so many times as much as the best the plainest is
named."""
_AS_GOOD = 1.1
"""It is, where whole runs err by no more than so many times as much with it."""
_IMITATED = 0.5
"""A law may be what effects only imitated where one-step errors ask for it with at least so much of
what these effects gained,"""
_BETTER = 0.95
"""and it is, where whole runs err by no more than so many times as much with the law in their
place."""


def learned_laws(tools: Tools, known: SearchState, first: TrialFit) -> tuple[LearnedLaw, ...]:
    """The law that no known effect expresses, where structure is proven; empty if none is sure.

    It must make whole unseen runs surely better (training runs, where no log is unseen). Effects
    that were added may only have imitated it: where the model as given with the law is better than
    the last stage, they are superfluous.

    Args:
        tools: what the search worked with.
        known: what it knows at its end.
        first: the trial of the model as given.
    """
    left = known.present.remaining
    if left is None:
        return ()
    place, last = _place(tools, left), known.stages[-1]
    if last.effects:
        begun = known.stages[0]
        gained = first.cost - known.present.trial.cost
        law = _learned_beside(tools, begun.fit, first, place, least=_IMITATED * gained)
        if law and _as_good(law.fit, last.fit, _BETTER):
            return (_named(tools, begun.fit, first, replace(law, superfluous=last.effects)),)
    law = _learned_beside(tools, last.fit, known.present.trial, place)
    if law is None:
        return ()
    law = _named(tools, last.fit, known.present.trial, law)
    return (replace(law, worth=law.worth.of(left_of(known, last))),)


def _learned_beside(
    tools: Tools, before: Fit, trial: TrialFit, place: DrivingPort, least: float = 0.0
) -> LearnedLaw | None:
    """The law beside a model that makes whole runs better: the likeliest, or its rival."""
    likely = _likeliest(tools, trial, place)
    if not likely or likely[0].evidence < least:
        return None
    found = [_fitted(tools, before, trial, likely[0])]
    if rival := _rival(likely):
        found.append(_fitted(tools, before, trial, rival))
    better = [law for law in found if law is not None]
    return min(better, key=lambda law: law.fit.train.nrmse, default=None)


def _rival(likely: list[LikelyCurve]) -> LikelyCurve | None:
    """The likeliest law of another signal, where one-step errors can hardly choose."""
    first = likely[0]
    others = (one for one in likely[1:] if one.law.signal != first.law.signal)
    rival = next(others, None)
    return rival if rival and rival.evidence > _CLOSE * first.evidence else None


def _place(tools: Tools, left: Remaining) -> DrivingPort:
    """The place whose errors the structure explains."""
    places = tools.trials.places
    return next(p for p in places if left.port in (p.port, *behind(tools.trials, p)))


def _likeliest(tools: Tools, trial: TrialFit, place: DrivingPort) -> list[LikelyCurve]:
    trials = tools.trials
    seen = observed(trials, trial)
    found = likely_curves(trials, trial, simple_laws(trials, place, seen))
    if not found:
        return []
    found += likely_curves(
        trials, trial, products(trials, place, seen, [one.law for one in found[:_LIKELY]])
    )
    best = max(one.evidence for one in found)
    found.sort(key=lambda one: (one.evidence < best - _ALIKE, _plainness(one.law), -one.evidence))
    first = [one for one in found if one.evidence >= best - _ALIKE]
    rest = sorted(found[len(first) :], key=lambda one: -one.evidence)
    return [one for one in (*first, *rest) if one.evidence > _CLEAR]


def _plainness(law: Hypothesis) -> tuple[int, int]:
    return ("", ARRIVING, law.times).index(law.times), len(law.signal)


def _fitted(tools: Tools, before: Fit, trial: TrialFit, likely: LikelyCurve) -> LearnedLaw | None:
    """A law fitted to whole runs beside a model; ``None`` where these are no better."""
    model, law = before.model, likely.law
    unit = _unit(tools, law.port, law.times)
    own = {**likely.curve.arguments, "unit": unit, "name": _free_name(model)}
    fit, curve = _with(tools, model, Curve(**own))
    if curve.given:  # what it remembers has another range than at the first guess
        told = {n: {**curve.given[n], "value": getattr(curve, n)} for n in curve.given}
        law = hypothesis(observed(tools.trials, trial), law.port, law.signal, law.times, told)
        ends = float(min(map(np.min, law.over))), float(max(map(np.max, law.over)))
        moved = max(abs(ends[0] - curve.low), abs(ends[1] - curve.high))
        if ends[0] < ends[1] and moved > _MOVED * (ends[1] - ends[0]):
            fit, curve = _with(tools, model, _laid_over(curve, *ends))
    worth = _worth(tools, before, fit)
    if not worth.sure or not fit.train.nrmse < before.train.nrmse:
        return None
    units = units_at(tools.trials, curve.port)
    return LearnedLaw(
        curve=curve,
        fit=fit,
        worth=worth,
        evidence=likely.evidence,
        samples=np.concatenate(law.over),
        factors=None if law.factor is None else np.concatenate(law.factor),
        signal_unit=unit_of(curve.signal, units),
        port_unit=units[ARRIVING],
    )


def _with(tools: Tools, model: Model, curve: Curve) -> tuple[Fit, Curve]:
    """A model with a curve, fitted to whole runs, and the curve as it is then."""
    fit = tools.refit(model + curve, starts=1)
    return fit, fit.model.effects[-1]  # pyright: ignore[reportReturnType]


def _laid_over(curve: Curve, low: float, high: float) -> Curve:
    """The same curve on another range."""
    own = {n: {**curve.given[n], "value": getattr(curve, n)} for n in curve.given}
    there = Curve(**{**curve.arguments, "low": low, "high": high, **own})
    x = np.linspace(low, high, _POINTS)
    shape = np.linalg.lstsq(there.basis(x).T, np.asarray(curve.at_signal(x)), rcond=None)[0]
    return Curve(**{**there.arguments, "shape": tuple(map(float, shape))})


def _worth(tools: Tools, before: Fit, after: Fit) -> Worth:
    logs, trained = (tools.unseen, False) if tools.unseen else (tools.trials.logs, True)
    return worth_of(errors_between(Stage((), before), Stage((), after), logs, trained=trained))


def _free_name(model: Model) -> str:
    taken = {effect.name for effect in model.effects}
    names = ("curve", *(f"curve{k}" for k in range(2, 2 * len(taken) + 3)))
    return next(name for name in names if not {name, f"{name}_form"} & taken)


def _named(tools: Tools, before: Fit, trial: TrialFit, law: LearnedLaw) -> LearnedLaw:
    """A learned law with the closed forms that were tried in its place.

    Args:
        tools: what the search worked with.
        before: the fit without the law.
        trial: the trial beside which it was learned.
        law: the law.
    """
    curve, price = law.curve, math.log(tools.trials.samples)
    tried: list[TriedForm] = []
    for match in _close(tools, trial, curve):
        formula = formula_of(match, curve, _unit(tools, curve.port, match.times), law.signal_unit)
        fit = tools.refit(law.fit.model - curve.name + formula, starts=1)
        if not math.isfinite(fit.train.nrmse):
            continue
        gain = 2.0 * (fit.log_likelihood - before.log_likelihood)
        effect = as_estimated(fit.model.effects[-1])  # pyright: ignore[reportArgumentType]
        bic = price * len(formula.declared) - gain
        told = TriedForm(match.form.name, effect, fit, bic, match.times, match.reference)
        tried.append(told)
    tried.sort(key=lambda one: one.bic)
    if alike := [one for one in tried if _as_good(one.fit, tried[0].fit, _ALIKE_RUNS)]:
        plainest = min(alike, key=lambda one: len(one.formula.declared))
        tried.sort(key=lambda one: one is not plainest)
    law = replace(law, forms=tuple(tried))
    if not tried or not _as_good(tried[0].fit, law.fit):
        return law
    worth = _worth(tools, before, tried[0].fit)
    return replace(law, named=True, worth=worth) if worth.sure else law


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
    near.sort(key=lambda one: price * _parameters(one) - one.gain)
    first, rest = near[:_FORMS], near[_FORMS:]
    plain = {(one.form.plain, one.times) for one in first}
    return [*first, *(one for one in rest if (one.form.name, one.times) in plain)]


def _parameters(match: Match) -> int:
    return len(match.form.parameters)


def _unit(tools: Tools, port: str, times: str) -> str:
    """The unit of what is added at a port when it is multiplied by something."""
    if times == ARRIVING:
        return ""
    units = units_at(tools.trials, port)
    return product_unit((units[ARRIVING], 1), (unit_of(times, units) if times else "", -1))


def _as_good(fit: Fit, other: Fit, times: float = _AS_GOOD) -> bool:
    """Whether whole runs err by no more than so many times as much, on unseen logs as well."""
    pairs = [(fit.train, other.train)]
    if fit.holdout and other.holdout:
        pairs.append((fit.holdout, other.holdout))
    return all(one.nrmse <= times * than.nrmse for one, than in pairs)
