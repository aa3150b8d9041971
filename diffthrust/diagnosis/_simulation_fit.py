"""Trials fitted to whole runs: the same problems without correction of the states.

One program serves many effects here, too. So the influence of an effect on whole runs is cheap to
compute, before the model is refitted with the effect.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from diffthrust.diagnosis._explained_share import BeforeAfter, Worth, explained_share, worth_of
from diffthrust.diagnosis._findings import Stage
from diffthrust.diagnosis._innovations_fit import CandidateFitter, ResidualClip, TrialFit
from diffthrust.estimation._horizons import schedule
from diffthrust.estimation._one_step import passes, with_own_values
from diffthrust.estimation._problem import Problem
from diffthrust.models._base.model import Model

_FEW = 8
"""Numerics: steps from each start of a fit to whole runs, before the best is continued."""
_FOLLOWED = 2
"""Numerics: starts that are followed: those of least cost over the shortest horizon."""


class Runs:
    """Fits to whole runs; where the model has horizons, to runs that forget beyond the longest.

    Where errors accumulate a run of hundreds of seconds has no slope that leads anywhere: of a
    boat's pairs that of a current and a weak thruster came last. Nor has one of 20 s, from afar: of
    45 starts of such a pair 2 came to the optimum, and 30 in the same time by way of runs that
    forget within 2 s. How fast they forget is a number, so that one program serves both.

    Args:
        fitter: the fits of a diagnosis.
        given: the model that is diagnosed.

    Attributes:
        origin: the fits of the diagnosis.
        fitter: of the longest horizon.
    """

    def __init__(self, fitter: CandidateFitter, given: Model) -> None:
        self.origin = fitter
        horizons = schedule(given, fitter.records, "auto")
        self.fitter = fitter.simulating(horizons[-1] or math.inf)
        self._nearby, self._distant = map(self.fitter.gains, (horizons[0], horizons[-1]))

    def near(
        self,
        effects: Sequence[str],
        start: Mapping[str, float],
        clip: ResidualClip,
        budget: int = 40,
    ) -> TrialFit:
        """A fit to runs that forget within the shortest horizon."""
        return self.fitter.solve(effects, {**start, **self._nearby}, None, clip, budget)

    def far(self, near: TrialFit) -> TrialFit:
        """The same over the longest horizon, from there."""
        start = {**near.values, **self._distant}
        return self.fitter.solve(near.effects, start, near.initial_states, near.clip)

    def fitted(
        self, effects: Sequence[str], starts: Sequence[Mapping[str, float]], clip: ResidualClip
    ) -> TrialFit:
        """The best fit from those of some starts that err least over the shortest horizon."""
        costs = [self.fitter.cost(effects, {**s, **self._nearby}, None, clip) for s in starts]
        order = np.argsort(np.where(np.isfinite(costs), costs, np.inf))[:_FOLLOWED]
        ends = [self.far(self.near(effects, starts[k], clip, _FEW)) for k in order]
        return min(ends, key=lambda end: end.expected)


class SimulationTrials(NamedTuple):
    """The fits to whole runs beside a stage, which are made once as long as it is the last.

    Args:
        stage: the stage.
        runs: makes them.
        base: the model of the stage.
        singles: the same with one effect more each.
        lowering: those of them that surely lower the errors, with what they remove; best first.
        pairs: the same with two effects more each, of those pairs that were tried so far.
    """

    stage: Stage
    runs: Runs
    base: TrialFit
    singles: Mapping[str, TrialFit]
    lowering: Mapping[str, Worth]
    pairs: dict[tuple[str, str], TrialFit]

    def are_of(self, stage: Stage, fitter: CandidateFitter) -> bool:
        """Whether they are those beside a stage, with these programs."""
        return self.stage is stage and self.runs.origin is fitter


def fitted_to_runs(
    fitter: CandidateFitter, last: Stage, effects: Sequence[str] | None = None
) -> TrialFit:
    """The model of a stage, or with fewer effects, fitted to whole runs from its values."""
    names = last.effects if effects is None else tuple(effects)
    return fitted_from(fitter, values_of(fitter, last), last.effects, names)


def fitted_from(
    fitter: CandidateFitter,
    values: Mapping[str, float],
    present: Sequence[str],
    effects: Sequence[str],
) -> TrialFit:
    """The model with some effects, of those present at some values, fitted to whole runs."""
    start, simulation = fitter.absent({*present} - {*effects}, values), fitter.simulating()
    return simulation.further(simulation.solve(effects, start, None, fitter.unclipped))


def fitted_beside(
    fitter: CandidateFitter,
    last: Stage,
    trial: TrialFit,
    effects: Sequence[str],
    still: Collection[str] = (),
) -> TrialFit:
    """The model of a stage with other effects, also in place of its own, fitted to whole runs.

    The better of two fits: one starts from the values of the trial, one from those of the stage,
    with those of the trial for the parameters that the stage lacks. Parameters named in ``still``
    keep the values of the trial.
    """
    stage_values = values_of(fitter, last)
    trial_values = {n: v for n, v in trial.values.items() if n not in fitter.nuisance}
    lacking = {
        n: v for n, v in trial_values.items() if n in still or n not in last.fit.model.parameters
    }
    simulation, clip = fitter.simulating(), fitter.unclipped
    ends = []
    for values in (trial_values, lacking):
        start: Mapping[str, float] = {**stage_values, **values}
        start = fitter.absent({*last.effects, *trial.effects} - {*effects}, start)
        ends.append(simulation.solve(effects, start, None, clip, _FEW, still))
    best = min(ends, key=lambda end: end.expected)
    return simulation.solve(effects, best.values, best.initial_states, clip, still=still)


def change_between(fitter: CandidateFitter, first: TrialFit, second: TrialFit) -> Worth:
    """What the second of two trials removes of the first one's squared error over whole runs."""
    return worth_of(*_errors_of_both(fitter.simulating(), first, second))


def share_between(simulation: CandidateFitter, first: TrialFit, second: TrialFit) -> Worth:
    """The share of the first trial's errors that the second removes, on unseen logs if any.

    Over whole runs, or over those that forget: as the trials of `CandidateFitter.simulating` run.
    """
    trained, unseen = _errors_of_both(simulation, first, second)
    return explained_share(unseen or trained)


def _errors_of_both(
    simulation: CandidateFitter, first: TrialFit, second: TrialFit
) -> tuple[list[dict[str, BeforeAfter]], list[dict[str, BeforeAfter]]]:
    """The errors of two trials over the training and the unseen logs, log by log and channel.

    By a program that includes the effects of both: they are then integrated by the same code, and
    rounding makes no difference between them.
    """
    program = simulation.ready({*first.effects, *second.effects})

    def errors(problems: Sequence[Problem]) -> list[dict[str, BeforeAfter]]:
        return [
            {
                name: BeforeAfter(a.measured[c], a.errors[c], b.errors[c])
                for c, name in enumerate(simulation.channels)
            }
            for a, b in zip(*map(passes, problems), strict=True)
        ]

    def at_values(problem: Problem, trial: TrialFit, starts: np.ndarray | None) -> Problem:
        return trial.clip.on(problem.focus(trial.names, trial.values, starts))

    both = first, second
    trained = errors([at_values(program.problem, t, t.initial_states) for t in both])
    if program.unseen is None:
        return trained, []
    unseen = [with_own_values(at_values(program.unseen, t, None)) for t in both]
    return trained, errors(unseen)


def values_of(fitter: CandidateFitter, stage: Stage) -> dict[str, float]:
    """The values of a stage, with absent effects at their nulls."""
    program = fitter.simulating().ready(stage.effects)
    values = {n: p.value for n, p in program.problem.named.items()}
    fitted = {n: p.value for n, p in stage.fit.model.parameters.items() if n in values}
    return {**values, **fitted}
