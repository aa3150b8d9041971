"""The evidence for and against a trial: information criterion, unseen logs, whole runs."""

from __future__ import annotations

import math
import re
import statistics
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from diffthrust.diagnosis._findings import HeldValue, Refusal, Stage
from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit
from diffthrust.diagnosis._linear_response import without_overflow
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.estimation._observer import is_memory
from diffthrust.estimation._one_step import nrmse
from diffthrust.models._base.model import Model
from diffthrust.simulation._errors import Errors

_REMEMBERED = {"drift": "memory", "colour": "correlation"}
_BUDGET = 12
"""Numerics: steps of a fit without one of the noises, which starts close to its optimum."""


# -- the information criterion, which includes the parameters of the noise -------------------------


class NoiseTerm(NamedTuple):
    """One random force or correlated sensor error: its gains, and its memory if it has one."""

    gains: tuple[str, ...]
    memory: tuple[str, ...]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Gains and memory."""
        return (*self.gains, *self.memory)


_NOISE = re.compile(r"noise\.(.+?)\.(gain|drift|colour)(?:\..+)?")
"""A gain of the observer: what it acts on, which may have a dot on a craft, and its kind."""


def noises(nuisance: Sequence[str]) -> list[NoiseTerm]:
    """The parameters of an observer, grouped by noise term.

    Example:
        >>> [noise.gains for noise in noises(["noise.speed.gain.speed", "noise.thrust.colour"])]
        [('noise.speed.gain.speed',), ('noise.thrust.colour',)]
    """
    gains: dict[tuple[str, str], list[str]] = {}
    for name in nuisance:
        if not is_memory(name):
            parts = _NOISE.fullmatch(name)
            assert parts is not None
            gains.setdefault((parts[1], parts[2]), []).append(name)
    return [
        NoiseTerm(tuple(names), tuple({f"noise.{of}.{_REMEMBERED.get(kind)}"} & {*nuisance}))
        for (of, kind), names in gains.items()
    ]


def criterion(fitter: CandidateFitter, trial: TrialFit) -> float:
    """Bayesian information criterion, with only the noise terms that the trial needs.

    Random forces and correlated sensor errors are explanations, too, and their parameters are
    penalised: noise terms that do not repay their penalty are removed. An effect that makes a noise
    term superfluous saves that penalty.
    """
    price = math.log(fitter.samples)
    named = noises(fitter.nuisance)
    present = [n for n in named if any(trial.values[gain] != 0 for gain in n.gains)]
    still = {p for n in named if n not in present for p in n.parameters}
    for noise in sorted(present, key=lambda n: max(abs(trial.values[gain]) for gain in n.gains)):
        own_price = len(noise.parameters) * price
        if wald(trial, noise.gains) > SETTINGS.admission.certain_noise * own_price:
            continue
        values = {**trial.values, **dict.fromkeys(noise.gains, 0.0)}
        fewer = still | {*noise.parameters}
        without = fitter.solve(
            trial.effects, values, trial.initial_states, trial.clip, _BUDGET, still=fewer
        )
        if 2 * (without.cost - trial.cost) < own_price:
            trial, still = without, fewer
    model_parameters = trial.count([n for n in trial.names if n not in fitter.nuisance])
    return 2 * trial.cost + price * (model_parameters + len(fitter.nuisance) - len(still))


def wald(trial: TrialFit, names: Sequence[str]) -> float:
    """The Wald statistic of some parameters of a trial against zero."""
    at = [trial.names.index(name) for name in names if name in trial.names]
    size = np.array([trial.values[trial.names[i]] for i in at])
    scales = np.array([trial.problem.named[trial.names[i]].scale for i in at])
    information = without_overflow(trial.quadratic.information)
    covariance = np.linalg.pinv(information, rcond=1e-11, hermitian=True)
    block, z = covariance[np.ix_(at, at)], size / scales
    return float(z @ np.linalg.pinv(block, hermitian=True) @ z)


def price_of(fitter: CandidateFitter, trial: TrialFit, effect: str | None = None) -> float:
    """The penalty of the criterion for an effect of a trial, by default the last one."""
    return trial.count(trial.parameters_of(effect)) * math.log(fitter.samples)


# -- one-step errors on unseen logs ----------------------------------------------------------------


def unseen_gain(fitter: CandidateFitter, baseline: TrialFit, updated: TrialFit) -> float:
    """Gain of log-likelihood on the unseen logs, under the clip of ``updated``; NaN without any.

    Noise levels and initial states are estimated on the unseen logs: the errors of other manoeuvres
    may be larger than in training, and what counts is by how much an effect reduces them. The
    better of both observers is used: an effect that explains much leaves an observer that corrects
    little, and a single event that the effect misses would dominate.
    """
    if baseline.clip is not updated.clip:
        baseline = replace(baseline, clip=updated.clip)
    noise = {name: baseline.values[name] for name in fitter.nuisance}
    louder = replace(updated, values={**updated.values, **noise})
    loss, *losses = (trial.unseen_cost for trial in (baseline, updated, louder))
    return loss - min(losses)


def simulation_errors(fitter: CandidateFitter, trial: TrialFit) -> tuple[float, float | None]:
    """NRMSE of the uncorrected simulation, on training and on unseen logs."""
    simulation = replace(trial, values={**trial.values, **fitter.uncorrected})
    unseen = simulation.unseen
    return nrmse(simulation.at_values), None if unseen is None else nrmse(unseen)


# -- simulations over whole runs, against the evidence of one-step errors --------------------------


def missed(last: Stage, stage: Stage) -> bool:
    """Whether whole training runs get worse without an effect that one-step errors do not need."""
    growth = statistics.geometric_mean(_growth(last.train, stage.train))
    return growth > SETTINGS.admission.most_joint_growth


def no_better(last: Stage, stage: Stage) -> Refusal | None:
    """The refusal of a new stage whose whole-run errors have grown, else ``None``.

    Where those of every channel of the training logs have, the fit has not come to its optimum,
    which is no worse than the last stage: a current of 1.1 m/s on a lake, beside a mass of 31 t in
    place of 6 kg, mended what a fit that had run away did to a Kingfisher's unseen runs.
    """
    if not math.isfinite(stage.train.nrmse):
        return Refusal.FAILS
    rule, trained = SETTINGS.admission, _growth(last.train, stage.train)
    if min(trained) > rule.most_joint_growth:
        return Refusal.TRAINING_RUNS
    if last.holdout is not None and stage.holdout is not None:
        if stage.holdout.nrmse > rule.most_unseen_growth * last.holdout.nrmse:
            return Refusal.UNSEEN_RUNS
        both = trained, _growth(last.holdout, stage.holdout)
        if math.prod(map(statistics.geometric_mean, both)) > rule.most_joint_growth:
            return Refusal.ALL_RUNS
    return None


def _growth(baseline: Errors, updated: Errors) -> list[float]:
    """The growth factor of each channel's error; 1 where it is undefined."""
    pairs = [(baseline.channels[n].rmse, error.rmse) for n, error in updated.channels.items()]
    return [new / old if 0 < old < math.inf and 0 < new < math.inf else 1.0 for old, new in pairs]


# -- the values that the logs support in place of fixed ones ---------------------------------------


def held_values(model: Model, trial: TrialFit) -> dict[str, HeldValue]:
    """The values that the logs support in place of the fixed ones that were freed.

    They come from the innovations form, whose standard errors hold under random forces. In whole
    runs the effect of these forces accumulates, and would be compensated by a wrong constant.
    """
    errors = _standard_errors(trial)
    freed = {n: model.parameters[n] for n in trial.effects if n in model.parameters}
    return {
        name: HeldValue(p.value, trial.values[name], errors[name], p.unit)
        for name, p in freed.items()
    }


def _standard_errors(trial: TrialFit) -> dict[str, float]:
    """Standard errors of the parameters of a trial; infinite without information on one."""
    q, problem = trial.quadratic, trial.at_values
    length = np.sqrt(np.diagonal(q.information))
    live = (length > 0) & np.isfinite(length)
    scaled = q.information[np.ix_(live, live)] / np.outer(length[live], length[live])
    spread = np.full(length.size, np.inf)
    inverse = np.linalg.pinv(scaled, rcond=1e-12, hermitian=True)
    spread[live] = np.sqrt(np.diagonal(inverse)) / length[live]
    spread *= problem.layout.likelihood.law.excess**0.5
    slopes = np.abs(problem.slopes(problem.start()))
    return dict(zip(trial.names, map(float, spread[: len(slopes)] * slopes), strict=True))
