"""Learned laws fitted to whole runs, as curves and in the form in which they are told."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from diffthrust.diagnosis._innovations_fit import TrialFit
from diffthrust.diagnosis._learned import LearnedLaw
from diffthrust.diagnosis._learning.evidence import LikelyCurve
from diffthrust.diagnosis._learning.fits import roughly, worth_between_fits
from diffthrust.diagnosis._learning.forms import as_estimated
from diffthrust.diagnosis._learning.hypotheses import (
    NUMBER,
    Hypothesis,
    channel_of,
    hypothesis,
    unit_at,
    unit_of,
    units_at,
)
from diffthrust.diagnosis._learning.sight import sight
from diffthrust.diagnosis._search_state import SearchContext
from diffthrust.effects._curve import Curve
from diffthrust.estimation._result import Fit
from diffthrust.models._base.made_effect import ARRIVING
from diffthrust.models._base.model import Model
from diffthrust.simulation._step_size import choose_substeps

_BEYOND, _EMPTY = 0.05, 0.4
"""A curve is laid anew where its signal leaves its range by more than such a share of it, or leaves
so much of it empty."""
_BEHIND = 1.1
"""Whole runs err by more than so many times as much with a law that is far behind another."""
_POINTS = 241


def law_of(
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
    fit, curve = _with_curve(tools, baseline, Curve(**arguments))
    if curve.given:  # what it remembers may have another range than at the first guess
        law = hypothesis_of(tools, trial, curve)
        if (ends := _elsewhere(law, curve)) and not _behind(fit, rival):
            fit, curve = _with_curve(tools, baseline, _laid_over(curve, *ends))
            law = hypothesis_of(tools, trial, curve)
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


def _behind(fit: Fit, rival: LearnedLaw | None) -> bool:
    """Whether a fit is far behind another law that is worth something surely."""
    return bool(rival and rival.worth.sure and fit.train.nrmse > _BEHIND * rival.fit.train.nrmse)


def hypothesis_of(tools: SearchContext, trial: TrialFit, curve: Curve) -> Hypothesis:
    """The law of a curve along the path of a trial, what it remembers being as in the curve."""
    regressors = sight(tools.fitter, trial)
    return hypothesis(regressors, curve.port, curve.signal, curve.times, _parameters(curve))


def _parameters(curve: Curve) -> dict[str, dict[str, Any]]:
    """The parameters of a curve's signal, as they are now."""
    return {n: {**curve.given[n], "value": getattr(curve, n)} for n in curve.given}


def _with_curve(tools: SearchContext, baseline: Fit, curve: Curve) -> tuple[Fit, Curve]:
    """A fitted model with a curve, fitted to whole runs, and the curve as it is then."""
    # whole runs have many false minima along a wave
    fit = roughly(tools, baseline, baseline.model + curve, segments=NUMBER in curve.given)
    return fit, fit.model.effects[-1]  # pyright: ignore[reportReturnType]


def with_fine_steps(tools: SearchContext, baseline: Fit, law: LearnedLaw) -> LearnedLaw:
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


def _elsewhere(law: Hypothesis, curve: Curve) -> tuple[float, float] | None:
    """The range of a law's signal, where it is another one than that of its curve."""
    low, high = float(min(map(np.min, law.over))), float(max(map(np.max, law.over)))
    beyond, span = max(curve.low - low, high - curve.high), curve.high - curve.low
    moved = beyond > _BEYOND * span or high - low < (1.0 - _EMPTY) * span
    return (low, high) if moved and low < high else None


def _laid_over(curve: Curve, low: float, high: float) -> Curve:
    """The same curve on another range."""
    target = Curve(**{**curve.arguments, "low": low, "high": high, **_parameters(curve)})
    x = np.linspace(low, high, _POINTS)
    shape = np.linalg.lstsq(target.basis(x).T, np.asarray(curve.at_signal(x)), rcond=None)[0]
    return Curve(**{**target.arguments, "shape": tuple(map(float, shape))})


def _free_name(model: Model) -> str:
    taken = {effect.name for effect in model.effects}
    names = ("curve", *(f"curve{k}" for k in range(2, 2 * len(taken) + 3)))
    return next(name for name in names if not {name, f"{name}_form"} & taken)
