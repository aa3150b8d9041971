"""The constant context of a search for missing effects, and its state."""

from __future__ import annotations

import time
import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from diffthrust._support.progress import Progress
from diffthrust.comparison._compare import Comparison, comparison_of
from diffthrust.diagnosis._criteria import criterion
from diffthrust.diagnosis._explained_share import Worth
from diffthrust.diagnosis._findings import Refusal, Stage, TriedEffect
from diffthrust.diagnosis._innovations_fit import CandidateFitter, TrialFit
from diffthrust.diagnosis._missing import Remaining
from diffthrust.diagnosis._residual_structure import remaining_structure
from diffthrust.diagnosis._settings import SETTINGS
from diffthrust.diagnosis._simulation_fit import SimulationTrials
from diffthrust.estimation._arguments import FitOptions
from diffthrust.estimation._fit import FitRuns, fit_records
from diffthrust.estimation._horizons import schedule, to_whole_runs
from diffthrust.estimation._result import Fit
from diffthrust.models._base.model import Model
from diffthrust.simulation._record import Record
from diffthrust.simulation._runs import Run, with_steps
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
        like: Fit | None = None,
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
            like: a fit with which this one is only compared: it has the same horizon, whatever
                ``segments`` says, and the same integrator steps.
            substeps: integrator steps per sample, without a check whether finer ones are needed.
            horizons: of these segments, for a model that has none of its own.
            doubts: look whether the logs are sound.
        """
        records = records or (self.train, self.unseen)
        starts = starts or _STARTS[bool(guesses)]
        options = {"starts": starts, "guesses": guesses, "doubts": doubts, **self.options}
        if like is not None:
            substeps = substeps or like.substeps
            horizons = horizons or _to_that_of(like, schedule(model, records[0], "auto"), starts)
        elif not segments:
            horizons = horizons or self.horizon
        if horizons:
            options["horizon"] = horizons
        if substeps:
            options["substeps"] = substeps
        with self.clock("refit"), warnings.catch_warnings():
            warnings.simplefilter("ignore", CoarseStepWarning)  # the notes of a checked fit tell it
            chosen = FitOptions(**options)
            fitted = fit_records(model, *records, chosen, progress, self.first_substeps)
        # unseen runs with the steps of the fit, too: stages compare by them
        fit, _, unseen_runs = fitted
        return fitted._replace(holdout_runs=with_steps(fit.model, unseen_runs, fit.substeps))


def _to_that_of(
    like: Fit, horizons: tuple[float | None, ...], starts: int
) -> tuple[float | None, ...]:
    """Of the horizons of a model those on the way to that of another fit.

    A single start is near its end: the fit that it is compared with lies beside it, and most trials
    were followed to runs that forget beyond the longest segments. Through shorter ones, too, a
    Kingfisher's refits went for 40 s each, where the first fit took 8.
    """
    through = horizons[-1:] if starts == 1 else horizons
    if like.horizon is None:
        return to_whole_runs(through)
    return (*(h for h in through if h is not None and h < like.horizon), like.horizon)


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
        mend_first: whether a sign or an exchange of channels is doubted in the logs.
    """

    given: Model
    fitter: CandidateFitter
    unseen: tuple[Record, ...]
    refit: Refit
    guess: Mapping[str, float]
    say: Progress
    mend_first: bool = False

    @property
    def clock(self) -> Clock:
        """Measures the time of each kind of work."""
        return self.refit.clock

    @property
    def records(self) -> Sequence[Record]:
        """The training logs; those of the ``fitter`` may be windows of them."""
        return self.refit.train


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
            values = fitter.absent((name,), trial.values)
            fewer = fitter.solve(kept, values, trial.initial_states, trial.clip, budget=12)
            near = fewer.expected < trial.cost + SETTINGS.admission.plain_bic_gain
            if near and fewer.predicted_gain > 0:
                fewer = fitter.further(fewer)
            self._without[name] = fewer
        return self._without[name]


@dataclass(frozen=True, repr=False, eq=False)
class FittedStage(Stage):
    """A stage of the search with the whole runs of its fit, which everything later works on.

    Args:
        runs: over the training logs, with the integrator steps of the fit.
        unseen_runs: over the unseen ones.

    Attributes:
        rivals: fits with other effects that were only compared with it, by these, by their starts
            and by their integrator steps: none is made twice.
    """

    runs: tuple[Run, ...]
    unseen_runs: tuple[Run, ...]
    rivals: dict[tuple[tuple[str, ...], int, int], FittedStage] = field(
        default_factory=dict, init=False, repr=False
    )

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
        possible: effects and constants that only whole runs support, with their explained share.
        beside: what each effect does to whole runs beside all others, once the search has ended.
        trials: fits to whole runs beside the last stage, if there are any.
        gained: the candidates of the next screen, where something only detectable was added: those
            that gained beside what was there before, with their values there. All where it is
            empty.
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
    trials: SimulationTrials | None = None
    gained: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
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
