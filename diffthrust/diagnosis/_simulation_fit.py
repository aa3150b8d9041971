"""Trials fitted to whole runs: their problem with nothing that corrects the states.

They share what is compiled for the innovations form, so that it costs little to know what an effect
does to whole runs before the model is fitted anew with it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from copy import copy
from typing import NamedTuple

import numpy as np

from diffthrust.diagnosis._explained_share import BeforeAfter, Worth, explained_share
from diffthrust.diagnosis._findings import Stage
from diffthrust.diagnosis._innovations_fit import CandidateFitter, ResidualClip, TrialFit
from diffthrust.estimation._observer import is_memory
from diffthrust.estimation._one_step import passes
from diffthrust.simulation._errors import Errors, errors

_FEW = 8
"""Steps from each start of a fit to whole runs."""
_Pairs = list[dict[str, tuple[np.ndarray, np.ndarray]]]


def simulation_fitter(trials: CandidateFitter) -> CandidateFitter:
    """The same trials without an observer: no random force, no lasting error is estimated."""
    whole = copy(trials)
    whole.nuisance = ()
    return whole


def fitted_to_runs(
    trials: CandidateFitter, last: Stage, effects: Sequence[str] | None = None
) -> TrialFit:
    """The model of a stage, or with fewer effects, fitted to whole runs from its values."""
    names = last.effects if effects is None else tuple(effects)
    return _whole(trials, names, {*last.effects} - {*names}, _values_of(trials, last))


def fitted_without(trials: CandidateFitter, trial: TrialFit, effects: Sequence[str]) -> TrialFit:
    """The model of a trial, or with fewer effects, fitted to whole runs from its values."""
    values = {**trial.values, **_still(trials)}
    return _whole(trials, effects, {*trial.effects} - {*effects}, values)


def _whole(
    trials: CandidateFitter,
    effects: Sequence[str],
    absent: Collection[str],
    values: Mapping[str, float],
) -> TrialFit:
    for name in absent:
        values = trials.absent(name, values)
    whole = simulation_fitter(trials)
    return whole.further(whole.solve(effects, values, None, _free(trials)))


def fitted_beside(
    trials: CandidateFitter, last: Stage, trial: TrialFit, effects: Sequence[str]
) -> TrialFit:
    """The model of a stage with other effects, fitted to whole runs.

    From the values of a trial, and from those of the stage with the trial's for what it lacks; the
    better of both.
    """
    there, still = _values_of(trials, last), _still(trials)
    theirs = {n: v for n, v in trial.values.items() if n not in trials.nuisance}
    lacking = {n: v for n, v in theirs.items() if n not in last.fit.model.parameters}
    whole = simulation_fitter(trials)
    begun = [
        whole.solve(effects, {**there, **values, **still}, None, _free(trials), _FEW)
        for values in (theirs, lacking)
    ]
    return whole.further(min(begun, key=lambda end: end.expected))


def share_between(trials: CandidateFitter, before: TrialFit, after: TrialFit) -> Worth:
    """What one trial removes of the errors of another, on unseen logs if there are any."""
    one, other = _held(trials, before, after), _held(trials, after, before)
    return explained_share(_pairs(one.unseen or one.trained, other.unseen or other.trained))


class WholeRuns(NamedTuple):
    """What trials over whole runs say of a change, as `Stage` does of fits.

    Args:
        train: errors on training logs.
        holdout: on unseen ones.
    """

    train: Errors
    holdout: Errors | None


class WholeChange(NamedTuple):
    """Whole runs before a change and after it.

    Args:
        before: without it.
        after: with it.
        worth: on unseen logs, if there are any.
        everywhere: on training and unseen logs together.
    """

    before: WholeRuns
    after: WholeRuns
    worth: Worth
    everywhere: Worth


def change_between(trials: CandidateFitter, before: TrialFit, after: TrialFit) -> WholeChange:
    """What whole runs say of one trial in place of another."""
    one, other = _held(trials, before, after), _held(trials, after, before)
    trained, unseen = _pairs(one.trained, other.trained), _pairs(one.unseen, other.unseen)
    worth = explained_share(unseen or trained), explained_share([*trained, *unseen])
    return WholeChange(one.errors, other.errors, *worth)


class _Held(NamedTuple):
    """A trial over whole runs: measurements and errors by log and channel."""

    trained: _Pairs
    unseen: _Pairs

    @property
    def errors(self) -> WholeRuns:
        return WholeRuns(_pooled(self.trained), _pooled(self.unseen) if self.unseen else None)


def _held(trials: CandidateFitter, trial: TrialFit, beside: TrialFit) -> _Held:
    there = trials.ready({*trial.effects, *beside.effects})
    found: list[_Pairs] = []
    for on, begin in ((there.problem, trial.begin), (there.unseen, None)):
        runs = (
            [] if on is None else passes(trial.limit.on(on.focus(trial.names, trial.values, begin)))
        )
        found.append(
            [
                dict(zip(trials.channels, zip(one.measured, one.errors, strict=True), strict=True))
                for one in runs
            ]
        )
    return _Held(*found)


def _pairs(before: _Pairs, after: _Pairs) -> list[dict[str, BeforeAfter]]:
    return [
        {name: BeforeAfter(seen, rest, late[name][1]) for name, (seen, rest) in early.items()}
        for early, late in zip(before, after, strict=True)
    ]


def _pooled(runs: _Pairs) -> Errors:
    return errors({name: [run[name] for run in runs] for name in runs[0]})


def _values_of(trials: CandidateFitter, stage: Stage) -> dict[str, float]:
    """The values of a stage, with all that is no part of it at its null and nothing corrected."""
    values = {n: p.value for n, p in trials.ready(stage.effects).problem.named.items()}
    values |= {n: p.value for n, p in stage.fit.model.parameters.items() if n in values}
    return {**values, **_still(trials)}


def _still(trials: CandidateFitter) -> Mapping[str, float]:
    return {n: 0.0 for n in trials.problem.nuisance if not is_memory(n)}


def _free(trials: CandidateFitter) -> ResidualClip:
    return ResidualClip(np.full(len(trials.channels), np.inf))
