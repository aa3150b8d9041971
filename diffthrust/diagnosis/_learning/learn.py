"""Learn what no known effect explains: the likeliest law as a curve, and its closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from diffthrust.diagnosis._admit import left_of
from diffthrust.diagnosis._findings import Remaining
from diffthrust.diagnosis._groups import Grouped
from diffthrust.diagnosis._learned import LearnedLaw
from diffthrust.diagnosis._learning.beside import kept_beside
from diffthrust.diagnosis._learning.evidence import LikelyCurve, likely_curves
from diffthrust.diagnosis._learning.fits import as_good, worth_between_fits
from diffthrust.diagnosis._learning.hypotheses import (
    NUMBER,
    Hypothesis,
    hypothesis,
    products,
    scene,
    simple_laws,
    unit_at,
    unit_of,
    units_at,
)
from diffthrust.diagnosis._learning.naming import named
from diffthrust.diagnosis._ports import DrivingPort
from diffthrust.diagnosis._search import Tools
from diffthrust.diagnosis._structure import behind, observed
from diffthrust.diagnosis._trials import TrialFit
from diffthrust.effects._curve import Curve
from diffthrust.effects._grammar import expression_of
from diffthrust.estimation._result import Fit
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
_IMITATED = 0.5
"""A law may be what effects only imitated where one-step errors ask for it with at least so much of
what these effects gained,"""
_BETTER = 0.95
"""and it is, where whole runs err by no more than so many times as much with the law in their
place."""


def learned_law(tools: Tools, found: Grouped, first: TrialFit) -> tuple[Grouped, LearnedLaw] | None:
    """The law that no known effect expresses, where structure is proven; ``None`` if none is sure.

    It must make whole unseen runs surely better (training runs, where no log is unseen). Effects
    that were found without it may only have imitated it: they are sought again beside it.

    Args:
        tools: what the search worked with.
        found: what it found without a law.
        first: the trial of the model as given.

    Returns:
        The law, and what else is missing.
    """
    known = found.known
    if known.present.remaining is None:
        return None
    place, trial = _place(tools, known.present.remaining), known.present.trial
    begun, last = known.stages[0], known.stages[-1]
    base, law = begun, None
    if trial.effects:
        law = _learned_beside(tools, begun.fit, first, place, _IMITATED * (first.cost - trial.cost))
        law = law if law and as_good(law.told, last.fit, _BETTER) else None
    if law is None:
        base, law = last, _learned_beside(tools, last.fit, trial, place)
    if law is None:
        return None
    if trial.effects:
        beside, told = kept_beside(tools, found, first, law)
        now = beside.known
        if {*now.stages[-1].effects} != {*base.effects}:
            told = _beside_others(tools, now.stages[-1].fit, now.present.trial, told)
        if told.worth.sure:
            found, law = beside, told
        elif base is not last:
            return None  # else it goes with all of them alone
    return found, replace(law, worth=law.worth.of(left_of(found.known, found.known.stages[-1])))


def _beside_others(tools: Tools, before: Fit, trial: TrialFit, law: LearnedLaw) -> LearnedLaw:
    """A law beside other effects than those beside which it was learned."""
    fit, curve = _with(tools, before.model, law.curve)
    worth = worth_between_fits(tools, before, fit)
    return named(tools, before, trial, replace(law, curve=curve, fit=fit, worth=worth))


def _learned_beside(
    tools: Tools, before: Fit, trial: TrialFit, place: DrivingPort, least: float = 0.0
) -> LearnedLaw | None:
    """The likeliest law beside a model, or its rival, with its name; if whole runs surely improve.

    Unseen logs may go where the training logs tell nothing of a curve, and its form all the same.
    """
    likely = _likeliest(tools, trial, place)
    if not likely or likely[0].evidence < least:
        return None
    found = [_fitted(tools, before, trial, likely[0])]
    if rival := _rival(likely):
        found.append(_fitted(tools, before, trial, rival))
    better = [law for law in found if law is not None]
    if not better:
        return None
    law = named(tools, before, trial, min(better, key=lambda law: law.fit.train.nrmse))
    return law if law.worth.sure else None


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
    trials, at = tools.trials, scene(tools.trials, trial, place)
    found = likely_curves(trials, trial, simple_laws(at))
    if not found:
        return []
    found += likely_curves(trials, trial, products(at, [one.law for one in found[:_LIKELY]]))
    best = max(one.evidence for one in found)
    found.sort(key=lambda one: (one.evidence < best - _ALIKE, _plainness(one.law), -one.evidence))
    first = [one for one in found if one.evidence >= best - _ALIKE]
    rest = sorted(found[len(first) :], key=lambda one: -one.evidence)
    return [one for one in (*first, *rest) if one.evidence > _CLEAR]


def _plainness(law: Hypothesis) -> tuple[int, bool, int]:
    times = ("", ARRIVING, law.times).index(law.times)
    return times, ARRIVING in expression_of(law.signal).places, len(law.signal)


def _fitted(tools: Tools, before: Fit, trial: TrialFit, likely: LikelyCurve) -> LearnedLaw | None:
    """A law fitted to whole runs beside a model; ``None`` where these are no better."""
    model, law = before.model, likely.law
    unit = unit_at(tools.trials, law.port, law.times)
    own = {**likely.curve.arguments, "unit": unit, "name": _free_name(model)}
    fit, curve = _with(tools, model, Curve(**own))
    if curve.given:  # what it remembers has another range than at the first guess
        told = {n: {**curve.given[n], "value": getattr(curve, n)} for n in curve.given}
        law = hypothesis(observed(tools.trials, trial), law.port, law.signal, law.times, told)
        ends = float(min(map(np.min, law.over))), float(max(map(np.max, law.over)))
        moved = max(abs(ends[0] - curve.low), abs(ends[1] - curve.high))
        if ends[0] < ends[1] and moved > _MOVED * (ends[1] - ends[0]):
            fit, curve = _with(tools, model, _laid_over(curve, *ends))
    worth = worth_between_fits(tools, before, fit)
    if not fit.train.nrmse < before.train.nrmse:
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
    # whole runs have many false minima along a wave
    fit = tools.refit(model + curve, starts=1, segments=NUMBER in curve.given)
    return fit, fit.model.effects[-1]  # pyright: ignore[reportReturnType]


def _laid_over(curve: Curve, low: float, high: float) -> Curve:
    """The same curve on another range."""
    own = {n: {**curve.given[n], "value": getattr(curve, n)} for n in curve.given}
    there = Curve(**{**curve.arguments, "low": low, "high": high, **own})
    x = np.linspace(low, high, _POINTS)
    shape = np.linalg.lstsq(there.basis(x).T, np.asarray(curve.at_signal(x)), rcond=None)[0]
    return Curve(**{**there.arguments, "shape": tuple(map(float, shape))})


def _free_name(model: Model) -> str:
    taken = {effect.name for effect in model.effects}
    names = ("curve", *(f"curve{k}" for k in range(2, 2 * len(taken) + 3)))
    return next(name for name in names if not {name, f"{name}_form"} & taken)
