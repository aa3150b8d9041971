"""The constant context of a search for missing effects, its state, and its start."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from diffthrust._support.errors import InputError
from diffthrust._support.progress import Progress, subtask
from diffthrust.comparison._compare import Comparison, comparison_of
from diffthrust.diagnosis._candidates import Candidates, candidates_of, constants_of
from diffthrust.diagnosis._criteria import criterion
from diffthrust.diagnosis._explained_share import Worth
from diffthrust.diagnosis._findings import (
    Refusal,
    Stage,
    TriedEffect,
)
from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit
from diffthrust.diagnosis._missing import (
    Remaining,
)
from diffthrust.diagnosis._residual_structure import remaining_structure
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._trial_programs import Programs
from diffthrust.effects import EFFECTS
from diffthrust.estimation._arguments import FitOptions
from diffthrust.estimation._fit import FitRuns, fit_records
from diffthrust.estimation._horizons import schedule, to_whole_runs
from diffthrust.estimation._result import Fit
from diffthrust.estimation._status import Status
from diffthrust.models._base.effect import Effect
from diffthrust.models._base.model import Model
from diffthrust.simulation._errors import Errors
from diffthrust.simulation._levels import levels_when_asked
from diffthrust.simulation._record import Record
from diffthrust.simulation._runs import Run, pooled_errors, runs_over, with_steps
from diffthrust.simulation._step_size import CoarseStepWarning

FITTED = 0.1
"""Display: share of a diagnosis, for the progress bar, after which the model as given is fitted."""
_COMPILED = 0.15
"""Display: share after which the trials begin."""
SOUGHT = 0.85
"""Display: share after which no further effect is sought."""
LEARNING = 0.9
"""Display: share after which a law of unknown form is learned."""
_LEFT = 0.6
"""Display: share of the remaining bar that a stage leaves."""
_STARTS = 4, 2
"""Numerics: random starts of a fit, and of a refit, which also starts from a trial and an earlier
stage."""
_SUBSTEPS = 2
"""Numerics: integrator steps per sample of the trials: over one sample errors do not accumulate."""
_ALIKE = 0.02
"""Numerics: relative change of the whole-run NRMSE above which more steps per sample are taken."""


class Clock:
    """The total time of each kind of work."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def __call__(self, step: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.seconds[step] = self.seconds.get(step, 0.0) + time.perf_counter() - start


@dataclass(frozen=True)
class Refit:
    """Fits a model to whole runs, with the options of the first fit.

    Args:
        train: training logs.
        unseen: unseen logs.
        options: of `fit`.
        clock: times it.
        first_substeps: integrator steps per sample that are tried first, after the first fit.
        horizon: of all fits, once the first has ended in whole runs; left open where ``None``.
    """

    train: Sequence[Record]
    unseen: Sequence[Record]
    options: Mapping[str, Any]
    clock: Clock
    first_substeps: int | None = None
    horizon: tuple[float | None, ...] | None = None

    def __call__(
        self,
        model: Model,
        guesses: Sequence[Mapping[str, float]] = (),
        progress: Progress | None = None,
        starts: int = 0,
        records: tuple[Sequence[Record], Sequence[Record]] | None = None,
        segments: bool = False,
        substeps: int = 0,
        horizons: tuple[float | None, ...] | None = None,
        doubts: bool = False,
    ) -> FitRuns:
        """Fit a model; its unseen runs have the integrator steps of the fit, too.

        Args:
            model: the model.
            guesses: additional values to start from.
            progress: is called with the progress of the fit.
            starts: the number of starts, if not the default.
            records: training and unseen records to use in place of all.
            segments: let logs that are left out choose between segments and whole runs, even if the
                first fit ended in whole runs.
            substeps: integrator steps per sample, without a check whether finer ones are needed.
            horizons: of these segments, for a model that has none of its own.
            doubts: look whether the logs are sound.
        """
        records = records or (self.train, self.unseen)
        starts = starts or _STARTS[bool(guesses)]
        options = {"starts": starts, "guesses": guesses, "doubts": doubts, **self.options}
        if horizons := horizons or (None if segments else self.horizon):
            options["horizon"] = horizons
        if substeps:
            options["substeps"] = substeps
        with self.clock("refit"), warnings.catch_warnings():
            warnings.simplefilter("ignore", CoarseStepWarning)  # the notes of a checked fit tell it
            chosen = FitOptions(**options)
            fitted = fit_records(model, *records, chosen, progress, self.first_substeps)
        return _with_its_steps(fitted)


def _with_its_steps(fitted: FitRuns) -> FitRuns:
    """A fit whose unseen runs have its integrator steps, too, so that stages compare by them."""
    fit, _, unseen_runs = fitted
    return fitted._replace(holdout_runs=with_steps(fit.model, unseen_runs, fit.substeps))


@dataclass(frozen=True)
class SearchContext:
    """What a search works with.

    Args:
        given: the model that is diagnosed.
        fitter: fits it with any candidate.
        unseen: unseen logs.
        refit: fits a model to whole runs.
        guess: values from which the first fit started.
        say: is called with the progress.
        clock: measures the time of each kind of work.
        mend_first: whether a sign or an exchange of channels is doubted in the logs.
    """

    given: Model
    fitter: CandidateFitter
    unseen: tuple[Record, ...]
    refit: Refit
    guess: Mapping[str, float]
    say: Progress
    clock: Clock
    mend_first: bool = False


@dataclass(frozen=True, eq=False)
class CurrentModel:
    """The current model, with cached results that are needed repeatedly."""

    fitter: CandidateFitter
    trial: TrialFit
    _without: dict[str, TrialFit] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def criterion(self) -> float:
        """Its information criterion."""
        return criterion(self.fitter, self.trial)

    @cached_property
    def remaining(self) -> Remaining | None:
        """The structure of its residuals."""
        return remaining_structure(self.fitter, self.trial)

    def without(self, name: str) -> TrialFit:
        """The model, fitted without one of its effects.

        The fit stops early if a few steps show that the loss is large.
        """
        if name not in self._without:
            trial, fitter = self.trial, self.fitter
            kept = tuple(n for n in trial.effects if n != name)
            values = fitter.absent(name, trial.values)
            fewer = fitter.solve(kept, values, trial.initial_states, trial.clip, budget=12)
            if (
                fewer.predicted_gain > 0
                and fewer.expected < trial.cost + SETTINGS.admission.plain_bic_gain
            ):
                fewer = fitter.further(fewer)
            self._without[name] = fewer
        return self._without[name]


@dataclass(frozen=True, repr=False, eq=False)
class FittedStage(Stage):
    """A stage of the search with the whole runs of its fit, which everything later works on.

    Args:
        runs: over the training logs, with the integrator steps of the fit.
        unseen_runs: over the unseen ones.
    """

    runs: tuple[Run, ...]
    unseen_runs: tuple[Run, ...]

    @cached_property
    def trained(self) -> Comparison:
        """The stage against the training logs, with as many integrator steps as each needs."""
        return self._compared(self.runs)

    @cached_property
    def judged(self) -> Comparison:
        """The stage against the unseen logs, or the training logs if there are none."""
        return self._compared(self.unseen_runs) if self.unseen_runs else self.trained

    def _compared(self, runs: Sequence[Run]) -> Comparison:
        return comparison_of(self.fit, with_steps(self.fit.model, runs))


Accepted = tuple[tuple[tuple[str, ...], ...], tuple[str, ...]]
"""The effects of all stages, and those that are only detectable."""


@dataclass(frozen=True)
class SearchState:
    """The results of a search so far.

    Args:
        current: the current model.
        stages: the model as given, then after each further effect.
        untestable: effects that the logs cannot test, with the reason.
        ranking: the effects tried at each stage.
        dropped: effects that later ones made superfluous.
        exchanged: effects in whose place a rival came that whole runs prove better, with the rival.
        refused: effects that were not added at the last stage, with the reason.
        turned_down: every refusal so far, with the effects that were present.
        silent: effects without a predicted gain at some stage.
        detectable: effects of the current model without a stage: they do not matter over whole
            runs, and are kept so that their evidence is not attributed to other effects.
        possible: effects that only whole runs support, with their explained share.
        beside: what each effect does to whole runs beside all others, once the search has ended.
        visited: what was accepted after each step before.
        exhausted: the last step added nothing new, which ends the search.
    """

    current: CurrentModel
    stages: tuple[FittedStage, ...]
    untestable: Mapping[str, str]
    ranking: tuple[TriedEffect, ...] = ()
    dropped: tuple[str, ...] = ()
    exchanged: Mapping[str, str] = field(default_factory=dict)
    refused: Mapping[str, Refusal] = field(default_factory=dict)
    turned_down: Mapping[str, tuple[Refusal, tuple[str, ...]]] = field(default_factory=dict)
    silent: frozenset[str] = frozenset()
    detectable: tuple[str, ...] = ()
    possible: Mapping[str, Worth] = field(default_factory=dict)
    beside: Mapping[str, Worth] = field(default_factory=dict)
    visited: Collection[Accepted] = frozenset()
    exhausted: bool = False

    @property
    def number(self) -> int:
        """The number of the last stage."""
        return len(self.stages) - 1

    @property
    def accepted(self) -> Accepted:
        """The effects accepted so far; a step that comes to nothing new ends the search."""
        return tuple(stage.effects for stage in self.stages), self.detectable

    def share(self, progress: float) -> float:
        """The overall progress of the search, from the progress of the next stage.

        The number of stages is unknown: each takes a fixed share of the remaining progress bar.
        """
        remaining = _LEFT ** (self.number + progress)
        return SOUGHT - (SOUGHT - _COMPILED) * remaining


def start_search(
    fit: Fit | Model,
    train: Sequence[Record],
    unseen: Sequence[Record],
    wanted: Candidates | None,
    seed: int,
    say: Progress,
) -> tuple[SearchContext, SearchState]:
    """Fit the model as it is, and compile the programs of the trials."""
    say("fitting the model as it is", 0.0)
    clock = Clock()
    options = fit.options if isinstance(fit, Fit) else {}
    refit = Refit(train, unseen, {"seed": seed, **options}, clock)
    progress = subtask(say, 0.0, FITTED)
    if isinstance(fit, Fit):
        fitted = _with_its_runs(fit, train, unseen)
        fitted = fitted or refit(fit.model, progress=progress, doubts=True)
        guess = fit.guess
    else:
        fitted = refit(fit, progress=progress, doubts=True)
        guess = fitted.fit.guess
    first = fitted.fit
    refit = replace(refit, first_substeps=few_substeps(first, train))
    if first.horizon is None:
        refit = replace(refit, horizon=to_whole_runs(schedule(first.model, train, "auto")))
    effects, untestable = candidates_of(first.model, (*train, *unseen), wanted)
    levels = levels_when_asked(first.model, train)
    effects = [effect.scaled(levels) for effect in effects]
    if len(train) > 1:
        effects = [effect.differing() for effect in effects]
    say("compiling the trials", FITTED)
    with clock("compile"):
        constants = constants_of(first.model, wanted)
        fitter, trial = compiled_fitter(first, effects, constants, train, unseen)
    mend_first = any(doubt.contrary for doubt in first.doubts)
    context = SearchContext(
        first.model, fitter, tuple(unseen), refit, guess, say, clock, mend_first
    )
    stage = FittedStage((), *fitted)
    return context, SearchState(CurrentModel(fitter, trial), (stage,), untestable)


def _with_its_runs(fit: Fit, train: Sequence[Record], unseen: Sequence[Record]) -> FitRuns | None:
    """A fit with its runs over the logs of this diagnosis; ``None`` if it is of other logs.

    It is of these logs if its errors agree with those of the runs. Its errors on unseen logs are
    those of the fit, whose steps may be finer there than on the training logs: a fit of a boat that
    needed 32 steps a sample where it had 16 was taken for one of other logs, and fitted anew from
    0.72 to 0.76.
    """
    if len(fit.initial) != len(train):
        return None
    runs = runs_over(fit.model, train, initial=fit.initial, substeps=fit.substeps)
    if not _agree(fit.train, pooled_errors(runs)):
        return None
    if not unseen:
        return FitRuns(replace(fit, holdout=None) if fit.holdout else fit, runs, ())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CoarseStepWarning)  # the fit has warned
        finer = runs_over(fit.model, unseen, noise=fit.noise_of_runs)
    unseen_runs = with_steps(fit.model, finer, fit.substeps)
    errors = [pooled_errors(finer), pooled_errors(unseen_runs)]
    if fit.holdout is None or not any(_agree(fit.holdout, each) for each in errors):
        fit = replace(fit, holdout=errors[0])
    return FitRuns(fit, runs, unseen_runs)


def _agree(errors: Errors, others: Errors) -> bool:
    return errors.nrmse < math.inf and math.isclose(errors.nrmse, others.nrmse, rel_tol=1e-6)


def compiled_fitter(
    fit: Fit,
    effects: Sequence[Effect],
    constants: Sequence[str],
    train: Sequence[Record],
    unseen: Sequence[Record],
    present: TrialFit | None = None,
    least_substeps: int = 1,
) -> tuple[CandidateFitter, TrialFit]:
    """The fitter, and its first trial: the model as it is, or with the effects of ``present``.

    A model whose fit has failed is tried alone first, before all its candidates are compiled. An
    effect that is present may need more integrator steps a sample than the model of the fit.
    """
    if fit.status is Status.SIMULATION_FAILED:
        alone = CandidateFitter(Programs(fit.model, [], train, [], fit.substeps, fit.noise_model))
        if not math.isfinite(alone.base().cost):
            raise _not_finite(fit, [], train)
    enough = (max(few_substeps(fit, train), least_substeps), max(fit.substeps, least_substeps))
    for substeps in dict.fromkeys(enough):
        programs = Programs(fit.model, effects, train, unseen, substeps, fit.noise_model, constants)
        fitter = CandidateFitter(programs)
        first = fitter.base(present.effects, present.values) if present else fitter.base()
        if math.isfinite(first.cost):
            return fitter, first
    raise _not_finite(fit, effects, train)


def with_finer_steps(
    context: SearchContext, state: SearchState
) -> tuple[SearchContext, SearchState]:
    """The search with as many integrator steps a sample as the runs of its last stage need.

    Trials have as many as the model as given needs. The water in the duct of an NGS thruster needs
    16, and with one its trials ran away: a speed sensor offset passed for a command offset, with
    which the training runs surely err less.
    """
    fitter, fit = context.fitter, state.stages[-1].fit
    present, records = fitter.programs.substeps, fitter.records
    if fit.substeps <= present:
        return context, state
    coarse = pooled_errors(runs_over(fit.model, records, initial=fit.initial, substeps=present))
    if coarse.nrmse <= SETTINGS.whole_runs.equivalent_error * fit.train.nrmse:
        return context, state
    trial, values = state.current.trial, fit.model.parameters
    fitted = {name: values[name].value for name in trial.values if name in values}
    try:
        with context.clock("compile"):
            finer, settled = compiled_fitter(
                state.stages[0].fit,
                [*fitter.candidates.values()],
                fitter.constants,
                records,
                context.unseen,
                replace(trial, values={**trial.values, **fitted}),
                least_substeps=few_substeps(fit, records),
            )
    except InputError:  # its trials overflow with these, too
        return context, state
    return replace(context, fitter=finer), replace(state, current=CurrentModel(finer, settled))


def few_substeps(fit: Fit, train: Sequence[Record]) -> int:
    """The fewest integrator steps per sample that reproduce the whole-run errors of a fit."""
    substeps = min(_SUBSTEPS, fit.substeps)
    while substeps < fit.substeps:
        runs = runs_over(fit.model, train, initial=fit.initial, substeps=substeps)
        if math.isclose(pooled_errors(runs).nrmse, fit.train.nrmse, rel_tol=_ALIKE):
            break
        substeps *= 2
    return substeps


def _not_finite(fit: Fit, effects: Sequence[Effect], train: Sequence[Record]) -> InputError:
    """The error if no trial has a finite cost; it names the user's effect that is the cause."""
    for effect in effects:
        if type(effect) is EFFECTS.get(effect.name):
            continue
        fitter = CandidateFitter(Programs(fit.model, [effect], train, [], fit.substeps))
        if not math.isfinite(fitter.base().cost):
            return InputError(
                f"The effect '{effect.name}' cannot be tried: at its null value the errors or "
                "their derivatives are not finite.",
                "Write it so that its derivative at the null is finite (no root or logarithm "
                "of zero), or leave it out.",
            )
    return InputError(
        f"The '{fit.model}' cannot be simulated along these logs at the parameters of its fit "
        f"({fit.status.value}): expected finite one-step errors, found none."
        + (f" {fit.message}" if fit.status is Status.SIMULATION_FAILED else ""),
        "Give bounds that keep its time constants longer than a fifth of a sample, and check "
        "the units of the logs.",
    )
