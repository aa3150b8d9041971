"""The candidates of a stage, each fitted beside the current model and rated."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from diffthrust.diagnosis._candidates import of_effect
from diffthrust.diagnosis._criteria import criterion, price_of, simulation_errors, unseen_gain
from diffthrust.diagnosis._findings import TriedEffect
from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit, side_by_side
from diffthrust.diagnosis._screening import continued_beside, is_at_null, levels_of, screened
from diffthrust.diagnosis._search_state import CurrentModel, SearchContext, SearchState
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.estimation._estimate import Estimate, shown_unit
from diffthrust.estimation._likelihood import Quadratic
from diffthrust.logs._written import ShownUnits
from diffthrust.models._base.parameter import Parameter

_GONE = 1e-2
"""Numerics: trials also start from the values of simulations if a positive parameter has fallen
below this share of them, which makes it practically zero. It decides no verdict."""
_REDUNDANT = 1e-6
"""Numerics: an effect is redundant if it keeps less than this of its information beside the others:
rounding errors of the projection are some 1e-9."""
_AT_BOUND = 1e-6
"""Numerics: relative distance from a bound below which a value counts as at the bound."""
_POOR = 0.5
"""Numerics: trials also start from the first guess if the NRMSE of whole training runs is larger:
the fit may have found a poor local optimum. It decides no verdict."""


class Tried(NamedTuple):
    """An effect that was fitted beside the current model: its rating, and its fit."""

    candidate: TriedEffect
    trial: TrialFit


def screen(context: SearchContext, state: SearchState) -> tuple[SearchState, list[Tried]]:
    """Try the candidates that are not in the model; the promising ones come rated, best first."""
    fitter, present = context.fitter, state.current.trial
    candidates = state.gained or (*fitter.candidates, *fitter.constants)
    names = [n for n in candidates if n not in present.effects]
    stage = f"stage {state.number + 1}"
    context.say(f"{stage}: trying {len(names)} candidates", state.share(0.0))
    promising, untestable = [], dict(state.untestable)
    if state.gained:
        fitted = continued_beside(fitter, present, {n: state.gained[n] for n in names})
    else:
        levels, fallback = levels_of(fitter, present), other_values(context, state)
        fitted = screened(fitter, names, present, levels, fallback)
    for name, trial in fitted.items():
        # with a gain as large as this the other parameters have not replaced the effect
        gains = present.cost - trial.cost > SETTINGS.admission.plain_bic_gain
        why = "" if gains else why_untestable(trial.quadratic, trial.names, name)
        if why:
            if name not in fitter.constants:
                untestable.setdefault(name, why)
        else:
            promising.append((name, trial))
    silent = state.silent | ({*names} - {name for name, _ in promising})
    promising.sort(key=lambda pair: pair[1].expected)
    context.say(f"{stage}: comparing the best {len(promising)}", state.share(0.4))
    carried = [trial for _, trial in promising[: SETTINGS.screening.most_carried]]
    ended = continued(fitter, side_by_side(fitter.further, carried))
    ended += [trial for _, trial in promising[SETTINGS.screening.most_carried :]]
    present_bic = state.current.criterion
    leading = min((price_of(fitter, trial) + 2 * trial.cost for trial in ended), default=0.0)

    def rated(trial: TrialFit) -> Tried:
        return Tried(rate(fitter, state, trial, present_bic, leading), trial)

    tried = plainest_first(side_by_side(rated, ended))
    return replace(state, untestable=untestable, silent=silent), tried


def why_untestable(q: Quadratic, names: Sequence[str], effect: str) -> str:
    """Why an effect does nothing that the other estimated parameters cannot; "" if it does.

    An asymmetry of a propeller astern does nothing at all on a tanker that never goes astern.
    """
    live = (np.diagonal(q.information) > 0) & np.isfinite(np.diagonal(q.information))
    its = np.array([of_effect(n, effect) for n in names])
    of_this = np.zeros(live.size, bool)
    of_this[: len(names)] = its
    length = np.sqrt(np.diagonal(q.information)[live])
    scaled = q.information[np.ix_(live, live)] / np.outer(length, length)
    of_this = of_this[live]
    if not of_this.any():
        if np.any(np.diagonal(q.information)[: len(names)][its] != 0):
            return "its influence on what is measured is not finite along these logs"
        return "it changes nothing that is measured in these logs"
    cross, nuisance = scaled[np.ix_(of_this, ~of_this)], scaled[np.ix_(~of_this, ~of_this)]
    through = cross @ np.linalg.pinv(nuisance, 1e-12, True)
    projected = scaled[np.ix_(of_this, of_this)] - through @ cross.T
    if np.diagonal(projected).max() < _REDUNDANT:
        return "other parameters do the same to what is measured"
    return ""


def plainest_first(tried: Sequence[Tried]) -> list[Tried]:
    """The trials, the likeliest first, and of those tied with it that of fewest numbers."""
    ordered = sorted(tried, key=lambda rating: rating.candidate.delta_bic)
    if not ordered:
        return []
    most = ordered[0].candidate.delta_bic + SETTINGS.admission.tied_bic
    tied = [rating for rating in ordered if rating.candidate.delta_bic < most]
    tied.sort(key=lambda rating: rating.trial.count(rating.trial.parameters_of()))
    return [*tied, *ordered[len(tied) :]]


def continued(fitter: CandidateFitter, trials: Sequence[TrialFit]) -> list[TrialFit]:
    """The trials, those that promise more continued beside the noise of the best.

    Noise that explains what an effect does is slow to leave it: the centre of mass of a boat stood
    at a likelihood ratio of 1382, and a coupling of two numbers, which is the same there, was told
    in its place, of 1392. From the noise of the coupling it came to 1392, too.
    """
    best = min(trials, key=lambda trial: trial.cost, default=None)

    def further(trial: TrialFit) -> TrialFit:
        if best is None or trial.predicted_gain < SETTINGS.admission.least_bic_gain:
            return trial
        noise = {name: best.values[name] for name in fitter.nuisance}
        values = {**trial.values, **noise}
        again = fitter.solve(trial.effects, values, trial.initial_states, trial.clip)
        return min(trial, again, key=lambda trial: trial.cost)

    return side_by_side(further, trials)


def other_values(context: SearchContext, state: SearchState) -> Mapping[str, float] | None:
    """Values from which effects are tried besides the current ones, if these are implausible.

    If the errors of whole runs are large, the first guess of the search. If the observer explains
    everything by random forces, so that parameters of the model vanish, those of the simulation.
    """
    last, fitter = state.stages[-1], context.fitter
    if context.guess and last.train.nrmse > _POOR:
        return context.guess
    fitted = {n: p.value for n, p in last.fit.model.parameters.items() if not p.fixed}
    logs = [n for n in fitter.free if fitter.model.parameters[n].transform == "log"]
    values = state.current.trial.values
    vanished = any(values[n] < _GONE * fitted[n] for n in logs if n in fitted)
    return fitted if vanished else None


def rate(
    fitter: CandidateFitter,
    state: SearchState,
    trial: TrialFit,
    present_bic: float,
    leading: float = math.inf,
) -> TriedEffect:
    """Rate a trial: its likelihood ratio, criterion, p-value, and errors on unseen logs.

    Its noises are priced only where that could make it the best: ``leading`` is the least criterion
    among the trials, without the price of their noises.
    """
    from scipy.special import chdtrc  # slow to import

    present, names = state.current, trial.parameters_of()
    ratio = max(0.0, 2 * (present.trial.cost - trial.cost))
    p_value = float(chdtrc(trial.count(names), ratio))
    delta = price_of(fitter, trial) - ratio
    lag = price_of(fitter, trial) + 2 * trial.cost - leading
    if (
        delta > -SETTINGS.admission.clear_bic_gain
        and p_value < SETTINGS.screening.pricing_level
        and lag < SETTINGS.admission.clear_bic_gain
    ):
        delta = criterion(fitter, trial) - present_bic
    errors = simulation_errors(fitter, trial)
    named, shown = trial.problem.named, ShownUnits(r.log.written for r in fitter.records)
    estimates = {}
    for n in names:
        value, size = trial.values[n], shown_unit(named[n], trial.problem.model, shown)
        estimate = Estimate(value, None, named[n].unit, False, stopped(named[n], value), *size)
        estimates[n.removeprefix(f"{trial.effects[-1]}.")] = estimate
    return TriedEffect(
        stage=state.number,
        effect=trial.effects[-1],
        likelihood_ratio=ratio,
        delta_bic=delta,
        p_value=p_value,
        holdout_gain=unseen_gain(fitter, present.trial, trial),
        train_nrmse=errors[0],
        holdout_nrmse=errors[1],
        parameters=estimates,
    )


def stopped(parameter: Parameter, value: float) -> bool:
    """Whether a parameter is at a bound other than its null, at which the effect vanishes.

    Example:
        >>> stopped(parameter(4.0, bounds=(0, 5), null=0.0), 5.0)
        True
    """
    ends = (end for end in parameter.limits if math.isfinite(end))
    near = (e for e in ends if abs(value - e) <= _AT_BOUND * max(abs(e), parameter.scale))
    return any(end != parameter.null for end in near)


def better_noise(
    fitter: CandidateFitter, present: CurrentModel, tried: list[Tried]
) -> CurrentModel | None:
    """The current model with the noise of a trial, if that noise explains the logs better.

    If the trial without its effect is still better than the current model, the gain was due to the
    noise, not to the effect.
    """
    for place, (candidate, trial) in enumerate(tried):
        doubtful = (
            place == 0 and candidate.delta_bic > -SETTINGS.admission.plain_bic_gain
        ) or is_at_null(fitter, trial)
        if not doubtful or candidate.delta_bic >= -SETTINGS.admission.least_bic_gain:
            continue
        now, values = present.trial, fitter.absent((candidate.effect,), trial.values)
        without = fitter.settled(now.effects, values, trial.initial_states, now.clip)
        if without.cost < now.cost - 0.5 * SETTINGS.admission.least_bic_gain:
            clipped = replace(now, clip=without.clip)
            if not without.unseen_cost > clipped.unseen_cost + SETTINGS.admission.most_unseen_loss:
                return CurrentModel(fitter, without)
    return None
