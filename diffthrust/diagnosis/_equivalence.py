"""Effects that logs cannot tell apart, the better one of two, and the test that would.

A search adds the effect that helps most where it stands. What came later may make a rival of it the
better one: a search of a BlueBoat once ended with a force exponent, which predicted the next sample
much better than a quadratic surge drag; by hand, the drag in its place halved the surge error over
whole runs. And what is only detectable may keep out a rival: of a tanker a rudder inflow, which
changes nothing over whole runs, stood for a quadratic sway drag.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from diffthrust._support.errors import InputError
from diffthrust.diagnosis._candidates import with_candidates
from diffthrust.diagnosis._criteria import no_better, price_of, unseen_gain
from diffthrust.diagnosis._explained_share import Worth, adds_little, matters
from diffthrust.diagnosis._findings import Refusal, Stage
from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit, with_values
from diffthrust.diagnosis._screening import levels_of, screened
from diffthrust.diagnosis._search_state import (
    SOUGHT,
    CurrentModel,
    FittedStage,
    SearchContext,
    SearchState,
)
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._simulation_fit import (
    change_between,
    fitted_beside,
    fitted_to_runs,
)
from diffthrust.diagnosis._stage_fit import ended, worth_between
from diffthrust.diagnosis._stepwise import simulation_is_poor
from diffthrust.experiments._result import Experiment
from diffthrust.experiments._suggest import suggest_experiment

_MOST_EXCHANGED = 2
"""Numerics: effects in whose place a rival may come. Of a tanker it was one; more could go to and
fro, one pulled by the next sample and one by whole runs."""


class SearchResult(NamedTuple):
    """What a search has found, and what the logs cannot tell apart.

    Args:
        state: where it ended.
        groups: for each effect of its last stage those that explain as much in its place.
        detectable_groups: the same for each that is only detectable.
        exchanged: the search with a better rival in the place of an effect, if there is one: it is
            to go on.
    """

    state: SearchState
    groups: tuple[tuple[str, ...], ...]
    detectable_groups: tuple[tuple[str, ...], ...]
    exchanged: SearchState | None = None


def with_equivalents(context: SearchContext, state: SearchState, first: TrialFit) -> SearchResult:
    """What a search has found with what the logs cannot tell apart, or a better rival.

    For each effect of the present model those that, in its place, explain as much: those that
    one-step errors name, unless whole runs speak against them beside the effect, and those that
    whole runs name in its place. The signals' levels are those of ``first``, the trial of the model
    as given.
    """
    fitter, present, last = context.fitter, state.current.trial, state.stages[-1]
    barred = {name for name, why in state.refused.items() if why.by_whole_runs}
    rivals = {
        c.effect for c in state.ranking if c.delta_bic < -SETTINGS.admission.least_bic_gain
    } - barred
    outside, levels = sorted(rivals - {*present.effects}), levels_of(fitter, first)

    def near(name: str) -> tuple[dict[str, TrialFit], tuple[str, ...]]:
        return _near_by_one_step(fitter, state, name, outside, levels)

    groups = []
    for name in (n for n in last.effects if n in fitter.candidates):
        effect = _beside_others(state, name)
        alike = unrefuted(context, last, name, effect, near(name)[0])
        early = near_over_whole_runs(context, state, name, alike)
        refitted = refitted_rivals(context, last, name, early)
        if exchanged := _with_exchange(context, state, name, refitted):
            return SearchResult(state, (), (), exchanged)
        shares = {rival: worth_between(stage, last) for rival, stage in refitted.items()}
        alike += [r for r, ahead in shares.items() if not told_apart(effect, ahead, ahead.of_all)]
        groups.append((name, *dict.fromkeys(alike)))
    detectable, beside = [], dict[str, FittedStage]()
    poor = bool(state.detectable) and simulation_is_poor(context, state, last)
    for name in (n for n in state.detectable if n in fitter.candidates):
        rivals, alike = near(name)
        nearest = list(rivals)[: SETTINGS.equivalence.most_named] if poor else []
        unknown = {rival: rivals[rival] for rival in nearest if rival not in beside}
        beside |= refitted_rivals(context, last, name, unknown)
        if exchanged := _with_exchange(context, state, name, {r: beside[r] for r in nearest}):
            return SearchResult(state, (), (), exchanged)
        detectable.append((name, *alike))
    return SearchResult(state, tuple(groups), tuple(detectable))


def _near_by_one_step(
    fitter: CandidateFitter,
    state: SearchState,
    name: str,
    outside: Sequence[str],
    levels: Mapping[str, float],
) -> tuple[dict[str, TrialFit], tuple[str, ...]]:
    """The rivals of an effect that explain the next sample as well in its place, best first.

    Returns:
        Their trials, and the names of those that do not explain it better, either: of a T200 three
        rivals, better by 17 to 31, were told as what the next row cannot tell from a load astern.
    """
    present, without = state.current.trial, fitter.further(state.current.without(name))
    price, apart, near = price_of(fitter, present, name), {}, {}
    gained = 2 * (without.cost - present.cost)
    least = SETTINGS.equivalence.least_share_of_gain * gained if math.isfinite(gained) else 0.0
    for rival, trial in screened(fitter, outside, without, levels, least=least).items():
        if 2 * (trial.expected - present.cost) > SETTINGS.equivalence.hopeless_bic:
            continue
        trial = fitter.further(trial)
        worse = trial.cost - present.cost
        if rival in state.refused:
            worse -= unseen_gain(fitter, present, trial)
        apart[rival] = 2 * worse + price_of(fitter, trial) - price
        if apart[rival] < SETTINGS.equivalence.most_bic_apart:
            near[rival] = trial
    order = sorted(near, key=lambda rival: apart[rival])
    alike = (r for r in order if apart[r] > -SETTINGS.equivalence.most_bic_apart)
    return {rival: near[rival] for rival in order}, tuple(alike)


def near_over_whole_runs(
    context: SearchContext, state: SearchState, name: str, alike: Collection[str]
) -> dict[str, TrialFit]:
    """The rivals of an effect, when it was added, with which whole runs erred little more, or less.

    Where these stay poor the model is wrong in more than this, and the likelihood of the next
    sample, in which random forces take up what is wrong, does not tell them apart. Of those that
    are known to be ``alike`` only what errs less; nothing that the last stage has.
    """
    fitter = context.fitter
    at, stage = next((k, s) for k, s in enumerate(state.stages) if name in s.effects)
    tried = [
        c.effect
        for c in state.ranking
        if c.stage == at - 1 and c.delta_bic < -SETTINGS.admission.least_bic_gain
    ]
    present = {*stage.effects, *state.stages[-1].effects}  # what was added later is told apart
    rivals = [rival for rival in tried if rival not in present]
    if not rivals or not simulation_is_poor(context, state, state.stages[-1]):
        return {}
    simulation = fitter.simulating()
    fitted = fitted_to_runs(fitter, stage)
    without = fitted_to_runs(fitter, stage, [n for n in stage.effects if n != name])
    started = screened(simulation, rivals, without, levels_of(fitter, without))
    ended = {rival: simulation.further(trial) for rival, trial in started.items()}
    ahead = {r: change_between(fitter, t, fitted).of_all.share for r, t in ended.items()}
    most = 1.0 - 1.0 / SETTINGS.equivalence.near_error**2
    order = sorted(ended, key=lambda rival: ahead[rival])
    near = [rival for rival in order if ahead[rival] <= most and rival not in alike]
    better = [rival for rival in order if ahead[rival] < 0.0 and rival in alike]
    return {r: ended[r] for r in (*near[: SETTINGS.equivalence.most_named], *better[:1])}


def _beside_others(state: SearchState, name: str) -> Worth | None:
    """What an effect of the last stage removes, on all logs, of the error left without it."""
    last = state.stages[-1]
    if len(last.effects) == 1:
        return worth_between(state.stages[0], last).of_all
    worth = state.beside.get(name)
    return worth and (worth.everywhere or worth)


def unrefuted(
    context: SearchContext,
    stage: Stage,
    name: str,
    effect: Worth | None,
    rivals: Mapping[str, TrialFit],
) -> list[str]:
    """The rivals of an effect that whole runs, too, do not tell from it in the last stage.

    Each is fitted to whole runs in the place of the effect, and must err about as little there. On
    the runs of the Esso Osaka a surge drag predicts the next sample as well as the wind; over whole
    runs it lowers nothing, and the wind halves the error. On the maps of a T200 a saturation was
    named as what a weaker thrust astern may be, with which the thrust of unseen maps errs by 3.6 N
    in place of 2.0.
    """
    if not rivals:
        return []
    fitter = context.fitter
    kept = [n for n in stage.effects if n != name]
    nearest = list(rivals)[: SETTINGS.equivalence.most_compared]
    fitter.simulating().ready(stage.effects, nearest)  # one program for all of them
    fitted, alike = fitted_to_runs(fitter, stage), []
    for rival in nearest:
        instead = fitted_beside(fitter, stage, rivals[rival], (*kept, rival))
        ahead = change_between(fitter, instead, fitted)
        if not told_apart(effect, ahead, ahead.of_all):
            alike.append(rival)
    return alike


def told_apart(effect: Worth | None, worth: Worth, everywhere: Worth) -> bool:
    """Whether whole runs tell an effect from a rival in its place, in all or in one channel.

    They do where they err by more than a tenth more with the rival; and where it surely does less
    of what the effect surely does: of an NGS thruster a command offset removes 11 % of the error
    that is left without it, so that even nothing in its place errs little more. Not where unseen
    logs err less with the rival.

    Args:
        effect: what the effect removes of the error left without it, on all logs, if it is known.
        worth: what it removes of the error that the rival has, on unseen logs.
        everywhere: the same on training and unseen logs together.
    """
    most = 1.0 - 1.0 / SETTINGS.whole_runs.equivalent_error**2
    shares = [each for w in (worth, everywhere) for each in (w, *w.channels.values())]
    if not all(-math.inf < each.share <= most for each in shares):
        return True
    if effect is None or worth.share < -SETTINGS.whole_runs.negligible_share:
        return False
    pairs = [(effect, everywhere)]
    both = effect.channels.keys() & everywhere.channels.keys()
    pairs += [(effect.channels[name], everywhere.channels[name]) for name in both]
    return any(own.sure and ahead.sure and not _does_as_much(own, ahead) for own, ahead in pairs)


def _does_as_much(effect: Worth, ahead: Worth) -> bool:
    """Whether a rival removes nearly what an effect does of the error left without it.

    Args:
        effect: what the effect removes of it.
        ahead: what the effect removes of the error that the rival has.
    """
    least = SETTINGS.equivalence.least_share_of_effect
    left = SETTINGS.whole_runs.equivalent_error**2 * (1.0 - effect.share)
    rival = 1.0 - (1.0 - effect.share) / (1.0 - ahead.share)
    return rival > max(least * effect.share, 1.0 - left)


def refitted_rivals(
    context: SearchContext, stage: FittedStage, name: str, rivals: Mapping[str, TrialFit]
) -> dict[str, FittedStage]:
    """The last stage with each rival in the place of an effect, or of one that is only detectable.

    Fitted from several starts: where a rival was as good when the effect was added, what came later
    is fitted beside the effect, and a fit that starts there may end far from where the rival does
    best. On the maps of a T200 a linear damping wants five times the drive that a load exponent
    does. What a rival has by log is one value for all: with a value each it wins by its freedom.
    """
    stages, candidates = {}, context.fitter.candidates
    for rival, trial in rivals.items():
        names = (*(n for n in stage.effects if n != name), rival)
        alike = {r: candidates[r].differing(False) for r in (rival,) if r in candidates}
        shared = {**candidates, **alike}
        model = with_candidates(context.given, names, shared, stage.fit.model)
        free = {n for n, p in model.parameters.items() if not p.fixed}
        last = {n: e.value for n, e in stage.fit.parameters.items() if n in free}
        # the model's own parameters as the rival wants them, what came later as it is now
        later = {n: value for n, value in last.items() if n.rpartition(".")[0]}
        model = with_values(model, {**trial.values, **later})
        context.say(f"fitting with {rival} in place of {name}", SOUGHT)
        refitted = context.refit(model, [last], like=stage.fit)
        stages[rival] = FittedStage(names, *refitted)
    return stages


def _with_exchange(
    context: SearchContext, state: SearchState, name: str, rivals: Mapping[str, FittedStage]
) -> SearchState | None:
    """The search with the best of some rivals in the place of an effect, if it is surely better.

    Whole runs must surely err less with it, in the place of an effect that is only detectable by a
    tenth. Never one that has given way itself, and so few in all that a search comes to an end.
    """
    if state.number >= SETTINGS.admission.most_effects or name in state.exchanged:
        return None
    candidates = {*context.fitter.candidates} - {*state.exchanged}
    stages = (stage for rival, stage in rivals.items() if rival in candidates)
    better = [stage for stage in stages if _is_better(state, name, stage)]
    if not better or len(state.exchanged) >= _MOST_EXCHANGED:
        return None
    best = ended(context, min(better, key=lambda stage: stage.train.nrmse))
    return _exchanged(context, state, name, best) if _is_better(state, name, best) else None


def _is_better(state: SearchState, name: str, stage: FittedStage) -> bool:
    last = state.stages[-1]
    worth = worth_between(last, stage)
    if no_better(last, stage) or (adds_little(worth) and name in state.detectable):
        return False
    return worth.of_all.share > 0.0 and matters(worth)


def _exchanged(
    context: SearchContext, state: SearchState, name: str, better: FittedStage
) -> SearchState:
    fitter, trial = context.fitter, state.current.trial
    (rival,) = (effect for effect in better.effects if effect not in state.stages[-1].effects)
    values = {**trial.values, **{n: p.value for n, p in better.fit.model.parameters.items()}}
    values = fitter.absent((name,), values)
    effects = (*(n for n in trial.effects if n not in (name, rival)), rival)
    settled = fitter.settled(effects, values, None, trial.clip)
    return replace(
        state,
        current=CurrentModel(fitter, settled),
        stages=(*state.stages, better),
        exchanged={**state.exchanged, name: rival},
        turned_down={**state.turned_down, name: (Refusal.EXCHANGED, effects)},
        detectable=tuple(n for n in state.detectable if n not in (name, rival)),
        refused={},
        possible={},
        exhausted=False,
    )


def proposal(
    context: SearchContext,
    search: SearchResult,
    possible: Iterable[str],
    limits: Mapping[str, tuple[float, float]] | None,
) -> Experiment | None:
    """The test, within limits of the inputs, that would separate the first group of several.

    First the groups of the added effects, one after the other; then the model as it is against each
    effect that is possible. Not against a constant: freed, it does what the one that is held does.
    """
    fitter, last = context.fitter, search.state.stages[-1]
    pairs = [(None, name) for name in possible if name in fitter.candidates]
    for group in (*search.groups, *pairs):
        if len(group) < 2:
            continue
        kept = [n for n in last.effects if n != group[0]]
        words = " and ".join(filter(None, group))
        context.say(f"looking for a test that separates {words}", 0.95)
        rivals = [last.fit]
        logs = [record.log for record in context.records]
        log = max(logs, key=lambda log: log.duration)
        try:
            for name in group[1:3]:
                names = [*kept, name or ""]
                rival = with_candidates(context.given, names, fitter.candidates, last.fit.model)
                rivals.append(context.refit(rival).fit)
            with context.clock("experiment"):
                return suggest_experiment(
                    rivals,
                    duration=min(log.duration, 2000 * log.step),
                    step=log.step,
                    limits=limits,
                    logs=logs,
                )
        except InputError:
            return None  # inputs that cannot be prescribed
    return None
