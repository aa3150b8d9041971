"""Effects that logs cannot tell apart, and the test that would."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

from diffthrust._support.errors import InputError
from diffthrust.diagnosis._candidates import with_candidates
from diffthrust.diagnosis._criteria import price_of, unseen_gain
from diffthrust.diagnosis._explained_share import Worth
from diffthrust.diagnosis._innovations_fit import TrialFit
from diffthrust.diagnosis._screening import levels_of, screened
from diffthrust.diagnosis._search_state import SearchContext, SearchState
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._simulation_fit import fitted_to_runs, share_between, simulation_fitter
from diffthrust.diagnosis._stepwise import simulation_is_poor
from diffthrust.experiments._result import Experiment
from diffthrust.experiments._suggest import suggest_experiment


class SearchResult(NamedTuple):
    """What a search has found, and what the logs cannot tell apart.

    Args:
        state: where it ended.
        groups: for each effect of its last stage those that explain as much in its place.
        detectable_groups: the same for each that is only detectable.
    """

    state: SearchState
    groups: tuple[tuple[str, ...], ...]
    detectable_groups: tuple[tuple[str, ...], ...]


def with_equivalents(context: SearchContext, state: SearchState, first: TrialFit) -> SearchResult:
    """What a search has found with what the logs cannot tell apart; see `_groups_of`."""
    added = _groups_of(context, state, first, state.stages[-1].effects)
    return SearchResult(state, added, _groups_of(context, state, first, state.detectable))


def _groups_of(
    context: SearchContext, state: SearchState, first: TrialFit, names: Sequence[str]
) -> tuple[tuple[str, ...], ...]:
    """For each of some effects of the present model those that, in its place, explain as much.

    Not those against which whole runs have spoken. The signals' levels are those of ``first``, the
    trial of the model as given.
    """
    fitter, present = context.fitter, state.current.trial
    barred = {name for name, why in state.refused.items() if why.by_whole_runs}
    rivals = {
        c.effect for c in state.ranking if c.delta_bic < -SETTINGS.admission.least_bic_gain
    } - barred
    levels = levels_of(fitter, first)
    groups = []
    for name in (n for n in names if n in fitter.candidates):
        without = fitter.further(state.current.without(name))
        group, price = [name], price_of(fitter, present, name)
        outside = sorted(rivals - {*present.effects})
        for rival, trial in screened(fitter, outside, without, levels).items():
            if 2 * (trial.expected - present.cost) > SETTINGS.equivalence.hopeless_bic:
                continue
            trial = fitter.further(trial)
            worse = trial.cost - present.cost
            if rival in state.refused:
                worse -= unseen_gain(fitter, present, trial)
            if 2 * worse + price_of(fitter, trial) - price < SETTINGS.equivalence.most_bic_apart:
                group.append(rival)
        groups.append((*group, *_alike_over_whole_runs(context, state, name, {*group} | barred)))
    return tuple(groups)


def _alike_over_whole_runs(
    context: SearchContext, state: SearchState, name: str, excluded: Collection[str]
) -> list[str]:
    """The rivals of an effect, when it was added, that do nearly the same to whole runs.

    None of an effect that is only detectable: it does next to nothing to whole runs. Where these
    stay poor the model is wrong in more than this, and the likelihood of the next
    sample, in which random forces take up what is wrong, does not tell them apart. Not those in
    ``excluded``, which are known already.
    """
    fitter = context.fitter
    if name in state.detectable:
        return []
    at, stage = next((k, s) for k, s in enumerate(state.stages) if name in s.effects)
    tried = [
        c.effect
        for c in state.ranking
        if c.stage == at - 1 and c.delta_bic < -SETTINGS.admission.least_bic_gain
    ]
    rivals = [rival for rival in tried if rival not in {*excluded, *stage.effects}]
    if not rivals or not simulation_is_poor(context, state, state.stages[-1]):
        return []
    simulation = simulation_fitter(fitter)
    fitted = fitted_to_runs(fitter, stage)
    without = fitted_to_runs(fitter, stage, [n for n in stage.effects if n != name])
    effect = share_between(fitter, without, fitted)
    started = screened(simulation, rivals, without, levels_of(fitter, without))
    return alike_by_shares(
        effect,
        {
            rival: share_between(fitter, without, simulation.further(trial))
            for rival, trial in started.items()
        },
    )


def alike_by_shares(effect: Worth, rivals: Mapping[str, Worth]) -> list[str]:
    """The rivals that do nearly what an effect does to whole runs, the nearest first.

    In all channels together, and in the one in which the effect does most: a drag took as much off
    the surge as exchanged thrusters off the yaw rate, and was named as what these may be.
    """
    least = SETTINGS.equivalence.least_share_of_effect
    error = SETTINGS.whole_runs.equivalent_error
    enough = max(least * effect.share, 1.0 - error**2 * (1.0 - effect.share))
    most = max(effect.channels, key=lambda name: effect.channels[name].share, default="")
    near = [
        name
        for name, rival in rivals.items()
        if rival.share > enough
        and (not most or rival.channels[most].share > least * effect.channels[most].share)
    ]
    near.sort(key=lambda name: -rivals[name].share)
    return near[: SETTINGS.equivalence.most_named]


def proposal(
    context: SearchContext,
    search: SearchResult,
    possible: Iterable[str],
    limits: Mapping[str, tuple[float, float]] | None,
) -> Experiment | None:
    """The test, within limits of the inputs, that would separate the first group of several.

    First the groups of the added effects, one after the other; then the model as it is against each
    effect that is possible.
    """
    fitter, last = context.fitter, search.state.stages[-1]
    pairs = [(None, name) for name in possible]
    for group in (*search.groups, *pairs):
        if len(group) < 2:
            continue
        kept = [n for n in last.effects if n != group[0]]
        words = " and ".join(filter(None, group))
        context.say(f"looking for a test that separates {words}", 0.95)
        rivals = [last.fit]
        logs = [record.log for record in fitter.records]
        log = max(logs, key=lambda log: log.duration)
        try:
            for name in group[1:3]:
                rival = with_candidates(context.given, [*kept, name or ""], fitter.candidates)
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
