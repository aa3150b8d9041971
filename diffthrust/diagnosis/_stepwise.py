"""The steps of a search: screen the candidates, admit the best, or turn to whole runs.

`step` adds an effect or ends the search. It takes the constant `SearchContext` and the current
`SearchState`, and returns the next state.

If few states are measured, random forces in the innovations form can explain anything. Therefore,
if the errors of whole runs are large although one-step errors support no further effect, every
candidate is fitted to whole runs as well, constants among them: a ferry's azimuth turned in 1.3 s
where 0.3 was held, which corrections of its unmeasured angle made up for. Its trial is repeated
from these values. Candidates that only whole runs support are reported as possible.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

from diffthrust.diagnosis._admission import admit
from diffthrust.diagnosis._candidates import of_effect
from diffthrust.diagnosis._explained_share import Worth
from diffthrust.diagnosis._findings import Refusal, Stage, TriedEffect
from diffthrust.diagnosis._innovations_fit import TrialFit, side_by_side
from diffthrust.diagnosis._pairs import with_proven
from diffthrust.diagnosis._rating import Tried, better_noise, rate, screen
from diffthrust.diagnosis._screening import levels_of, screened
from diffthrust.diagnosis._search_state import CurrentModel, SearchContext, SearchState
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._simulation_fit import (
    Runs,
    SimulationTrials,
    share_between,
    values_of,
)
from diffthrust.diagnosis._verdict import far_above_noise
from diffthrust.estimation._horizons import schedule
from diffthrust.estimation._result import Fit
from diffthrust.simulation._starts import felt, told_by

SCREENS = 3
"""Numerics: the largest number of screens of the same candidates: on flat ridges a better noise may
appear repeatedly."""
SEVERAL = 2
"""Numerics: of so many detectable effects on, the next is first looked for among those that gained
before. Beside a first one there is mostly no second: of 46 sets of a bench none had two."""


def step(context: SearchContext, state: SearchState) -> SearchState:
    """Add the best effect by one-step errors or, if these support none, by whole runs.

    In the other order where `runs_lead`. And only by whole runs once as many effects are detectable
    as there may be: on the maps of a T200 five of them, none of which changes a whole run, ended
    the search before the sag of the supply, which removes two thirds of the squared whole-run
    error.
    """
    ways = [next_stage, from_simulation]
    if runs_lead(context):
        ways.reverse()
    if len(state.detectable) >= SETTINGS.admission.most_effects:
        ways.remove(next_stage)
    updated = state
    for way in ways:
        if updated.accepted == state.accepted:
            updated = way(context, updated)
    visited = {*state.visited, state.accepted}
    exhausted = updated.accepted in visited
    # sizes beside another stage, or beside less than is there now, lead nowhere
    stale = updated.stages != state.stages or updated.gained is state.gained
    gained = {} if stale or exhausted else updated.gained
    return replace(updated, visited=visited, gained=gained, exhausted=exhausted)


def runs_lead(context: SearchContext) -> bool:
    """Whether whole runs are asked before one-step errors.

    They are where errors accumulate, so that the model has a horizon, and more states shape what is
    measured than any sensor reads. Random forces on these states then take the
    place of an effect from one sample to the next: of boats with measured positions and no measured
    speeds one-step errors wanted a coupling and a wind, where a current and a weak thruster act.
    """
    records = context.records
    if schedule(context.given, records, "auto")[-1] is None:
        return False
    model = context.given
    # three angles tell four states, of a quaternion
    telling, follow = told_by(model, context.fitter.channels)
    read = {*telling, *follow, *(name for record in records for name in record.measured_states)}
    unread = {*felt(model, records)} & {*model.states} - read
    other_sensors = {*context.fitter.channels} - read
    return len(unread) > len(other_sensors)


def done(state: SearchState) -> bool:
    """Whether the last step added nothing, or the largest number of effects is reached."""
    return state.exhausted or state.number >= SETTINGS.admission.most_effects


def next_stage(context: SearchContext, state: SearchState) -> SearchState:
    """Add the best effect that is accepted, and drop the effects that it makes superfluous.

    Beside several that are only detectable those that gained before are screened first, and all
    where none of these is added: of a BlueBoat seven screens one after the other found something
    detectable, each with all 36 candidates and new programs, two minutes long.
    """
    if state.gained:
        updated = _added_or_quieter(context, state)
        if updated.accepted != state.accepted:
            return updated
        state = replace(updated, gained={})
    return _added_or_quieter(context, state)


def _added_or_quieter(context: SearchContext, state: SearchState) -> SearchState:
    """Rounds of screening until one adds an effect, or finds no better noise.

    If the trials find a better noise, the candidates are screened again beside it.
    """
    for rescreen in reversed(range(SCREENS)):
        previous, state = state, one_round(context, state, rescreen > 0)
        if state.accepted != previous.accepted or state.current is previous.current:
            break
    return state


def one_round(context: SearchContext, state: SearchState, rescreen: bool) -> SearchState:
    """Screen the candidates, and add the best that is accepted.

    With ``rescreen`` a better noise, if the trials find any, ends the round.
    """
    with context.clock("screen"):
        state, tried = screen(context, state)
    if rescreen and (quieter := better_noise(context.fitter, state.current, tried)):
        return replace(state, current=quieter)
    state = replace(state, refused={}, ranking=ranked(state, [rated for rated, _ in tried]))
    for place, (candidate, trial) in enumerate(tried):
        if place and candidate.p_value < SETTINGS.screening.pricing_level:
            # the criterion of all but the first was computed without the price of the noise
            candidate = rate(context.fitter, state, trial, state.current.criterion)
        if candidate.delta_bic > -context.fitter.least_gain:
            continue
        outcome = still_refused(context, state, candidate.effect)
        outcome = outcome or admit(context, state, Tried(candidate, trial))
        if isinstance(outcome, SearchState):
            is_new = outcome.accepted != state.accepted
            return replace(outcome, gained=_sizes_beside(outcome, tried) if is_new else {})
        state = refusing(state, candidate.effect, outcome)
    return state


def _sizes_beside(state: SearchState, tried: Sequence[Tried]) -> dict[str, Mapping[str, float]]:
    """Of the effects that gained in a screen their sizes, where the next is of these alone.

    The last effect that may be called detectable is looked for among all.
    """
    if not SEVERAL <= len(state.detectable) < SETTINGS.admission.most_effects - 1:
        return {}
    gained = [trial for rated, trial in tried if rated.delta_bic < 0]
    return {t.effects[-1]: {n: t.values[n] for n in t.parameters_of()} for t in gained}


def ranked(state: SearchState, tried: Sequence[TriedEffect]) -> tuple[TriedEffect, ...]:
    """The effects that were tried, by stage, the best first.

    Rivals of an effect that is only detectable gain nothing beside it: if an effect was tried
    several times in the same stage, its best result is kept.
    """
    earlier = [rated for rated in state.ranking if rated.stage < state.number]
    same_stage = [
        rated for rated in state.ranking if rated.stage == state.number and state.detectable
    ]
    best: dict[str, TriedEffect] = {}
    for rated in sorted([*same_stage, *tried], key=lambda rated: rated.delta_bic):
        best.setdefault(rated.effect, rated)
    return (*earlier, *best.values())


def refusing(state: SearchState, name: str, why: Refusal) -> SearchState:
    """The search with the refusal of an effect, and the effects that were present."""
    refusal = why, state.current.trial.effects
    return replace(
        state,
        refused={**state.refused, name: why},
        turned_down={**state.turned_down, name: refusal},
    )


def still_refused(context: SearchContext, state: SearchState, name: str) -> Refusal | None:
    """The earlier refusal of an effect by whole runs, if it is still valid.

    It is if no effect that shares a port or a signal with it was added or dropped since.
    """
    why, present = state.turned_down.get(name, (None, ()))
    if why is None or not why.by_whole_runs:
        return None
    candidates = context.fitter.candidates
    moved = {*state.current.trial.effects} ^ {*present}
    if not {name, *moved} <= {*candidates}:  # a constant may act anywhere
        return None if moved else why
    touching = {*candidates[name].ports, *candidates[name].needs}
    touched = any(touching & {*candidates[n].ports, *candidates[n].needs} for n in moved)
    return None if touched else why


def simulation_is_poor(context: SearchContext, state: SearchState, last: Stage | Fit) -> bool:
    """Whether the whole-run errors of a stage or a fit are large and persistent."""
    one_step = context.fitter.sizes(state.current.trial)
    return bool(far_above_noise(last.holdout or last.train, one_step))


def from_simulation(
    context: SearchContext, state: SearchState, look_ahead: bool = True
) -> SearchState:
    """Retry the effects that lower the errors over whole runs, from their values there.

    The first that also lowers the one-step errors is added; the others are possible. Where none is
    added, pairs and singles that whole unseen runs prove are; with ``look_ahead`` also a pair that
    these prove with what such a step adds next.
    """
    if not simulation_is_poor(context, state, state.stages[-1]):
        return replace(state, possible={})
    context.say("fitting the effects to whole runs", state.share(0.5))
    trials = state.trials
    if trials is None or not trials.are_of(state.stages[-1], context.fitter):
        with context.clock("whole runs"):
            trials = _trials(context, state)
    lowering = trials.lowering
    state = replace(state, trials=trials, possible=lowering)
    least = SETTINGS.whole_runs.proving_share
    proving = [name for name, worth in lowering.items() if worth.low > least]
    new = [name for name in proving if name not in state.detectable]
    ahead = partial(from_simulation, context, look_ahead=False) if look_ahead else None
    proven_state = partial(with_proven, context, state, trials, new, ahead)
    led = proven_state() if runs_lead(context) else None
    if led and led.accepted != state.accepted:
        return led
    for name in lowering:
        simulated = trials.singles[name]
        proven = bool(context.unseen) and name in proving
        again = name in state.detectable
        if not again and (outcome := _admitted(context, state, name, simulated, proven)):
            return outcome
        if (proven or again) and state.detectable:
            alone = _without_detectable(context, state)
            outcome = _admitted(context, alone, name, simulated, proven)
            if outcome and outcome.number > state.number:
                return outcome
    return led or proven_state()


def _admitted(
    context: SearchContext, state: SearchState, name: str, simulated: TrialFit, proven: bool
) -> SearchState | None:
    """The search with an effect that lowers the errors over whole runs, if it is accepted."""
    with context.clock("whole runs"):
        trial = _retried(context, state, name, simulated)
        candidate = rate(context.fitter, state, trial, state.current.criterion)
    if candidate.delta_bic > -context.fitter.least_gain:
        return None
    outcome = admit(context, state, Tried(candidate, trial), proven)
    if not isinstance(outcome, SearchState) or outcome.accepted == state.accepted:
        return None
    here = state.number, name
    ranking = [c for c in outcome.ranking if (c.stage, c.effect) != here]
    ranking = sorted([*ranking, candidate], key=lambda c: (c.stage, c.delta_bic))
    return replace(outcome, ranking=tuple(ranking), refused={})


def _without_detectable(context: SearchContext, state: SearchState) -> SearchState:
    """The search without the effects that change nothing over whole runs.

    They must not take up the evidence of an effect that whole unseen runs prove: on the maps of a
    T200 a lag of the load cell, in a static table, took that of a weaker thrust astern.
    """
    fitter = context.fitter
    settled = fitter.settled_without(state.current.trial, state.detectable)
    return replace(state, current=CurrentModel(fitter, settled), detectable=())


def _trials(context: SearchContext, state: SearchState) -> SimulationTrials:
    """The last stage, and the same with each promising effect alone, fitted to whole runs.

    Also those that were detectable before: on the maps of a T200 a weaker thrust astern changed
    nothing until the sag of the supply was there, and then a third of the thrust's error.
    """
    fitter, last = context.fitter, state.stages[-1]
    runs = Runs(fitter, context.given)
    near = runs.near(last.effects, values_of(fitter, last), fitter.unclipped)
    names = [n for n in (*fitter.candidates, *fitter.constants) if n not in last.effects]
    started = screened(runs.fitter, names, near, levels_of(fitter, near))
    untried = [n for n in names if n not in started and n not in fitter.constants]
    users = [n for n in untried if fitter.candidates[n].of_user]
    most = SETTINGS.whole_runs.most_user_effects
    started |= {name: _multistart_fit(context, state, runs, near, name) for name in users[:most]}
    base, *ended = side_by_side(runs.far, [near, *started.values()])
    singles = dict(zip(started, ended, strict=True))
    return SimulationTrials(last, runs, base, singles, _lowering(runs, base, singles), {})


def _lowering(runs: Runs, base: TrialFit, singles: Mapping[str, TrialFit]) -> dict[str, Worth]:
    """What candidates remove that surely lower the errors of whole runs, best first.

    As many constants as effects: these must not be displaced by those that absorb any error.
    """
    worths = {name: share_between(runs.fitter, base, trial) for name, trial in singles.items()}
    best = sorted((n for n in singles if worths[n].sure), key=lambda n: -worths[n].share)
    most, constants = SETTINGS.whole_runs.most_possible, runs.fitter.constants
    kept = {
        *[n for n in best if n in constants][:most],
        *[n for n in best if n not in constants][:most],
    }
    return {name: worths[name] for name in best if name in kept}


def _multistart_fit(
    context: SearchContext, state: SearchState, runs: Runs, near: TrialFit, name: str
) -> TrialFit:
    """A multistart fit to whole runs of an effect with no predicted gain at the current values.

    The fit of a model that lacks a large effect may have ended at values that hide this effect.
    """
    fit = context.refit(state.stages[-1].fit.model + context.fitter.candidates[name]).fit
    values = {**near.values, **{n: p.value for n, p in fit.model.parameters.items()}}
    return runs.near((*near.effects, name), values, near.clip)


def _retried(
    context: SearchContext, state: SearchState, name: str, simulated: TrialFit
) -> TrialFit:
    """The trial of an effect, started from its fit to whole runs."""
    fitter, present = context.fitter, state.current.trial
    parts = (name, *state.stages[-1].effects)
    values = {
        n: v
        for n, v in simulated.values.items()
        if n in context.given.parameters or any(of_effect(n, part) for part in parts)
    }
    effects = (*present.effects, name)
    return fitter.settled(
        effects, {**present.values, **values}, simulated.initial_states, present.clip
    )
